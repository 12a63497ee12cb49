"""`plantfit design`: the input of the next experiment."""

from typing import Literal

from plantfit.findings.record import Number, Printed, Record, Samples
from plantfit.findings.verdict import Sentence


class DesignedInput(Record):
    """What an input may do."""

    name: str
    unit: str | None
    low: float
    high: float
    slew: Number
    """Fastest change per second; None for any."""
    seen: Samples | None = None
    """From where to where it went in the recordings."""


class SignalLimit(Record):
    """Limits of an output or a state, and from where to where it goes, on all plants."""

    low: Number
    high: Number
    reached: Samples
    unit: str | None


class OutputWithoutLimit(Record):
    """From where to where an output without a limit to one side or both went in the recordings, and will go."""

    name: str
    unit: str | None
    seen: Samples
    reached: Samples
    open: Literal["lower", "upper", "both"] = "both"
    """Where it has no limit."""


class InputGain(Record):
    """The best input of another kind within the same limits."""

    kind: str
    name: str
    times: Number
    """How many times larger its errors are in the mean, or closer the models."""


class ErrorsAfter(Record):
    """Standard errors of a parameter in its unit; None where it is as good as unknown."""

    name: str
    unit: str | None
    value: float
    now: Number
    then: Number
    """With the new recording beside the old ones."""
    worst: Number
    """Likewise, the largest over the plants."""
    alone: Number
    """With the new recording alone."""
    open: bool
    """Whether the new recording does not determine it."""
    if_known: Number = None
    """`then`, if all other parameters were known."""
    alone_open: bool = False
    """Whether it stays open also if all others were known."""


class Level(Record):
    """What the inputs are at some of the samples, in their order and units."""

    values: Samples
    samples: int


class NextExperiment(Printed):
    """What `pf.design` finds; the input itself is a file of signals."""

    name: str
    samples: int
    period: float
    """s"""
    seconds: float
    inputs: list[DesignedInput]
    limits: dict[str, SignalLimit]
    outputs: list[OutputWithoutLimit]
    criterion: Literal["D", "A", "difference"]
    chosen: list[str]
    """Parameters that shall become certain; empty for all."""
    plants: int
    """That the input has to serve."""
    scatters: list[str] = []
    """Parameters that scatter between recordings: these plants are those of another recording."""
    noise: dict[str, float]
    """Standard deviation by output."""
    inflation: float
    """How many times larger the variances are than those of white residuals."""
    unlike: float = 1.0
    """How many times by errors that are larger where the parameters are told."""
    correlated: bool = False
    """Whether residuals that are correlated make up for the rest."""
    widened: list[str] = []
    """Parameters whose errors in the study allow for scatter between recordings."""
    kind: str
    shape: str
    """Of the input that was found."""
    compared: list[InputGain]
    tried: int
    levels: list[Level] = []
    """Of a model that follows its inputs at once: what to measure at, in any order; empty for others."""
    parameters: list[ErrorsAfter]
    distance: Number = None
    """Of two models under the input, in standard deviations."""
    against: str | None = None
    """The other model."""
    verdict: list[Sentence] = []
    files: list[str] = []
    """Written by the command; `--json` alone."""
