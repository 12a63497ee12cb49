"""`plantfit tune --hold`: a regulator that holds an equilibrium, and what it is worth on the plants that judge."""

from dataclasses import dataclass

from plantfit.findings.record import Printed, Real, Record
from plantfit.findings.verdict import Sentence

Matrix = list[list[Real]]


@dataclass(frozen=True)
class HoldWishes:
    """What is held and what is asked for, in the units of the study.

    States `at` which the plant is held, by name; `input` that drives it, within `lower` and `upper`, every `period` s.
    From `lean` (unit of the state `along`) away from the point a plant is to return within `seconds`: every output
    within `tolerance` then. Starts are tried up to `largest`. `sizes`, `quantum` and `noise` of the outputs, by name.
    `ms` is a target; `share` of the plants have to return.
    """

    at: dict[str, float]
    input: str
    period: float
    lower: float
    upper: float
    along: str
    lean: float
    largest: float
    seconds: float
    tolerance: float
    sizes: dict[str, float]
    quantum: dict[str, float]
    noise: dict[str, float]
    ms: float = 2.0
    share: float = 0.95


class Regulator(Record):
    """One regulator with its filter, `plantfit.control.linear.lqr.StateFeedback`, and what it is worth."""

    name: str
    """What it was searched on."""
    weight: float
    """Of the input, a multiple of 1 / (half its range)^2."""
    shake: float
    """Noise of the input that the filter expects, a multiple of half its range in a second."""
    gain: list[Real]
    """Of the states, in the order of `states`."""
    filter_gain: Matrix
    """Of the outputs' innovations (states, outputs)."""
    ms: Real
    """Largest sensitivity at the input, of the best fit."""
    ms_worst: Real
    """The 90 % quantile over the plants."""
    below: Real
    """How far below the point the best fit may begin and return, in the unit of the state that leans."""
    above: Real
    below_worst: Real
    """The 5 % quantile over the plants."""
    above_worst: Real
    stable_share: float
    share: float
    """Of the plants that return from the lean that was asked for, to both sides."""


class HeldPlant(Printed):
    """What `pf.tune(..., hold=...)` finds, and what NAME-tune.json holds."""

    name: str
    """Of the study."""
    form: str
    wishes: HoldWishes
    proposed: dict[str, str]
    """What was not asked for, and where it is from."""
    units: dict[str, str | None]
    """Of states, inputs and outputs."""
    states: list[str]
    outputs: list[str]
    point: dict[str, float]
    """States and the input at rest there, of the best fit."""
    unstable: list[float]
    """Real parts of the poles of the best fit that grow, 1/s."""
    plants: int
    """That judge."""
    plants_are: str
    promised: bool
    """Whether the share that was asked for returns."""
    regulators: list[Regulator]
    """The one searched on all plants, then the one searched on the best fit alone."""
    verdict: list[Sentence]
    files: list[str] = []
    """Written by the command; `--json` alone."""
