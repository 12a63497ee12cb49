"""What the functions beside `fit` give: a record with attributes, the same as JSON types, and its sentences."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

from plantfit.findings.record import Printed

Found = TypeVar("Found", bound=Printed)


@dataclass(frozen=True, repr=False, eq=False)
class Result(Generic[Found]):
    """`typed` has all figures as attributes, `record` the same as JSON types (docs: reference/results.md)."""

    typed: Found

    @cached_property
    def record(self) -> dict[str, Any]:
        """All figures as JSON types."""
        return self.typed.plain()

    @property
    def verdict(self) -> str:
        """The sentences as lines of text."""
        return "\n".join(f"{v.level:>8}: {v.sentence}" for v in self.typed.verdict)  # type: ignore[attr-defined]  (every one has it)

    def table(self) -> str:
        """The figures as text."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"{self.table()}\n\n{self.verdict}"
