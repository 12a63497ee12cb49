"""Parameters that are tables over signals, and how they were smoothed."""

from collections.abc import Mapping
from math import prod
from typing import Any

from pydantic import model_validator

from plantfit.findings.parameters import Status
from plantfit.findings.record import Number, Record, Values


class OperatingTable(Record):
    """Entries of one table, flat in row-major order over the nodes of its one or two signals."""

    name: str
    unit: str | None = None
    over: list[str]
    over_units: list[str | None] = []
    nodes: list[list[float]]
    recording: str | None = None
    samples: list[int] | None = None
    """In the cells around each entry."""
    values: Values
    low: Values
    high: Values
    status: list[Status]

    @model_validator(mode="before")
    @classmethod
    def _units_for_all(cls, given: Any) -> Any:
        """Units of the signals that are not told are not known."""
        if isinstance(given, Mapping) and not given.get("over_units"):
            return {**given, "over_units": [None] * len(given.get("over") or ())}
        return given

    @model_validator(mode="after")
    def _lengths_agree(self) -> "OperatingTable":
        entries = prod(len(n) for n in self.nodes)
        lengths: dict[str, int] = {k: len(getattr(self, k)) for k in ("values", "low", "high", "status")}
        if self.samples is not None:
            lengths["samples"] = len(self.samples)
        for what, length in lengths.items():
            if length != entries:
                raise ValueError(f"{what} has {length} entries but the nodes make {entries}")
        if not len(self.over) == len(self.over_units) == len(self.nodes) or entries == 0:
            raise ValueError(
                f"over names {len(self.over)} signals but there are "
                f"{len(self.nodes)} lists of nodes, none of them empty"
            )
        return self


class SmoothedTable(Record):
    """Strengths of one table's smoothing along its axes, and the bends (box widths) that they take for likely."""

    name: str
    over: list[str]
    strengths: list[float]
    bends: Values
    chosen: str
    """Given, or by which criterion: cross-validated, reml."""
    entries: int
    effective: Number = None
    """Entries that the data alone would set."""
