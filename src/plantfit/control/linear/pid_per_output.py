"""Several PID controllers whose commands add up to one input, and gains for them by pole placement."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.signal import place_poles

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.design import Design, Limits, followed, limits_of
from plantfit.control.linear.linear_plant import LinearPlant
from plantfit.control.pid import Gains, pid
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


def pid_per_output(
    plant: LinearPlant,
    period: float,
    poles: Sequence[complex],
    *,
    integral: str | None = None,
    filter_time: float = 0.0,
    limits: Limits = None,
) -> Design:
    """One `pid` for each output of a plant with one input and states that are the outputs and their rates; commands add
    up.

    `poles` (1/s) are those of the continuous loop without filters and sampling: as many as states, and one more where
    the output `integral` is given an integral part. `filter_time` (s) of all derivatives. The parameters are `Gains` by
    output, which may be changed or searched; they differentiate the measurement alone (c = 0), so that no step kicks. A
    reference names outputs; others stay at the equilibrium.

    With u = -K x the gains are [Kp, Kd] = K [C; C A]^-1, and Ki the gain on the integral of the error, added as a
    state. Source: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, sections 7.5 and 7.10 (integral
    control). Raises SimulationError for a plant of another form, or poles that it cannot be given.
    """
    a, b, c = plant.A, plant.B, plant.C
    n, p = len(plant.states), len(plant.outputs)
    if len(plant.inputs) != 1 or n != 2 * p or np.any(plant.D) or np.any(np.abs(c @ b) > 1e-9 * np.abs(b).max()):
        raise SimulationError(
            f"The plant has inputs {list(plant.inputs)}, outputs {list(plant.outputs)} and states "
            f"{list(plant.states)}; "
            "a PID for each output needs one input, and the outputs and their rates as states."
        )
    if integral is not None and integral not in plant.outputs:
        raise SimulationError(f"integral = {integral!r}; name one of the outputs {list(plant.outputs)}.")
    if integral is not None:
        row = c[[plant.outputs.index(integral)]]
        a, b = np.block([[a, np.zeros((n, 1))], [row, np.zeros((1, 1))]]), np.r_[b, [[0.0]]]
    wanted = np.asarray(poles)
    if wanted.shape != (len(a),) or not np.all(np.real(wanted) < 0):
        raise SimulationError(f"poles = {list(poles)}; give {len(a)} with real parts below 0.")
    try:
        placed: Any = place_poles(a, b, wanted)
        k = placed.gain_matrix[0]
    except ValueError as why:
        raise SimulationError(
            f"The poles {list(poles)} cannot be placed: {why}; give different ones, complex ones in pairs."
        ) from why
    both = np.linalg.solve(np.concatenate([c, c @ plant.A]).T, k[:n])
    tail = float(k[n]) if integral is not None else 0.0
    gains = {
        name: Gains(
            float(both[j]), tail if name == integral else 0.0, float(both[p + j]), c=0.0, filter_time=filter_time
        )
        for j, name in enumerate(plant.outputs)
    }
    low, high = limits_of(limits, plant.inputs)
    return Design(_summed(plant, pid(period), float(low[0]), float(high[0])), gains, plant, float(period), (low, high))


def _summed(plant: LinearPlant, part: Controller, lower: float, upper: float) -> Controller:
    def init(measurement, gains):
        return {name: part.init(measurement[name], gains[name]) for name in plant.outputs}

    def update(state, measurement, reference, gains):
        after, wanted = {}, jnp.asarray(float(plant.u0[0]))
        aims = dict(zip(plant.outputs, followed(reference, plant.outputs, plant.y0), strict=True))
        for name in plant.outputs:
            after[name], command = part.update(state[name], measurement[name], aims[name], gains[name])
            wanted = wanted + command
        for name, (last, now) in {name: (state[name], after[name]) for name in plant.outputs}.items():
            # clamping as in `pid`, but by the limits of the sum: parts beyond them may cancel
            added = now.integral - last.integral
            further = ((wanted > upper) & (added > 0)) | ((wanted < lower) & (added < 0))
            after[name] = now._replace(integral=jnp.where(further, last.integral, now.integral))
        return after, {plant.inputs[0]: jnp.clip(wanted, lower, upper)}

    return Controller(init, update)
