"""A PID or PI as a form of controller."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains, Settings, checked
from plantfit.control.tune.forms.form import Form, change
from plantfit.control.tune.frequency import pid_response
from plantfit.control.tune.loop_scores import Limits, pid_of_limits, slewed
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.rules import FILTER, Isa, rule_gains
from plantfit.control.tune.wishes import Wishes
from plantfit.space import Parameter, Space

import jax.numpy as jnp

# K times what an output follows an input at once: the least that is searched, and where the search begins
AT_ONCE, BEGUN = 0.02, 0.3


def pid_form(
    small: Reduced,
    sign: int,
    wishes: Wishes,
    rules: Mapping[str, Isa],
    tracking_time: float | None,
    at_once: float = 0.0,
) -> Form:
    """A PID (a PI where the wishes say so), in K, Ti, Td, set-point weight and filter; the rules are its starts.

    Of a plant whose output follows its input at once by the gain `at_once`, in the unit of the output per that of the
    input, the rules know nothing: a loop is stable only where K times that is below 1.
    """
    derivative = wishes.controller != "pi"
    simc = rule_gains("SIMC", small, derivative)
    assert simc is not None
    slow, dead, size = slowest(small), small.first_order[2], abs(simc.K)
    # where a plant swings, SIMC of its slow part may be far from what keeps it stable, and the other rules are not
    low = min(size / 50, *(abs(isa.K) / 5 for isa in rules.values() if isa.K))
    own = list(rules.values())
    if at_once * size > BEGUN:
        low = min(low, AT_ONCE / at_once)
        own.append(Isa(BEGUN / at_once, wishes.period, 0.0, 0.0))
    ranges = {
        "K": Parameter((low, size * 30), scale="log"),
        "Ti": Parameter((0.2 * dead, 30.0 * (slow + dead)), scale="log"),
        "b": Parameter((0.0, 1.0)),
    }
    if derivative:
        ranges |= {
            "Td": Parameter((0.01 * dead, 2.0 * slow), scale="log"),
            "ratio": Parameter((2.0, 30.0), scale="log"),
        }
    space = Space(ranges)

    loop = slewed(pid_of_limits(wishes.period, wishes.anti_windup), change(wishes))
    follow = checked(Settings(wishes.period, wishes.lower, wishes.upper, wishes.anti_windup, tracking_time)).follow
    limits = Limits(wishes.lower, wishes.upper, follow)
    starts = np.stack([np.clip(space.cube(_coordinates(isa, space.names)), 0.0, 1.0) for isa in own])
    name, build, response = (
        "PID" if derivative else "PI",
        gains_built(tuple(space.names), tuple(space.log)),
        _pid_answer(wishes.period),
    )
    return Form(
        name,
        space,
        build,
        response,
        loop,
        lambda _: 0,
        starts,
        settled=True,
        data=(space.lower, space.upper, float(sign)),
        given=(limits,),
    )


@lru_cache(maxsize=32)
def gains_built(names: tuple[str, ...], log: tuple[bool, ...]) -> Callable[[Any, Any], Gains]:
    """Gains at a point of the cube of a space whose bounds are data: (lower, upper, sign)."""
    logarithmic = np.array(log)

    def built(z, data):
        lower, upper, sign = data
        low, high = jnp.log(jnp.where(logarithmic, lower, 1.0)), jnp.log(jnp.where(logarithmic, upper, 1.0))
        v = dict(
            zip(
                names, jnp.where(logarithmic, jnp.exp(low + z * (high - low)), lower + z * (upper - lower)), strict=True
            )
        )
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
    return Isa(
        gains.Kp, gains.Kp / gains.Ki if gains.Ki else math.inf, gains.Kd / gains.Kp if gains.Kp else 0.0, gains.b
    )
