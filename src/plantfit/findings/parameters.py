"""Values of the parameters, their intervals, and what the data determine of them."""

from typing import Literal

from plantfit.findings.record import Number, Record
from plantfit.findings.uncertainty import StatedUncertainty

Status = Literal["determined", "weak", "flat", "at bound", "not visited", "fixed"]


class ByNoise(Record):
    """What the noise of the recordings alone gives a parameter that scatters between them."""

    standard_error: Number = None
    low: Number = None
    high: Number = None
    status: Status


class Scatter(Record):
    """Of a parameter that scatters between recordings, or whose interval allows for that."""

    between: Number
    """Standard deviation between recordings (Paule and Mandel), in the unit; 0 where the recordings agree on this
    one."""
    degrees: float
    """Of freedom of the standard error."""
    told: bool
    """Whether recordings disagree; else this one may scatter, though not beyond chance."""


class Parameter(Record):
    """One number, or one entry of a table, in `unit`; `low` and `high` are its 95 % interval."""

    name: str
    parameter: str = ""
    """The parameter that an entry belongs to."""
    recording: str | None = None
    """The one recording that it holds for."""
    index: list[int] = []
    """The place of an entry in the table `parameter`; empty for a single number."""
    unit: str | None = None
    value: Number
    standard_error: Number = None
    """None where the data do not determine the value, and for fixed ones."""
    low: Number = None
    """Lower end of the interval."""
    high: Number = None
    """Upper end."""
    open: Literal["lower", "upper", "both"] | None = None
    """Ends that the data do not set: `low` and `high` are bounds of the search there."""
    limits: list[Number] | None = None
    """Physical ones, lower and upper; None where there is none."""
    lower_bound: Number = None
    """Of the search."""
    upper_bound: Number = None
    """Of the search."""
    scale: Literal["linear", "log"] = "linear"
    """How the search divides the range between the bounds."""
    at_bound: Literal["lower", "upper"] | None = None
    """The bound of the search that the value is pressed on."""
    pulled: Number = None
    """Share of the squares that are left which a value beyond that bound would explain, by the linearised problem; 0
    where noise may take it there."""
    delays: str | None = None
    """The input or state that a dead time delays, of one at a bound."""
    status: Status = "determined"
    """How well the data fix the value: by its interval against its size, not against the bounds."""
    equal_answers: list[Number] | None = None
    """From, to: over runs of the same cost, where these leave the interval."""
    moved_with: str | None = None
    """The table that fits as well if it is moved along its nodes together with this value."""
    by_steps: Number = None
    """Standard uncertainty by the steps in which inputs were read, which `standard_error`, `low` and `high` allow
    for; None where they matter little."""
    uncertainty: StatedUncertainty | None = None
    by_noise: ByNoise | None = None
    """None where the interval is that by the noise alone: one recording, or enough that agree."""
    scatter: Scatter | None = None
    """None where nothing speaks for a scatter between recordings."""


class StandardErrors(Record):
    """How standard errors are made: with the correlation of the residuals in time (robust) or without (classical)."""

    kind: Literal["robust", "classical"]
    in_time: bool
    """Whether samples follow one another in time."""
    not_weighted: str = ""
    """Why the answer is not that of the `estimator` that the study asks for in words."""
    estimator: str | None = None
    """What it asks for."""
    filterable: bool = False
    """Whether maximum likelihood and Kalman filters work on the model."""


class Combination(Record):
    """A direction in which parameters can be moved together, with the standard deviation that is left along it."""

    sentence: str
    weights: dict[str, Number] = {}
    """Relative changes by parameter, the largest 1."""
    relative_sd: Number = None
    """Of the logarithm of the parameters along it."""


class DeterminedCombination(Record):
    """A product of powers or a weighted sum of parameters that the data fix, though not its parts."""

    formula: str
    weights: dict[str, Number] = {}
    """Powers in a product, factors in a sum."""
    product: bool
    value: Number
    low: Number = None
    high: Number = None
    standard_error: Number = None


class KnownOther(Record):
    """The parameter that has to be `known` (`at` its value, in `unit`) for another one to be determined, and that
    one's value then."""

    known: str
    unit: str | None = None
    at: Number
    value: Number
    standard_error: Number = None


class FirstValues(Record):
    """The parameter whose interval grows most, and by which factor, because states begin at measured values with
    noise."""

    parameter: str
    factor: float
    option: str | None = None
    """What makes the initial values parameters in the model's options; None for models without such an option."""


class Determined(Record):
    """How many numbers the data fix: parameters, and combinations of those that they leave open one by one."""

    count: int
    """Determined parameters and combinations."""
    of: int
    """Free parameters."""
    directions: int | None = None
    """Independent directions that the data fix near the answer, those that no formula names among them."""
    sound: bool
    """False where too few independent samples are left for intervals that hold."""
    samples: Number = None
    """How many independent ones the residuals are worth."""
    shown: list[str] = []
    """Where not `sound`: parameters that as many independent samples with residuals as large would determine. A range
    of theirs that has no end tells of the residuals alone."""
    first_values: FirstValues | None = None
    combinations: list[DeterminedCombination] = []
    only_if: dict[str, KnownOther] = {}
    """By parameter: the other one that has to be known."""
