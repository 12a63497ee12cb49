"""Forms of controllers that one search and one judgement serve: a PID, an LQ servo with its filter, and one that plans within limits."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.predictive.servo_mpc import Predictive, servo_mpc
from plantfit.control.linear.servo import Servo, servo, servo_response, unstable_poles
from plantfit.control.pid import Gains, Settings, checked
from plantfit.control.tune.frequency import pid_response
from plantfit.control.tune.loop_scores import Limits, from_rest, pid_of_limits, slewed
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.rules import FILTER, Isa, rule_gains
from plantfit.control.tune.weights.plan_weights import PlanShape
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes
from plantfit.simulate.loop.closed_loop import Controller
from plantfit.sobol import Sobol
from plantfit.space import Parameter, Space

import jax.numpy as jnp

STARTS = 64  # servos that are tried before a search begins at the best of them


@dataclass(frozen=True, eq=False)
class Form:
    """What a kind of controller is for a search.

    `build(z, data)` turns a point of the cube of `space` into parameters (a pytree; jax-traceable) of the `loop`'s controller, which
    takes (these, the input at rest, *`given`); programs are compiled once for a `build` and a `response`, for all `data` and `given`.
    `response(parameters, w, xp)` is C(e^(jwh)) from the error with no limit acting, `unstable` counts the controller's own poles outside
    the unit circle. `starts` (k, d) are points of the cube to begin with; `plan` is that of an MPC.
    """

    name: str
    space: Space
    build: Callable[[Any, Any], Any]
    response: Callable[..., Any]
    loop: Controller
    unstable: Callable[[Any], int]
    starts: np.ndarray
    plan: PlanShape | None = None
    data: Any = ()
    given: tuple[Any, ...] = ()

    def made(self, z: Any) -> Any:
        """Parameters of the controller at a point z (d,) of the cube."""
        return self.build(z, self.data)


def pid_form(small: Reduced, sign: int, wishes: Wishes, rules: Mapping[str, Isa], tracking_time: float | None) -> Form:
    """A PID (a PI where the wishes say so), in K, Ti, Td, set-point weight and filter; the rules are its starts."""
    derivative = wishes.controller != "pi"
    simc = rule_gains("SIMC", small, derivative)
    assert simc is not None
    slow, dead, size = slowest(small), small.first_order[2], abs(simc.K)
    ranges = {
        "K": Parameter((size / 50, size * 30), scale="log"),
        "Ti": Parameter((0.2 * dead, 30.0 * (slow + dead)), scale="log"),
        "b": Parameter((0.0, 1.0)),
    }
    if derivative:
        ranges |= {"Td": Parameter((0.01 * dead, 2.0 * slow), scale="log"), "ratio": Parameter((2.0, 30.0), scale="log")}
    space = Space(ranges)

    loop = slewed(pid_of_limits(wishes.period, wishes.anti_windup), _change(wishes))
    follow = checked(Settings(wishes.period, wishes.lower, wishes.upper, wishes.anti_windup, tracking_time)).follow
    limits = Limits(wishes.lower, wishes.upper, follow)
    starts = np.stack([np.clip(space.cube(_coordinates(isa, space.names)), 0.0, 1.0) for isa in rules.values()])
    name, build, response = "PID" if derivative else "PI", _pid_built(tuple(space.names), tuple(space.log)), _pid_answer(wishes.period)
    return Form(name, space, build, response, loop, lambda _: 0, starts, data=(space.lower, space.upper, float(sign)), given=(limits,))


@lru_cache(maxsize=32)
def _pid_built(names: tuple[str, ...], log: tuple[bool, ...]) -> Callable[[Any, Any], Gains]:
    """Gains at a point of the cube of a space whose bounds are data: (lower, upper, sign)."""
    logarithmic = np.array(log)

    def built(z, data):
        lower, upper, sign = data
        low, high = jnp.log(jnp.where(logarithmic, lower, 1.0)), jnp.log(jnp.where(logarithmic, upper, 1.0))
        v = dict(zip(names, jnp.where(logarithmic, jnp.exp(low + z * (high - low)), lower + z * (upper - lower)), strict=True))
        gain = sign * v["K"]
        td = v.get("Td", 0.0)
        return Gains(gain, gain / v["Ti"], gain * td, v["b"], 0.0, td / v.get("ratio", FILTER))

    return built


@lru_cache(maxsize=32)
def _pid_answer(period: float) -> Callable[..., Any]:
    def response(gains, w, xp=np):
        return pid_response(gains, period, w, xp)

    return response


def _coordinates(isa: Isa, names: Sequence[str]) -> np.ndarray:
    values = {"K": abs(isa.K), "Ti": isa.Ti, "Td": max(isa.Td, 1e-12), "b": isa.b, "ratio": FILTER}
    return np.array([values[n] for n in names])


def isa_of(gains: Gains) -> Isa:
    """The ideal form of parallel gains."""
    return Isa(gains.Kp, gains.Kp / gains.Ki if gains.Ki else math.inf, gains.Kd / gains.Kp if gains.Kp else 0.0, gains.b)


def lqi_form(plant: ServoPlant, small: Reduced, wishes: Wishes) -> Form:
    """An LQ servo on the linearised best fit, in the weight of its input, the loads that its filter expects and the speed of its set
    point; spread evenly, its starts are tried for good regions of the cube, of which there are several."""
    space = _weights(small)

    def built(z, _):
        rho, wander, shaken, seconds = space.physical(z)
        return plant.servo(rho, wander, shaken * wander, seconds)

    def response(parameters: Servo, w, xp=np):
        return servo_response(parameters, wishes.period, w, xp)

    loop = slewed(from_rest(servo(wishes.period, lower=wishes.lower, upper=wishes.upper)), _change(wishes))
    starts = Sobol(space.dimension, np.random.default_rng(1)).random(STARTS)
    return Form("LQI", space, built, response, loop, unstable_poles, starts)


def mpc_form(plant: ServoPlant, small: Reduced, wishes: Wishes, starts: np.ndarray) -> Form:
    """A predictive LQ servo in the same four numbers; `starts` are those of LQ servos, as it is one where no limit acts."""
    space, plan = _weights(small), PlanShape.of(plant, small, wishes)

    def built(z, _):
        rho, wander, shaken, seconds = space.physical(z)
        return plan.predictive(rho, wander, shaken * wander, seconds)

    def response(parameters: Predictive, w, xp=np):
        return servo_response(parameters.servo, wishes.period, w, xp)

    loop = slewed(from_rest(servo_mpc(len(plan.lengths), plan.rated)), _change(wishes))
    return Form("MPC", space, built, response, loop, lambda given: unstable_poles(given.servo), starts, plan)


def _weights(small: Reduced) -> Space:
    """Weight of the input, loads and noise of the input that the filter expects, seconds in which the set point is followed."""
    total = slowest(small) + small.first_order[2]
    return Space({
        "rho": Parameter((1e-3, 1e2), scale="log"),
        "wander": Parameter((0.1, 1e3), scale="log"),
        "shaken": Parameter((0.03, 3.0), scale="log"),  # per wander
        "seconds": Parameter((0.02 * total, 2.0 * total), scale="log"),
    })  # fmt: skip


def _change(wishes: Wishes) -> float:
    """The most that the input moves in a sample."""
    return wishes.rate * wishes.period
