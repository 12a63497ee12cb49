"""What may be missing in the model: additions that were tried, and what they explain."""

from typing import Literal

from pydantic import Field

from plantfit.findings.record import Number, Record, Values
from plantfit.findings.verdict import Sentence


class Tried(Record):
    """One addition to the model, fitted: its `value` in `unit`, and the RMSE without and with it on fitted and on
    unseen samples."""

    name: str
    kind: str = ""
    signal: str = ""
    parameter: str = ""
    unit: str | None = None
    value: Number = None
    standard_error: Number = None
    explained: Number = None
    """Share of the mean square that it takes away."""
    evidence: Number = None
    """To be compared with `needed` of the round."""
    rmse: Number = None
    rmse_with: Number = None
    unseen_rmse: Number = None
    unseen_rmse_with: Number = None


class Round(Record):
    """What was tried at once, beside what earlier rounds found."""

    beside: list[str] = []
    needed: Number = None
    """Evidence from which on an addition is more than chance."""
    found: list[str] = []
    """One addition, or several that explain alike."""
    likely: Literal["very likely", "likely", "possibly"] | None = None
    untried: list[str] = []
    whole: bool = True
    """Whether everything that could be tried was."""
    tried: list[Tried] = []


class Outliers(Record):
    """Samples far from their neighbours, which the diagnosis leaves out."""

    counts: dict[str, list[int]] = {}
    """By output: so many, of so many samples."""
    share: Number = None
    """Of the squares of the residual."""


class ResidualChange(Record):
    """Measured minus simulated, of the model as it is and with what was found."""

    recording: str
    output: str
    unit: str | None = None
    t: list[float]
    before: Values
    after: Values
    timed: bool = True
    """False where the rows have no times: t counts them."""


class ValueBeside(Record):
    """A parameter beside a disturbance that wanders."""

    name: str
    value: Number = None
    standard_error: Number = None
    unit: str | None = None


class Wandering(Record):
    """What is left of an output as a random walk beside white noise, in which nothing follows an input."""

    output: str
    unit: str | None = None
    steps: Number = None
    """Standard deviation from one sample to the next."""
    period: Number = None
    """Of the samples, s."""
    noise: Number = None
    """Standard deviation."""
    explained: Number = None
    """Share of the mean square of what is left."""
    values: list[ValueBeside] = []
    """The parameters with that allowed for."""


class SlowDrift(Record):
    """Of an output, a curve in time."""

    output: str
    unit: str | None = None
    splines: int = 0
    """Of the curve, cubic ones."""
    moves: Number = None
    """From its lowest to its highest."""


class Drifting(Record):
    """What is left of outputs as slow drifts that leave the noise, more slowly than the inputs move the plant."""

    outputs: list[SlowDrift] = []
    explained: Number = None
    """Share of the mean square of what is left of these outputs."""
    values: list[ValueBeside] = []
    """The parameters with that allowed for."""


class CyclePlace(Record):
    """Where a pattern that repeats may act."""

    name: str
    kind: str = ""
    signal: str = ""
    parameter: str = ""
    unit: str | None = None


class Repeating(Record):
    """What is left as a pattern that repeats, in what moves a state or in what a sensor shows."""

    places: list[CyclePlace] = []
    """The best one first; of several the record does not tell which."""
    period: Number = None
    """In s."""
    explained: Number = None
    """Share of the mean square of what is left."""
    pattern: list[Number] = []
    """At the best place, at even times of the period, the first at t = 0."""
    driven: list[str] = []
    """Inputs that repeat as well."""
    rmse: Number = None
    rmse_with: Number = None
    unseen_rmse: Number = None
    unseen_rmse_with: Number = None
    values: list[ValueBeside] = []
    """The parameters with that allowed for."""


class StepFound(Record):
    """A parameter, what moves a state, or what a sensor shows, that is another one from a moment on."""

    name: str
    kind: str = ""
    signal: str = ""
    parameter: str = ""
    unit: str | None = None
    """Of the size; a parameter changes by so much of its value."""
    size: Number = None
    standard_error: Number = None
    at: Number = None
    """In s."""
    at_low: Number = None
    at_high: Number = None
    """Between these with 95 %."""
    before: Number = None
    before_error: Number = None
    """Of a parameter, in its own unit."""
    behind: Number = None
    behind_error: Number = None


class Stepping(Record):
    """What is left as a step at a moment."""

    steps: list[StepFound] = []
    """The best one first; of several the record does not tell which."""
    explained: Number = None
    """Share of the mean square of what is left."""
    rmse: Number = None
    rmse_with: Number = None
    unseen_rmse: Number = None
    unseen_rmse_with: Number = None
    values: list[ValueBeside] = []
    """The other parameters with that allowed for."""


class Diagnosis(Record):
    """Rounds of additions, what they say, and what to write into the study file."""

    rounds: list[Round] = []
    dropped: list[str] = []
    """Found first, and explained by what was found later."""
    exchanged: dict[str, str] = {}
    """By what was found first: what fits better in its place beside what was found later."""
    outliers: Outliers | None = None
    write: list[str] = []
    """Lines of the study file."""
    evaluations: Number = None
    """That it took."""
    allowed: Number = None
    """Evaluations that it might take; none where all was to be tried."""
    with_: list[str] = Field([], alias="with")
    """The additions of `residuals`."""
    residuals: list[ResidualChange] = []
    next: str = ""
    """The command that fits the model with what was found."""
    name: str = ""
    """Of the problem."""
    verdict: list[Sentence] = []
    wandering: Wandering | None = None
    """A disturbance that nothing measured explains."""
    drifting: Drifting | None = None
    """Slow drifts that nothing measured explains."""
    repeating: Repeating | None = None
    """A pattern that repeats every day."""
    stepping: Stepping | None = None
    """A step at a moment."""
    state: Literal["", "whole", "part", "stopped", "left"] = ""
    """Everything was tried, a part of it, it was stopped, or left alone as it would take long."""

    @property
    def named(self) -> bool:
        """Whether something missing was named."""
        return any(r.found for r in self.rounds)
