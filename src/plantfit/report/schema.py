"""The findings record as typed values: what `trust.assess` gives and the report draws.

The plain record is described in docs/architecture.md. Sections that are missing are empty;
None and NaN both mean "not known".
"""

from collections.abc import Mapping
from math import isfinite, prod
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from plantfit.errors import PlantfitError


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]
Values = list[float | None]
Part = Literal["fit", "validation", ""]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class Sentence(_Record):
    level: Literal["good", "warning", "bad", "info"]
    sentence: str
    figures: dict[str, Number] = {}


class Input(_Record):
    unit: str | None = None
    values: Values


class Output(_Record):
    unit: str | None = None
    measured: Values
    simulated: Values
    part: list[Part] = []


class Recording(_Record):
    name: str
    log: list[str] = []
    t: list[float]
    inputs: dict[str, Input] = {}
    outputs: dict[str, Output] = {}

    @model_validator(mode="after")
    def _lengths_agree(self):
        n = len(self.t)
        lengths = {f"input {name!r}": len(signal.values) for name, signal in self.inputs.items()}
        for name, output in self.outputs.items():
            lengths |= {f"measured {name!r}": len(output.measured), f"simulated {name!r}": len(output.simulated)}
            if output.part:
                lengths[f"part of {name!r}"] = len(output.part)
        for what, length in lengths.items():
            if length != n:
                raise ValueError(f"{what} has {length} values but t has {n}")
        return self


class Score(_Record):
    recording: str
    output: str
    unit: str | None = None
    part: Literal["fit", "validation"]
    n: int
    rmse: Number = None
    bias: Number = None
    fit_percent: Number = None


class Cross(_Record):
    lags_s: Values
    values: Values
    bound: Number = None
    independent: bool


class ResidualTest(_Record):
    recording: str
    output: str
    lags_s: Values
    autocorrelation: Values
    bound: Number = None
    white: bool
    p_value: Number = None
    cross: dict[str, Cross] = {}


class StatedUncertainty(_Record):
    """Standard uncertainties of one parameter: by noise, by stated errors and their sources, and together with the 95 % interval."""

    noise: Number = None
    shared: Number = None
    sources: dict[str, Number] = {}
    combined: Number = None
    low: Number = None
    high: Number = None
    degrees_of_freedom: Number = None


class ByNoise(_Record):
    """What the noise of the recordings alone gives a parameter that scatters between them."""

    standard_error: Number = None
    low: Number = None
    high: Number = None
    status: str = ""


class Parameter(_Record):
    """`index` places an entry of the table `parameter`; it is empty for a single number."""

    name: str
    parameter: str = ""
    recording: str | None = None
    index: list[int] = []
    unit: str | None = None
    value: Number
    standard_error: Number = None
    low: Number = None
    high: Number = None
    lower_bound: Number = None
    upper_bound: Number = None
    scale: Literal["linear", "log"] = "linear"
    at_bound: Literal["lower", "upper"] | None = None
    open: Literal["lower", "upper", "both"] | None = None  # ends that the data do not set: `low`, `high` are bounds of the search there
    limits: list[Number] | None = None  # physical ones
    status: str = "determined"
    equal_answers: list[Number] | None = None  # from, to: over runs of the same cost, where these leave the interval
    uncertainty: StatedUncertainty | None = None
    by_noise: ByNoise | None = None


class StatedError(_Record):
    """A row of a budget; `acts` tells what the error does to readings."""

    name: str
    kind: Literal["A", "B"] = "B"
    shape: str = ""
    limit: Number = None
    unit: str | None = None
    divisor: Number = None
    standard: Number = None
    sensitivity: Number = None
    contribution: Number = None
    expanded: Number = None
    share: Number = None
    degrees_of_freedom: Number = None
    acts: str = ""
    per_recording: bool = False


class ReadingBudget(_Record):
    """The budget of one reading of a signal, of the clock, or of a held parameter, `at` a value."""

    of: str
    kind: Literal["signal", "clock", "constant"]
    unit: str | None = None
    at: Number = None
    recordings: list[str] | None = None
    sources: list[StatedError]
    combined: Number = None
    expanded: Number = None
    degrees_of_freedom: Number = None
    coverage_factor: Number = None


class Uncertainty(_Record):
    """Budgets of what was stated, and how the errors were carried to the parameters."""

    method: Literal["linear", "monte carlo"]
    draws: int | None = None
    seed: int | None = None
    budgets: list[ReadingBudget] = []


class OperatingTable(_Record):
    """Entries of one table, flat in row-major order over the nodes of its one or two signals; `samples` in the cells around each."""

    name: str
    unit: str | None = None
    over: list[str]
    over_units: list[str | None] = []
    nodes: list[list[float]]
    recording: str | None = None
    values: Values
    low: Values
    high: Values
    status: list[str]
    samples: list[int] | None = None

    @model_validator(mode="before")
    @classmethod
    def _units_for_all(cls, given: Any) -> Any:
        """Units of the signals that are not told are not known."""
        if isinstance(given, Mapping) and not given.get("over_units"):
            return {**given, "over_units": [None] * len(given.get("over") or ())}
        return given

    @model_validator(mode="after")
    def _lengths_agree(self):
        entries = prod(len(n) for n in self.nodes)
        lengths = {"values": self.values, "low": self.low, "high": self.high, "status": self.status}
        if self.samples is not None:
            lengths["samples"] = self.samples
        for what, values in lengths.items():
            if len(values) != entries:
                raise ValueError(f"{what} has {len(values)} entries but the nodes make {entries}")
        if not len(self.over) == len(self.over_units) == len(self.nodes) or entries == 0:
            raise ValueError(f"over names {len(self.over)} signals but there are {len(self.nodes)} lists of nodes, none of them empty")
        return self


class SmoothedTable(_Record):
    """Strengths of one table's smoothing along its axes, and the bends (box widths) that they take for likely."""

    name: str
    over: list[str]
    strengths: list[float]
    bends: Values
    chosen: str
    entries: int
    effective: Number = None


class Combination(_Record):
    sentence: str
    weights: dict[str, Number] = {}
    relative_sd: Number = None


class History(_Record):
    evaluations: Values = []
    cost: Values = []

    @model_validator(mode="after")
    def _lengths_agree(self):
        if len(self.evaluations) != len(self.cost):
            raise ValueError(f"history has {len(self.evaluations)} evaluations but {len(self.cost)} costs")
        return self


class Run(_Record):
    method: str
    run: int
    seed: int | None = None
    cost: Number = None
    rmse: Number = None
    status: str = ""
    ended: str = ""
    evaluations: Number = None
    seconds: Number = None
    failures: int = 0
    parameters: dict[str, Number] = {}
    searched: dict[str, Number] = {}  # the parameters that the search ended with, where they were moved since
    history: History = History()


class Basin(_Record):
    cost: Number = None
    runs: int
    share: Number = None
    parameters: dict[str, Number] = {}


class DistinctAnswer(_Record):
    runs: int
    parameters: dict[str, Number] = {}


class SameModel(_Record):
    """A map between answers that are one model: parameter `name` takes the value of `source[name]`, times its `sign`."""

    sentence: str
    source: dict[str, str] = {}
    sign: list[int] = []


class Agreement(_Record):
    """Runs whose own search, run to its end on the final problem, reaches the lowest cost; `spent`: cut by their budget."""

    runs: int
    agree: int
    cost: Number = None
    spent: int = 0
    spent_and_searched: int = 0
    spent_and_agree: int = 0
    cut: int = 0
    left: int = 0
    ended: str = ""
    ranges: dict[str, list[Number]] = {}  # of each parameter over runs of the lowest cost, exchanged terms aside
    answers: list[DistinctAnswer] = []
    symmetries: list[SameModel] = []


class Weight(_Record):
    """The residual of an output that counts as 1, in its unit, and `who` chose it in words."""

    output: str
    unit: str | None = None
    scale: Number
    chosen: Literal["given", "unit", "spread", "residuals"]
    who: str = ""
    rounds: int = 0
    settled: bool = True


class SimulatedOutput(_Record):
    unit: str | None = None
    max_error: Number = None
    rms_error: Number = None
    rms_residual: Number = None


class Simulation(_Record):
    stepper: str = ""
    substeps: Any = None
    recording: str = ""
    checked_with: str = ""
    checked_samples: int | None = None
    samples: int | None = None
    refused: str = ""
    outputs: dict[str, SimulatedOutput] = {}


class Look(_Record):
    kind: str = ""
    level: Literal["good", "warning", "bad", "info"]
    recording: str
    signal: str | None = None
    sentence: str
    times: Values = []
    begin: Number = None
    end: Number = None
    write: str = ""


class Tried(_Record):
    name: str
    unit: str | None = None
    value: Number = None
    standard_error: Number = None
    explained: Number = None
    rmse: Number = None
    rmse_with: Number = None
    unseen_rmse: Number = None
    unseen_rmse_with: Number = None


class Round(_Record):
    beside: list[str] = []
    found: list[str] = []
    untried: list[str] = []
    tried: list[Tried] = []


class ResidualChange(_Record):
    recording: str
    output: str
    unit: str | None = None
    t: list[float]
    before: Values
    after: Values


class Diagnosis(_Record):
    state: str = ""
    verdict: list[Sentence] = []
    rounds: list[Round] = []
    write: list[str] = []
    next: str = ""
    with_: list[str] = Field([], alias="with")
    residuals: list[ResidualChange] = []

    @property
    def named(self) -> bool:
        """Whether something missing was named."""
        return any(r.found for r in self.rounds)


class Heterogeneity(_Record):
    """Whether recordings agree on the parameters that they share; None where it could not be tested."""

    state: str = ""
    agree: bool | None = None


class Reproduction(_Record):
    spec: str | None = None
    seed: int | None = None
    versions: dict[str, str] = {}
    cpu: str = ""
    seconds: dict[str, Number] = {}
    command: str = ""


class Findings(_Record):
    name: str
    verdict: list[Sentence] = []
    recordings: list[Recording] = []
    scores: list[Score] = []
    residual_tests: list[ResidualTest] = []
    data: list[Look] = []
    diagnosis: Diagnosis | None = None
    parameters: list[Parameter] = []
    uncertainty: Uncertainty | None = None
    tables: list[OperatingTable] = []
    smoothing: list[SmoothedTable] = []
    heterogeneity: Heterogeneity | None = None
    combinations: list[Combination] = []
    runs: list[Run] = []
    basins: list[Basin] = []
    agreement: Agreement | None = None
    weights: list[Weight] = []
    simulation: Simulation | None = None
    reproduction: Reproduction | None = None


def read_findings(findings: Mapping[str, Any]) -> Findings:
    """The plain record as `Findings`; PlantfitError names the first place that does not fit the schema."""
    try:
        return Findings.model_validate(findings)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(step) for step in first["loc"]) or "its top level"
        raise PlantfitError(
            f"The findings record is wrong at {place} ({first['msg'].removeprefix('Value error, ')}); make it with plantfit.trust.assess."
        ) from None


def array(values: Values | list[float]) -> np.ndarray:
    """Values (n,) as float64 with NaN for what is not known."""
    return np.array(values, dtype=float)
