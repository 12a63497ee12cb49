"""Cascade of two PIDs: the outer one's command is the set point of the inner one, which drives the input."""

from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains, pid_law
from plantfit.simulate.loop.controller import Controller

import jax.numpy as jnp


class Cascade(NamedTuple):
    """Parameters of `cascade`: `outer` in the unit of the inner output, `inner` in that of the input."""

    outer: Gains
    inner: Gains


class Ends(NamedTuple):
    """Limits of the inner set point."""

    lower: Any
    upper: Any


def cascade(period: float, anti_windup: str, outer: str, inner: str) -> Controller:
    """The controller every `period` s; it measures {outer: y, inner: v}; parameters (`Cascade`, input at rest, `Limits`
    of it, `Ends`).

    Commands are counted from the input at rest. The integral of the outer PID rests while its command is at an end or
    the input at a limit and the error drives either further; `anti_windup` is that of the inner one. Source: K. Astrom,
    T. Hagglund, Advanced PID Control (2006), section 12.4 (cascade control, windup in it).
    """
    init_outer, update_outer = pid_law(period, "clamping")
    init_inner, update_inner = pid_law(period, anti_windup)

    def init(measurement, parameters):
        g, rest, _, _ = parameters
        y, v = measurement[outer], measurement[inner]
        first = init_outer(y, g.outer)._replace(integral=v - g.outer.Kp * (g.outer.b - 1.0) * y)
        return first, init_inner(v, g.inner)._replace(integral=rest - g.inner.Kp * (g.inner.b - 1.0) * v)

    def update(state, measurement, reference, parameters):
        g, rest, limits, ends = parameters
        first, wanted = update_outer(state[0], measurement[outer], reference, g.outer, *ends, 0.0)
        second, command = update_inner(state[1], measurement[inner], wanted, g.inner, *limits)
        added = (first.integral - state[0].integral) * jnp.sign(g.inner.Kp)
        further = ((command >= limits.upper) & (added > 0)) | ((command <= limits.lower) & (added < 0))
        first = first._replace(integral=jnp.where(further, state[0].integral, first.integral))
        return (first, second), command - rest

    return Controller(init, update)


def cascade_response(outer: Any, inner: Any, xp: Any = np) -> Any:
    """C(e^(jwh)) (2, F) from the errors of both outputs to the input, of the responses (F,) of both PIDs."""
    return xp.stack([inner * outer, inner])
