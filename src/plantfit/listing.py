"""What plantfit offers by name: one kind of record for methods and for models."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Option:
    """One option of a method or a model: its name, its default, what it is, and what it may be ("1 to 100", "a, b");
    "" if not said."""

    name: str
    default: Any
    sentence: str = ""
    values: str = ""


@dataclass(frozen=True)
class Listed:
    """A method or a model that comes with plantfit.

    `make(**options)` makes it, and raises SearchError or ModelError for an unknown option; `source` is where it is
    published.
    """

    name: str
    sentence: str
    source: str
    options: tuple[Option, ...]
    make: Callable[..., Any]

    def describe(self) -> str:
        """Name, sentence, source and options as text, one option a line."""
        lines = (
            [f"{self.name}: {self.sentence}", f"source: {self.source}"]
            if self.source
            else [f"{self.name}: {self.sentence}"]
        )
        if not self.options:
            return "\n".join([*lines, "no options"])
        cells = [(o.name, _default(o.default), o.values, o.sentence) for o in self.options]
        widths = [max(len(row[k]) for row in cells) for k in range(3)]
        rows = [
            "  ".join([*(cell.ljust(w) for cell, w in zip(row, widths, strict=False)), row[3]]).rstrip()
            for row in cells
        ]
        return "\n".join([*lines, "options:", *(f"  {row}" for row in rows)])


def _default(value: Any) -> str:
    return "chosen by itself" if value is None else f"{value:g}" if isinstance(value, float) else repr(value)
