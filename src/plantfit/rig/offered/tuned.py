"""A controller that `plantfit tune` wrote, NAME-tune.json, to drive a rig or a board."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.predictive.quadratic import Prepared
from plantfit.control.linear.predictive.servo_mpc import Plan, Predictive, servo_mpc
from plantfit.control.linear.servo import Servo, servo
from plantfit.control.linear.smith import Smith, smith
from plantfit.control.pid import Gains, Settings
from plantfit.control.scheduling.law import Schedule, scheduled_pid
from plantfit.control.tune.loop_design import course_seconds
from plantfit.control.tune.loop_scores import Limits, from_rest, limited_pid
from plantfit.control.tune.reduction import Reduced
from plantfit.errors import SimulationError
from plantfit.simulate.loop.controller import Controller

import jax


@dataclass(frozen=True)
class Tuned:
    """A controller by its `form`, `parameters` (`Gains`, `Smith`, `Schedule`, `Servo` or `Predictive`) and `settings`.

    Its `output` and `input` with their units (None: not known), and the step it was tuned for, to `set_point` by
    `step`, in the unit of the output, in `seconds`.
    """

    form: str
    parameters: Any
    settings: Settings
    output: str
    output_unit: str | None
    input: str
    input_unit: str | None
    set_point: float
    step: float
    name: str
    seconds: float | None = None
    plan: tuple[int, bool] | None = None  # inputs that an MPC plans, and whether their rate has a limit
    ahead: int = 0  # samples of a Smith predictor

    @property
    def law(self) -> Controller:
        """The controller with its limits, which begins at rest with the command 0 and takes `given`."""
        s = self.settings
        if isinstance(self.parameters, Gains):
            return limited_pid(s.period, s.lower, s.upper, s.anti_windup, s.tracking_time)
        if isinstance(self.parameters, Schedule):
            return scheduled_pid(s.period, s.anti_windup)
        if isinstance(self.parameters, Smith):
            return smith(s.period, self.ahead, s.anti_windup)
        return from_rest(servo(s.period, lower=s.lower, upper=s.upper) if self.plan is None else servo_mpc(*self.plan))

    @property
    def given(self) -> tuple[Any, ...]:
        """Parameters of `law`: its own, the input at rest, and the limits of a Smith predictor or a scheduled PID."""
        s = self.settings
        return (
            self.parameters,
            0.0,
            *((Limits(s.lower, s.upper, s.follow),) if isinstance(self.parameters, Smith | Schedule) else ()),
        )

    @property
    def told(self) -> str:
        """What it is, in words."""
        if isinstance(g := self.parameters, Gains):
            return f"Kp {g.Kp:.5g}, Ki {g.Ki:.5g} /s, Kd {g.Kd:.5g} s"
        if isinstance(p := self.parameters, Smith):
            return f"Kp {p.gains.Kp:.5g}, Ki {p.gains.Ki:.5g} /s, {self.ahead * self.settings.period:.4g} s ahead"
        if isinstance(p, Schedule):
            return f"gains of {len(p.levels)} levels, Kp {float(p.gains.Kp[0]):.5g} to {float(p.gains.Kp[-1]):.5g}"
        servo = self.parameters if self.plan is None else self.parameters.servo
        states = f"{len(servo.C) - 1} states and the load estimated"
        return states if self.plan is None else f"{states}, {self.plan[0]} inputs planned"

    def running(self) -> "RunningController":
        """The controller sample by sample."""
        return RunningController(self.law, self.given)


class RunningController:
    """A controller under way, numbers in and out: `begin` at rest with the command 0, then `update` every sample."""

    def __init__(self, law: Controller, given: Any):
        self._law, self._given = law, given
        self._state: Any = None
        self.begin(0.0)
        self.update(0.0, 0.0)  # compiled before a board waits for it

    def begin(self, measurement: float) -> None:
        """At rest at this measurement."""
        self._state = jax.tree.map(np.asarray, self._law.init(np.float64(measurement), self._given))

    def update(self, measurement: float, reference: float) -> float:
        """The command of this sample."""
        self._state, command = self._step(self._state, np.float64(measurement), np.float64(reference))
        return float(command)

    @cached_property
    def _step(self) -> Any:
        return jax.jit(lambda state, y, r: self._law.update(state, y, r, self._given))


def read_tuned(path: str | Path) -> Tuned:
    """The controller of a file NAME-tune.json. Raises SimulationError for any other file."""
    place = Path(path)
    try:
        return _tuned(json.loads(place.read_text("utf-8")), place.name)
    except OSError as error:
        raise SimulationError(
            f"The controller {str(path)!r} cannot be read ({error.strerror}); name a file that `plantfit tune` wrote."
        ) from None
    except (ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise SimulationError(
            f"{str(path)!r} is not a controller; name a file NAME-tune.json that `plantfit tune` wrote."
        ) from None


def _tuned(record: dict[str, Any], name: str) -> Tuned:
    best, w = record["controllers"][0], record["wishes"]
    settings = Settings(
        float(w["period"]), float(w["lower"]), float(w["upper"]), w["anti_windup"], record.get("tracking_time")
    )
    out, into, plan = record["output"], record["input"], None
    if "inner_Kp" in best:
        raise SimulationError(
            f"{name} is a cascade, which measures two signals; rigs and boards here give one. Use its C file."
        )
    if "levels" in best:
        names = ("Kp", "Ki", "Kd", "b", "filter_time")
        gains = Gains(**{n: _array(best[n]) for n in names}, c=np.zeros(len(best["levels"])))
        form, parameters = "scheduled PID", Schedule(_array(best["levels"]), gains)
    elif "Kp" in best:
        form, parameters = "PID", Gains(**{n: float(best[n]) for n in ("Kp", "Ki", "Kd", "b", "filter_time")}, c=0.0)
        if "ahead" in best:
            form, parameters = "Smith predictor", Smith(parameters, *(_array(best[n]) for n in Smith._fields[1:]))
    else:
        if "set_point_share" not in best:
            raise SimulationError(
                f"{name} was written before plantfit kept how fast the set "
                "point of an LQI or MPC moves; run `plantfit tune` again."
            )
        form, parameters = (
            "LQI",
            Servo._make(_array(best["set_point_share" if n == "share" else n]) for n in Servo._fields),
        )
        if record.get("plan"):
            form, plan = "MPC", (len(record["plan"]["moves"]), w["rate"] is not None)
            task = Prepared(_array(best["project"]), _array(best["yielding"]))
            low, high = np.nan_to_num(_array(best["low"]), nan=-np.inf), np.nan_to_num(_array(best["high"]), nan=np.inf)
            rate = np.inf if best["rate"] is None else best["rate"]
            x, q, g, free = (_array(best[n]) for n in ("X", "Q", "g", "free"))
            parameters = Predictive(parameters, Plan(x, q, g, free, task, low, high, np.asarray(rate)))
    return Tuned(
        form, parameters, settings, out["name"], out["unit"], into["name"], into["unit"], float(w["set_point"]),
        float(w["step"]), name,
        _seconds(record), plan, int(best.get("ahead", 0)),
    )  # fmt: skip


def _array(values: Any) -> np.ndarray:
    return np.asarray(values, dtype=float)


def _seconds(record: dict[str, Any]) -> float | None:
    """Of the step and what follows: as asked for, or as long as the plant takes; None where the file does not tell."""
    if record["wishes"].get("horizon"):
        return float(record["wishes"]["horizon"])
    r = record.get("reduced")
    if not r:
        return None
    lag = np.inf if r["lag"] is None else r["lag"]
    return float(
        course_seconds(
            Reduced((r["gain"], lag, r["dead_time"]), (r["gain"], lag, 0.0, r["dead_time"]), r["integrating"], "")
        )
    )
