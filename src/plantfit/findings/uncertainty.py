"""Budgets of stated errors, and what they add to the intervals of parameters."""

from typing import Literal

from plantfit.findings.record import Number, Record


class StatedUncertainty(Record):
    """Standard uncertainties of one parameter: by noise, by stated errors and their sources, and together with the
    95 % interval."""

    noise: Number = None
    """By the residuals alone: the standard error."""
    shared: Number = None
    """By all stated errors."""
    sources: dict[str, Number] = {}
    """By each of them."""
    combined: Number = None
    """Root of the sum of both squares."""
    low: Number = None
    high: Number = None
    degrees_of_freedom: Number = None
    """None for many."""


class StatedError(Record):
    """A row of a budget (GUM, JCGM 100:2008): the limit that was stated, and what it contributes as a standard
    uncertainty."""

    name: str
    kind: Literal["A", "B"] = "B"
    """Evaluated from repeats (A) or otherwise (B)."""
    shape: str = ""
    limit: Number = None
    unit: str | None = None
    divisor: Number = None
    standard: Number = None
    sensitivity: Number = None
    contribution: Number = None
    expanded: Number = None
    share: Number = None
    """Of the combined variance."""
    degrees_of_freedom: Number = None
    acts: str = ""
    """What the error does to readings."""
    per_recording: bool = False


class ReadingBudget(Record):
    """The budget of one reading of a signal, of the clock, or of a held parameter, `at` a value."""

    of: str
    kind: Literal["signal", "clock", "constant"]
    unit: str | None = None
    at: Number = None
    """The recorded reading that is the most uncertain, or the value that is held."""
    recordings: list[str] | None = None
    """None for all."""
    sources: list[StatedError]
    combined: Number = None
    expanded: Number = None
    """With the coverage factor 2."""
    degrees_of_freedom: Number = None
    coverage_factor: Number = None
    """Of 95 %."""


class Uncertainty(Record):
    """Budgets of what was stated, and how the errors were carried to the parameters."""

    method: Literal["linear", "monte carlo"]
    draws: int | None = None
    seed: int | None = None
    budgets: list[ReadingBudget] = []
