"""What maximum likelihood and Kalman filters find: levels of noise, innovations, and the answer where it is theirs."""

from typing import Literal

from plantfit.findings.record import Number, Record
from plantfit.findings.residuals import ResidualTest, WeightedParameter


class NoiseLevel(Record):
    """The standard deviation of a noise; of process noise by how much it moves a state in a second."""

    kind: Literal["process", "measurement"]
    name: str
    unit: str | None
    value: float
    low: Number
    high: Number
    how: Literal["found", "given", "left out", "at a bound"]
    """`found` by maximum likelihood."""


class InnovationSize(Record):
    """The mean square of whitened innovations, and between what it lies in 95 % of records."""

    mean: Number
    low: Number
    high: Number
    p: Number
    consistent: bool
    sentence: str


class FilterOfEstimate(Record):
    """What a filter says of itself."""

    method: str
    nis: InnovationSize
    memory: dict[str, Number]
    """Correlation of neighbouring innovations, by output."""
    chance: dict[str, Number] = {}
    """How large it is by chance in 1 % of the recordings whose innovations are white, by output."""
    log_likelihood: Number


class AheadScore(Record):
    """How far an output is off where the filter foretells each sample from those before it."""

    recording: str
    output: str
    unit: str | None
    part: Literal["fit", "validation"]
    n: int
    rmse: float


class FilteredAnswer(Record):
    """The answer of a study by maximum likelihood or a Kalman filter, which let noise move the states of the plant."""

    estimator: Literal["maximum likelihood", "ekf", "ukf"]
    noise: list[NoiseLevel]
    filter: FilterOfEstimate
    """Of the filter that foretells; beside maximum likelihood the EKF at its values."""
    p: Number
    """Of the test that least squares gives the same; null where there is none."""
    moved: str | None
    """The parameter in which the two differ most."""
    differs: bool
    assumed: list[str]
    """What the study file does not say, and how it was taken."""
    least_squares: list[WeightedParameter] = []
    """What least squares gives."""
    ahead: list[AheadScore] = []
    tests: list[ResidualTest] = []
    """Of the errors one sample ahead, by recording and output."""
