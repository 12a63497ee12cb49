"""What the functions beside `fit` give: a record with attributes, the same as JSON types, and its sentences."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

from plantfit.findings.record import Printed

Found = TypeVar("Found", bound=Printed)


@dataclass(frozen=True, repr=False, eq=False)
class Result(ABC, Generic[Found]):
    """`typed` has all figures as attributes, `record` the same as JSON types (docs: reference/results.md)."""

    typed: Found

    @cached_property
    def record(self) -> dict[str, Any]:
        """All figures as JSON types."""
        return self.typed.plain()

    @property
    def verdict(self) -> str:
        """The sentences as lines of text."""
        return "\n".join(f"{v.level:>8}: {v.sentence}" for v in self.typed.verdict)  # pyrefly: ignore[missing-attribute]  (every one has it)

    @abstractmethod
    def table(self) -> str:
        """The figures as text."""

    def __repr__(self) -> str:
        return f"{self.table()}\n\n{self.verdict}"
