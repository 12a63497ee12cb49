"""`plantfit tune`: a controller, what it was asked for, and what it and others are worth on the plants that judge."""

import math
from dataclasses import dataclass, field
from typing import Any

from plantfit.findings.record import Printed, Real, Record
from plantfit.findings.verdict import Sentence

Matrix = list[list[Real]]


@dataclass(frozen=True)
class LoopWishes:
    """What a loop is asked for, all in the units of the study.

    From rest at `set_point` - `step` to `set_point`, then `load` at the plant's input. `period` (s) of the controller,
    input limits, `quantum` of the sensor and standard deviation `noise` of the measurement. `overshoot` (%) and `ms`
    are limits that the `share` of the plants has to keep; `input_noise` is how much of the input's range the noise may
    move it (standard deviation). `horizon` (s) of step and load.

    Beside them `settling` (s, to within 2 % of the step), `gain_margin` (a factor), `phase_margin` (deg) and `travel`
    (all moves of the input together over step and load, those by `noise` included) may be limited. `minimise` are
    weights of the figures that a search makes small, each counted in that of SIMC.

    `over` says how plants are weighed: "expected" by the mean of their costs, "worst" by the largest, "chance" by the
    mean of both the mean and that of the worst of them that may miss the `share`.

    Of a cascade: `inner_quantum` and `inner_noise` of the inner sensor, limits of the inner set point.

    `rate` is the fastest change of the input (its unit per s); the output is to stay within `output_lower` and
    `output_upper` all the time. A plan of an MPC looks `prediction` s ahead.
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
    settling: Real = math.inf
    gain_margin: float = 1.0
    phase_margin: float = 0.0
    travel: Real = math.inf
    minimise: dict[str, float] = field(default_factory=lambda: {"iae": 1.0, "load_iae": 1.0})

    over: str = "chance"
    inner_quantum: float = 0.0
    inner_noise: float = 0.0
    inner_lower: Real = -math.inf
    inner_upper: Real = math.inf

    def also(self, input_unit: str | None = None) -> list[str]:
        """Limits beside overshoot and Ms, in words, with the unit of the input."""
        found = [f"settle within {self.settling:.4g} s"] if math.isfinite(self.settling) else []
        found += [f"have a gain margin of {self.gain_margin:g}"] if self.gain_margin > 1 else []
        found += [f"have a phase margin of {self.phase_margin:g} deg"] if self.phase_margin > 0 else []
        if not math.isfinite(self.travel):
            return found
        unit = f" {input_unit}" if input_unit not in (None, "", "1") else ""
        noise = ", with the sensor's noise" if self.noise > 0 or self.inner_noise > 0 else ""
        return [*found, f"move the input by {self.travel:.4g}{unit} at most over step and load{noise}"]


class LoopSignal(Record):
    """The output that is controlled, or the input that is driven."""

    name: str
    unit: str | None


class ReducedPlant(Record):
    """The plant as classical rules see it: first order with dead time, half a sample in it; or an integrator with
    dead time."""

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
    """PI, PID, Smith predictor, cascade, scheduled PID, LQI or MPC."""


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


class PredictorSettings(PidSettings):
    """The PID of a Smith predictor, and the plant without dead time that it sees, about (u0, y0):
    `plantfit.control.linear.smith`."""

    A: Matrix
    B: list[Real]
    C: list[Real]
    steady: list[Real]
    """States at rest per unit of the input."""
    taken: Real
    """Of what the prediction misses, in a sample."""
    u0: Real
    y0: Real
    ahead: int
    """Samples of dead time."""


class CascadeSettings(PidSettings):
    """The outer PID, whose command is the set point of the inner PI."""

    inner_Kp: Real
    inner_Ki: Real
    inner_Ti: Real
    """s"""


class ScheduleSettings(Record):
    """PIDs at levels of the output, between which gains are interpolated: lists (m,)."""

    levels: list[Real]
    Kp: list[Real]
    Ki: list[Real]
    Kd: list[Real]
    b: list[Real]
    """Weights of the set point."""
    filter_time: list[Real]
    """s, of the derivatives."""


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
    itae: Real = float("nan")
    """Integral of time times the absolute error of the step over its size, s^2."""
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
    meets: dict[str, float] = {}
    """Shares of the plants that meet each specification alone."""


class PidLoop(LoopFigures, PidSettings, LoopHead):
    """A PI or PID and what it is worth."""


class SmithLoop(LoopFigures, PredictorSettings, LoopHead):
    """A Smith predictor and what it is worth."""


class CascadeLoop(LoopFigures, CascadeSettings, LoopHead):
    """A PID around a PI and what they are worth."""


class ScheduledLoop(LoopFigures, ScheduleSettings, LoopHead):
    """A scheduled PID and what it is worth."""


class ServoLoop(LoopFigures, ServoSettings, LoopHead):
    """An LQ servo with a filter and what it is worth."""


class PredictiveLoop(LoopFigures, PlanSettings, ServoSettings, LoopHead):
    """An MPC, with the servo that it is where no limit acts, and what it is worth."""


Loop = PidLoop | PredictiveLoop | ServoLoop | SmithLoop | CascadeLoop | ScheduledLoop


class FrontPoint(Record):
    """A controller of a front."""

    number: int
    """From 1 on, as `pick` takes it."""
    figures: dict[str, Real]
    """On the best fit."""
    share: float
    """Of all plants that keep the wishes."""
    settings: dict[str, Any]
    """As in `controllers`."""


class ControllerFront(Record):
    """Controllers none of which is better in all of the figures."""

    figures: list[str]
    units: dict[str, str]
    picked: int | None
    """The point that was chosen as the tuned controller; None where that is the one of least weighted sum."""
    points: list[FrontPoint]


class ScheduledLevel(Record):
    """One level of a schedule."""

    level: float
    step: float
    """The change that ends at the level, by which it was tuned and judged."""
    share: float
    """Of the plants that keep the wishes here with the scheduled controller."""
    alone: list[float]
    """The same with the PID of each level alone."""
    iae: Real
    """Of the step on the best fit with the scheduled controller, s."""
    settings: dict[str, Any]
    """Gains here, as in `controllers`."""


class ScheduledLevels(Record):
    """Gains over the level of the output, and what they are for."""

    levels: list[ScheduledLevel]
    every: float
    """Share of the plants that keep the wishes at every level."""
    single: list[float]
    """The same with the PID of each level alone."""
    best_single: int
    """The level, from 0 on, whose PID does best at all of them."""
    across_overshoot: Real
    """% of a step from the first level to the last that 95 % of the plants keep."""


class TunedController(Printed):
    """What `pf.tune` finds, and what NAME-tune.json holds."""

    name: str
    """Of the problem."""
    form: str
    units: dict[str, str]
    """Of the gains."""
    output: LoopSignal
    input: LoopSignal
    inner: LoopSignal | None = None
    """The output that the inner loop of a cascade measures."""
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
    tracking_time: float | None = None
    """s, of back-calculation; None for another anti-windup."""
    schedule: ScheduledLevels | None = None
    """Where gains follow the level."""
    front: ControllerFront | None = None
    """Where one was asked for."""
    held: float
    """Share of the plants on which the input's limits hold the set point under the load."""
    promised: bool
    """Whether the share of the plants that was asked for keeps the wishes."""
    controllers: list[Loop]
    """The one tuned on all plants, the one tuned on the best fit alone, then rules and other forms."""
    verdict: list[Sentence]
    files: list[str] = []
    """Written by the command; `--json` alone."""
