"""Whether recordings agree on the parameters that they share: each fitted alone from the answer."""

from typing import Literal

from plantfit.findings.record import Number, Record


class RecordingAlone(Record):
    """One recording, and how far its simulation is off at the answer of all and at its own."""

    name: str
    samples: int | None = None
    independent: Number = None
    """How many independent samples its residuals are worth."""
    sound: bool | None = None
    """False where these are too few for intervals that hold."""
    rmse_joint: Number = None
    rmse_alone: Number = None


class Estimated(Record):
    """A parameter as one fit gives it, in its unit."""

    value: Number
    standard_error: Number = None
    low: Number = None
    high: Number = None
    open: Literal["lower", "upper", "both"] | None = None
    status: str = ""


class EstimatedAlone(Estimated):
    """A parameter as the fit of one recording alone gives it."""

    recording: str
    tested: bool
    """Whether the recording alone determines it, so that it takes part in the test."""


class SharedParameter(Record):
    """A parameter that recordings share, and the test of Cochran that they agree on it; None where no two determine
    it alone."""

    name: str
    unit: str | None = None
    scale: Literal["linear", "log"] = "linear"
    """Of the test."""
    joint: Estimated
    alone: list[EstimatedAlone] = []
    q: Number = None
    degrees: Number = None
    p: Number = None
    p_adjusted: Number = None
    """For how many tests there are (Holm)."""
    i_squared: Number = None
    between: Number = None
    """The standard deviation between recordings, in the unit."""
    seen_from: Number = None
    """The standard deviation between recordings that such recordings tell in 8 of 10 studies, in the unit."""
    differs: bool = False


class AllAtOnce(Record):
    """The test of all parameters together."""

    q: Number
    degrees: Number
    p: Number
    p_adjusted: Number
    differs: bool


class Moved(Record):
    """By how much a parameter of one recording is off that of the others."""

    name: str
    unit: str | None = None
    value: Number
    standard_error: Number
    others: Number
    others_error: Number
    by: Number
    share: Number = None
    """`by` over the value of the others; None at zero."""
    p_adjusted: Number
    told: bool


class Apart(Record):
    """A recording without which the others agree."""

    recording: str
    others: list[str] = []
    moved: list[Moved] = []


class Heterogeneity(Record):
    """What the recordings, each alone, say of the parameters that they share."""

    state: Literal["tested", "left"]
    """"left" where the refits would have taken more than `allowed`."""
    evaluations: float = 0.0
    allowed: float
    agree: bool | None = None
    """None where nothing could be tested."""
    level: Number = None
    unit: str | None = None
    """Of the output, where there is one."""
    recordings: list[RecordingAlone] = []
    parameters: list[SharedParameter] = []
    together: AllAtOnce | None = None
    apart: list[Apart] = []
    either: list[str] = []
    """Several of which one is apart."""
