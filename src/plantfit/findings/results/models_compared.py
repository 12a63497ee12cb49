"""`plantfit compare` of models: errors, paired differences and criteria of several models of the same data."""

from typing import ClassVar, Literal

from plantfit.findings.record import Exclude, Number, Printed, Record, Samples
from plantfit.findings.verdict import Sentence


class Counted(Record):
    """How many parameters of a model the data determine."""

    count: int
    of: int


class Errors(Record):
    """Root mean square errors by part; None where a model has no samples of it."""

    fit: Number
    unseen: Number
    left_out: Number
    """Of samples as predicted by fits without the fifth of the recording that they lie in."""


class OutputErrors(Record):
    """Root mean square errors of one output, in its unit."""

    unit: str | None
    fit: Number
    unseen: Number
    left_out: Number


class ComparedModel(Record):
    """One model, or the best linear model without physics."""

    name: str
    kind: Literal["model", "linear"]
    sentence: str
    """What the linear model is."""
    free: int
    """Parameters."""
    effective: Number
    """Parameters as AICc and BIC count them."""
    determined: Counted | None
    rmse: Errors
    """In the unit of the output; of several outputs the root of the mean of (error/scale)^2."""
    outputs: dict[str, OutputErrors]
    aic: Number
    aicc: Number
    bic: Number
    """Criteria are differences to the least of the models."""


class ModelPair(Record):
    """The difference of the errors of two models, on the samples by which they are judged."""

    better: str
    worse: str
    difference: Number
    """RMSE of `worse` less that of `better`."""
    half_width: Number
    """Of its 95 % interval."""
    p: Number
    degrees: int
    """Of freedom of Student's t."""
    samples: int
    correlation: Number
    """Samples over which the difference of the losses remembers."""
    over: Literal["stretches", "noise"]
    """Whether the interval is over other stretches of such data or over the noise of these samples."""
    told: bool
    """Whether the data tell the two apart."""


class ModelSeries(Record):
    """One output of one recording: measured, and simulated by every model."""

    recording: str
    output: str
    unit: str | None
    t: Samples
    measured: Samples
    part: list[Literal["fit", "validation", ""]]
    simulated: dict[str, Samples]
    timed: bool = True
    """False where the rows have no times: t counts them."""


class ComparisonOfModels(Printed):
    """What `pf.compare_models` finds."""

    samples_in: ClassVar[Exclude] = {"series": True}

    verdict: list[Sentence] = []
    judged_by: Literal["unseen", "left out"]
    """Samples that no model was fitted to, or blocks that were left out of fits."""
    scales: dict[str, float]
    """By output, what counts as 1."""
    unit: str | None
    """Of the output, where there is one."""
    samples: int
    independent: Number
    """Samples as their correlation leaves them, which AICc and BIC count."""
    models: list[ComparedModel]
    pairs: list[ModelPair]
    """All pairs of models, then the best model with the linear one."""
    series: list[ModelSeries] = []
    """Left out of `--json`."""
    studies: dict[str, int] = {}
    """Numbers in the store, by model; `--json` alone."""
    written: dict[str, str] = {}
    """Files by kind; `--json` alone."""
