"""Whether anything is left in the residuals: autocorrelation, and correlation with the inputs."""

from plantfit.findings.record import Number, Record, Values


class Cross(Record):
    """Correlation of the residual with one input, within `bound` for 95 % of the lags where there is none."""

    lags_s: Values
    values: Values
    bound: Number = None
    independent: bool
    explained: Number = None
    """Share of the residual's mean square that the past of the input foretells in stretches left out."""


class Stretch(Record):
    """A short stretch of a record that holds most of the squares of a residual, inputs and simulation being there as
    elsewhere."""

    begin: float
    end: float
    """In s."""
    share: float
    """Of the squares."""
    samples: float
    """Share of the samples."""
    gap: float | None = None
    """Of the clock where it begins, in s."""


class Turned(Record):
    """A part of a record in which an output moves against the simulation."""

    begin: float
    end: float
    """In s."""
    within: float
    """Correlation of measured and simulated samples there, and that of all others."""
    elsewhere: float
    throughout: bool = False
    """Whether it is the whole record; `elsewhere` is then the least of the other recordings."""


class ShortRecordings(Record):
    """Test of the residuals of one output in recordings that are too short for tests of their own, taken together."""

    output: str
    recordings: list[str]
    correlation: float
    """From one sample to the next."""
    white: bool
    """Whether white noise has such a correlation, or a larger one, in 1 % of such recordings or more."""
    p_value: float


class ResidualTest(Record):
    """Tests of the residual of one output on the fitted samples of one recording."""

    recording: str
    output: str
    lags_s: Values
    autocorrelation: Values
    bound: Number = None
    white: bool
    """Whether the Ljung-Box test keeps white noise at 1 %."""
    p_value: Number = None
    first: Number = None
    """By how much the simulation begins above the first measured value, whose noise the fit estimated; null where it
    does not."""
    shared: str | None = None
    """The signal whose errors come back in this output."""
    cross: dict[str, Cross] = {}
    """By input."""
    stretch: Stretch | None = None
    turned: Turned | None = None
