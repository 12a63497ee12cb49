"""`plantfit estimate`: the parameters by maximum likelihood and Kalman filters beside least squares."""

from plantfit.findings.filtered import FilterOfEstimate as FilterOfEstimate
from plantfit.findings.filtered import InnovationSize as InnovationSize
from plantfit.findings.filtered import NoiseLevel as NoiseLevel
from plantfit.findings.record import Number, Printed, Record
from plantfit.findings.residuals import CorrelatedNoise
from plantfit.findings.verdict import Sentence


class EstimateOfMethod(Record):
    """A parameter as one method gives it, in its unit; ends of a 95 % interval are None where they are not known."""

    value: Number
    standard_error: Number
    low: Number
    high: Number
    at_bound: bool
    """Whether the likelihood holds it at a bound of its range."""


class EstimatedParameter(Record):
    """A parameter by every method that gives it."""

    name: str
    unit: str | None
    truth: Number
    """Where it is known, as of a virtual rig."""
    estimates: dict[str, EstimateOfMethod]


class MethodPair(Record):
    """The test that two methods agree, which counts their estimates as independent."""

    first: str
    second: str
    statistic: Number
    degrees: int
    p: Number
    sentence: str
    p_adjusted: Number
    """For how many pairs there are (Holm)."""
    differs: bool


class EstimatesByMethod(Printed):
    """What `pf.estimate_parameters` finds."""

    name: str
    methods: list[str]
    parameters: list[EstimatedParameter]
    noise: list[NoiseLevel]
    filters: list[FilterOfEstimate]
    correlated: list[CorrelatedNoise] = []
    """Of generalised least squares, by output."""
    agreement: list[MethodPair]
    assumed: list[str]
    """What the study file does not say, and how it was taken."""
    log_likelihood: Number
    agree: bool | None
    """None where there are no two methods to compare."""
    verdict: list[Sentence] = []
    study: int | None = None
    """Number in the store; `--json` alone."""
    written: dict[str, str] = {}
    """Files by kind; `--json` alone."""
