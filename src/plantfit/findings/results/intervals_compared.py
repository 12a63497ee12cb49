"""`plantfit intervals`: intervals of the parameters by several kinds, side by side."""

from math import nan
from typing import Literal

from plantfit.findings.parameters import Status
from plantfit.findings.record import Number, Printed, Record, Samples
from plantfit.findings.verdict import Sentence

Kind = Literal["verdict", "covariance", "profile", "bootstrap", "posterior"]


class KindOfInterval(Record):
    """An interval of one kind, in the unit of the parameter; None where there is none."""

    kind: Kind
    low: Number
    high: Number
    open_low: bool
    """Whether the end is at a bound of the search, which cuts the interval off."""
    open_high: bool
    points: list[float] = []
    """Of a profile: where the parameter was held."""
    excess: Samples = []
    """Of a profile: by how much the sum of squares grows there, over the variance."""
    threshold: Number = None
    """Of a profile: the excess at its ends."""
    inflation: Number = None
    """Of a profile: the variance of the value over that of errors that are independent and of one size."""
    sample: list[float] = []
    """Up to 4000 refits or draws."""
    median: Number = None
    """Of the posterior."""

    @property
    def ends(self) -> tuple[float, float]:
        """`low` and `high`, NaN where there is none."""
        return nan if self.low is None else self.low, nan if self.high is None else self.high

    @property
    def width(self) -> float:
        """NaN where there is none."""
        low, high = self.ends
        return high - low


class IntervalsOfParameter(Record):
    """All kinds of one parameter."""

    name: str
    unit: str | None
    value: float
    standard_error: Number
    status: Status
    scatters: bool
    """Whether the interval of the verdict allows for a scatter between recordings, as no other kind does."""
    kinds: list[KindOfInterval]


class BootstrapOfIntervals(Record):
    """The bootstrap of blocks of residuals."""

    replicates: int
    lost: int
    """Refits that failed."""
    block: dict[str, int]
    """Samples of a block, by output."""
    blocks: dict[str, int]
    """How many of them the longest recording has, by output."""


class PosteriorOfIntervals(Record):
    """The draws of NUTS."""

    chains: int
    draws: int
    """Of each chain."""
    orders: dict[str, int]
    """Of the autoregressive noise, by output; 0 for white noise."""
    diverged: int
    priors: dict[str, list[float]]
    """Mean and standard deviation of the parameters that have a normal prior."""
    r_hat: dict[str, Number]
    effective: dict[str, Number]
    """Independent draws that all are worth."""


class ComparisonOfIntervals(Printed):
    """What `pf.compare_intervals` finds."""

    name: str
    level: float
    seed: int
    parameters: list[IntervalsOfParameter]
    bootstrap: BootstrapOfIntervals | None
    posterior: PosteriorOfIntervals | None
    refused: dict[str, str]
    """What could not be made, by kind, and why."""
    verdict: list[Sentence] = []
    study: int | None = None
    """Number in the store; `--json` alone."""
    written: dict[str, str] = {}
    """Files by kind; `--json` alone."""
