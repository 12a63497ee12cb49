"""A PID whose gains are interpolated between levels of its measurement."""

from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.simulate.loop.controller import Controller

import jax
import jax.numpy as jnp


class Schedule(NamedTuple):
    """`levels` (m,), ascending, in the unit of the output, and the `gains` (m,) there."""

    levels: Any
    gains: Gains

    def at(self, level: Any) -> Gains:
        """The gains at a level: between two on the straight line, beyond the ends those of the end. jax-traceable."""
        return jax.tree.map(lambda g: jnp.interp(level, self.levels, g), self.gains)


class ScheduledState(NamedTuple):
    """Proportional and integral part together, filtered derivative part, last error, measurement and reference."""

    held: Any
    derivative: Any
    error: Any
    measurement: Any
    reference: Any


def scheduled_pid(period: float, anti_windup: str) -> Controller:
    """The controller every `period` s; parameters (`Schedule`, input at rest, `Limits` of the input), commands counted
    from that input.

        held += Kp (b (r - r_last) - (y - y_last)) + Ki period / 2 (e + e_last),  gains at the level y

    With gains that do not change it is `control.pid`. Gains multiply changes alone, so that none of them moves the
    input at rest, and near every level the loop is the linear one of the gains there (velocity form: D. Leith, W.
    Leithead, Int. J. Control 73 (2000) 1001).
    """

    def init(measurement, parameters):
        _, rest, _ = parameters
        zero = jnp.zeros_like(measurement)
        return ScheduledState(zero + rest, zero, zero, measurement, measurement)

    def update(state, measurement, reference, parameters):
        schedule, rest, limits = parameters
        g = schedule.at(measurement)
        error, moved, asked = reference - measurement, measurement - state.measurement, reference - state.reference
        added = (0.5 * period) * g.Ki * (error + state.error)
        before = state.held + g.Kp * (g.b * asked - moved)
        derivative = (g.filter_time * state.derivative + g.Kd * (g.c * asked - moved)) * (
            1.0 / (g.filter_time + period)
        )
        held = before + added
        wanted = held + derivative
        command = jnp.clip(wanted, limits.lower, limits.upper)
        if anti_windup == "clamping":
            further = ((wanted > limits.upper) & (added > 0)) | ((wanted < limits.lower) & (added < 0))
            held = jnp.where(further, before, held)
        elif anti_windup == "back-calculation":
            held = held + limits.follow * (command - wanted)
        return ScheduledState(held, derivative, error, measurement, reference), command - rest

    return Controller(init, update)
