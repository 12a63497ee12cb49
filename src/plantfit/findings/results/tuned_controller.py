"""`plantfit tune`: a controller, what it was asked for, and what it and others are worth on the plants that judge."""

import math
from dataclasses import dataclass

from plantfit.findings.record import Printed, Real, Record
from plantfit.findings.verdict import Sentence

Matrix = list[list[Real]]


@dataclass(frozen=True)
class LoopWishes:
    """What a loop is asked for, all in the units of the study.

    From rest at `set_point` - `step` to `set_point`, then `load` at the plant's input. `period` (s) of the controller, input limits,
    `quantum` of the sensor and standard deviation `noise` of the measurement. `overshoot` (%) and `ms` are limits that the `share` of
    the plants has to keep; `input_noise` is how much of the input's range the noise may move it (standard deviation). `horizon` (s) of
    step and load.

    `rate` is the fastest change of the input (its unit per s); the output is to stay within `output_lower` and `output_upper` all the
    time. A plan of an MPC looks `prediction` s ahead.
    """

    set_point: float
    step: float
    load: float
    period: float
    lower: Real
    upper: Real
    quantum: float = 0.0
    noise: float = 0.0
    overshoot: float = 10.0
    ms: float = 1.6
    share: float = 0.95
    input_noise: float = 0.05
    controller: str = "pid"
    horizon: float | None = None
    anti_windup: str = "clamping"
    rate: Real = math.inf
    output_lower: Real = -math.inf
    output_upper: Real = math.inf
    prediction: float | None = None


class LoopSignal(Record):
    """The output that is controlled, or the input that is driven."""

    name: str
    unit: str | None


class ReducedPlant(Record):
    """The plant as classical rules see it: first order with dead time, half a sample in it; or an integrator with dead time."""

    how: str
    gain: Real
    lag: Real
    """s; infinite for an integrator."""
    dead_time: Real
    """s"""
    integrating: bool
    second_order: list[Real]
    """Gain, both lags and dead time."""


class PlanOfEverySample(Record):
    """What an MPC does every sample."""

    seconds: float
    """How far it looks ahead."""
    dead_time: float
    """s, that passes before a command acts."""
    moves: list[int]
    """Samples that each planned input lasts."""
    rows: int
    """Limits on inputs, their changes and outputs."""
    steps: int
    """Of the iteration."""
    multiplications: int


class LoopHead(Record):
    """Which controller it is."""

    name: str
    """What it was tuned on: all plants, the best fit, or a rule."""
    source: str
    form: str
    """PI, PID, LQI or MPC."""


class PidSettings(Record):
    """Parallel form (Kp, Ki, Kd) and ISA form (K, Ti, Td)."""

    Kp: Real
    Ki: Real
    Kd: Real
    K: Real
    Ti: Real
    """s"""
    Td: Real
    """s"""
    b: Real
    """Weight of the set point."""
    filter_time: Real
    """s, of the derivative."""


class ServoSettings(Record):
    """The arrays of `plantfit.control.linear.servo.Servo`, which says what each is."""

    A: Matrix
    B: Matrix
    C: list[Real]
    D: Real
    gain: list[Real]
    K: list[Real]
    P: list[Real]
    f: Real
    set_point_share: Real
    """`share` of the servo: how fast the set point that it follows moves. Files before this key had lost it."""
    rest: list[Real]
    u0: Real
    y0: Real


class PlanSettings(Record):
    """The arrays of `plantfit.control.linear.predictive.servo_mpc.Plan`, which says what each is."""

    X: Matrix
    Q: Matrix
    g: list[Real]
    free: Matrix
    project: Matrix
    yielding: list[Real]
    low: list[Real]
    high: list[Real]
    rate: Real


class LoopFigures(Record):
    """What a loop is worth: on the best fit where nothing else is said."""

    iae: Real
    """Integral of the absolute error of the step over its size, s."""
    overshoot: Real
    """%"""
    settling: Real
    """s"""
    load_iae: Real
    """Integral of the absolute error after the load, in the unit of the output times s."""
    load_peak: Real
    travel: Real
    """Of the input."""
    outside: Real
    """How far the output goes beyond its limits."""
    ms: Real
    """Largest sensitivity."""
    mt: Real
    """Largest complementary sensitivity."""
    gain_margin: Real
    phase_margin: Real
    """degrees"""
    stable: bool
    input_noise: Real
    """Standard deviation of the input by noise, as a share of its range."""
    share: float
    """Of all plants that keep overshoot and Ms."""
    stable_share: float
    worst: dict[str, Real]
    """Over all plants."""


class PidLoop(LoopFigures, PidSettings, LoopHead):
    """A PI or PID and what it is worth."""


class ServoLoop(LoopFigures, ServoSettings, LoopHead):
    """An LQ servo with a filter and what it is worth."""


class PredictiveLoop(LoopFigures, PlanSettings, ServoSettings, LoopHead):
    """An MPC, with the servo that it is where no limit acts, and what it is worth."""


Loop = PidLoop | PredictiveLoop | ServoLoop


class TunedController(Printed):
    """What `pf.tune` finds, and what NAME-tune.json holds."""

    name: str
    """Of the problem."""
    form: str
    units: dict[str, str]
    """Of the gains."""
    output: LoopSignal
    input: LoopSignal
    others: dict[str, float]
    """Inputs that the loop does not drive, and at which they are held."""
    wishes: LoopWishes
    proposed: dict[str, str]
    """What was not asked for, and where it is from."""
    plants: int
    """That judge."""
    plants_are: str
    not_determined: list[str]
    """Parameters that the data do not determine."""
    reduced: ReducedPlant
    plan: PlanOfEverySample | None
    """None for another form than an MPC."""
    held: float
    """Share of the plants on which the input's limits hold the set point under the load."""
    promised: bool
    """Whether the share of the plants that was asked for keeps the wishes."""
    controllers: list[Loop]
    """The one tuned on all plants, the one tuned on the best fit alone, then rules and other forms."""
    verdict: list[Sentence]
    files: list[str] = []
    """Written by the command; `--json` alone."""
