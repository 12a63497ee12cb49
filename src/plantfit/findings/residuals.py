"""Whether anything is left in the residuals: autocorrelation, and correlation with the inputs."""

from typing import Literal

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


class Curved(Record):
    """What a polynomial of the inputs explains of a residual of rows that are not in time, more than chance does."""

    inputs: list[str]
    explained: float
    """Share of the mean square."""
    p_value: float
    noise: float
    """What is left beside it, in the unit of the output."""


class Sizes(Record):
    """Residuals of rows that are not in time, whose size changes with the simulated output."""

    low: float
    """Their rms in the third of the rows where the simulated output is smallest, in its unit."""
    high: float
    """The same where it is largest."""
    p_value: float


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
    curved: Curved | None = None
    sizes: Sizes | None = None
    """Where standard errors take all residuals as of one size."""


class CorrelatedNoise(Record):
    """The noise of an output as generalised least squares takes it."""

    output: str
    unit: str | None
    deviation: float
    """Standard deviation of a sample, without what samples share."""
    order: int
    """Of the autoregression."""
    correlation: float
    """Of neighbouring samples."""
    samples: int
    independent: float
    """How many independent samples they are worth."""
    left: float
    """Correlation of neighbours that is left after all this is taken out."""
    shared: Number
    """Standard deviation of the errors that samples share (`shared_errors`): a share of the output, or in its unit."""
    form: Literal["edges in proportion", "edges", "own in proportion", "own"] | None
    """What is shared: errors of the edges between neighbouring numbers or of each number, in proportion to the output
    or of one size."""


class WeightedParameter(Record):
    """A parameter by least squares weighted for noise that is correlated, in its unit, with its 95 % interval."""

    name: str
    unit: str | None
    value: float
    low: Number
    high: Number


class CorrelatedResiduals(Record):
    """Residuals that are not white taken for noise that is correlated: generalised least squares (`plantfit
    estimate`)."""

    noise: list[CorrelatedNoise]
    """By output."""
    parameters: list[WeightedParameter]
    p: Number
    """Of the test that such noise alone moves the parameters from where they are; null where it hardly can move
    them."""
    moved: str | None
    """The parameter that it moves most."""
    differs: bool
    """Whether that is more than such noise explains: the model lacks something."""
    least_squares: list[WeightedParameter] | None = None
    """Where `parameters` are the answer, what least squares gives; null where the answer is that of least squares."""
