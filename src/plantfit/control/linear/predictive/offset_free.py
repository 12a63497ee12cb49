"""Model-predictive control of outputs, without offset, through dead time: for plants that differ from their linear
model."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.dead_time import with_dead_time
from plantfit.control.linear.design import Design, Limits, limits_of, named, stacked, weight
from plantfit.control.linear.kalman import sampled_noise
from plantfit.control.linear.linear_plant import LinearPlant, by_name, discretised
from plantfit.control.linear.predictive.mpc import condensed
from plantfit.control.linear.predictive.quadratic import Prepared, Split, prepared, solved
from plantfit.control.linear.riccati import filter_gain, regulator_gain
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


class Tracking(NamedTuple):
    """Parameters of the controller: the filter on z = (x - x0, past inputs - u0, w), the target for a level, the
    plan."""

    F: Any  # (nz, nz)
    G: Any  # (nz, m)
    H: Any  # (p, nz)
    gain: Any  # (nz, p), of the innovation
    target: Any  # (n + m, p): states and total input that rest at a level
    task: Prepared
    free: Any  # (horizon m, n + past): plan where no limit acts
    low: Any  # (m,)
    high: Any
    x0: Any
    u0: Any
    y0: Any


def offset_free_mpc(
    plant: LinearPlant,
    period: float,
    Q: Any,
    R: Any,
    *,
    limits: Limits,
    dead_time: float = 0.0,
    longest_delay: float | None = None,
    disturbance: Any,
    measurement: Any,
    process: Any = 0.0,
    horizon: int = 20,
    hold: int = 1,
    steps: int = 15,
) -> Design:
    """The controller that brings every output of a continuous `plant` to its level, one input for each output, limits
    respected.

    The plant's model is x' = A x + B (u(t - dead_time) + w): w is a load at the input that wanders by `disturbance`
    (unit of the input per sqrt s), estimated by a Kalman filter with the states, so that at rest the level is met
    whatever the gain of the true plant. Least sum over `horizon` moves of `hold` samples of (y - r)' Q (y - r) + (u -
    u_r)' R (u - u_r), u_r the input that rests at r with the w of now. A larger R or a smaller `disturbance` makes a
    slower controller, which bears more difference. `process` and `measurement` as in `kalman_observer`. Designs of one
    `longest_delay` (s) have parameters of one shape, so that one loop runs them all.

    In its loop the reference is a level, or levels by output. Source: G. Pannocchia, J. Rawlings, AIChE J. 49 (2003)
    426, with the disturbance at the input; dead time: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., section
    2.3. Raises SimulationError.
    """
    for name, value in (("horizon", horizon), ("hold", hold), ("steps", steps)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise SimulationError(f"{name} = {value!r}; give a whole number of at least 1.")
    n, m, p = len(plant.states), len(plant.inputs), len(plant.outputs)
    if m != p or np.any(plant.D):
        raise SimulationError(
            f"The plant has {m} inputs and {p} outputs{' or D' if m == p else ''}; "
            "give one input for each output, D = 0."
        )
    late = with_dead_time(plant, period, dead_time, longest_delay)
    size, sampled = late.A.shape[0], discretised(plant, period)
    F = np.block([[late.A, np.r_[sampled.B, np.zeros((size - n, m))]], [np.zeros((m, size)), np.eye(m)]])
    G, H = np.r_[late.B, np.zeros((m, m))], np.c_[late.C, np.zeros((p, m))]
    # past inputs are known: the filter is that of the states and the load alone
    kept = np.r_[0:n, size : size + m]
    drive = np.block([[plant.A, plant.B], [np.zeros((m, n + m))]])
    wander = np.r_[by_name("process", plant.states, process), by_name("disturbance", plant.inputs, disturbance)]
    noise, seen = sampled_noise(drive, np.diag(wander**2), period), by_name("measurement", plant.outputs, measurement)
    if not (np.all(seen > 0) and np.all(wander >= 0)):
        raise SimulationError(
            f"measurement = {measurement}, disturbance = {disturbance}, process = {process}; give standard deviations."
        )
    own = filter_gain(F[np.ix_(kept, kept)], H[:, kept], noise, np.diag(seen**2))
    rest = np.block([[sampled.A - np.eye(n), sampled.B], [plant.C, np.zeros((p, m))]])
    if own is None or np.linalg.matrix_rank(rest) < n + m:
        raise SimulationError(
            f"The outputs {list(plant.outputs)} do not tell a load at the inputs "
            f"{list(plant.inputs)} from the states, or no input holds them at another "
            "level; choose outputs that the inputs move, and disturbance above 0."
        )
    gain = np.zeros((size + m, p))
    gain[kept] = own
    q, r = late.C.T @ weight("Q", Q, plant.outputs, False) @ late.C, weight("R", R, plant.inputs, True)
    slow = _held(late, hold)
    solution = regulator_gain(slow.A, slow.B, q, r)
    if solution is None:
        raise SimulationError(
            f"No regulator exists for the inputs {list(plant.inputs)} and these weights; weigh every output."
        )
    free, moved = condensed(slow, solution[0], horizon, [])
    low, high = limits_of(limits, plant.inputs)
    task = prepared(np.kron(np.eye(horizon), r + slow.B.T @ solution[1] @ slow.B), moved)
    matrices = (F, G, H, gain, np.linalg.inv(rest)[:, n:], free, low, high, plant.x0, plant.u0, plant.y0)
    F_, G_, H_, gain_, target, free_, *ends = (jnp.asarray(a, dtype=float) for a in matrices)
    parameters = Tracking(F_, G_, H_, gain_, target, task, free_, *ends)
    return Design(_tracking(plant.outputs, plant.inputs, n, steps), parameters, plant, float(period))


def _held(plant: LinearPlant, samples: int) -> LinearPlant:
    """A discrete plant seen every `samples` samples, its inputs held between."""
    a, b = np.eye(len(plant.A)), np.zeros_like(plant.B)
    for _ in range(samples):
        b, a = plant.A @ b + plant.B, plant.A @ a
    period = None if plant.period is None else samples * plant.period
    return LinearPlant(
        a,
        b,
        plant.C,
        plant.D,
        plant.states,
        plant.inputs,
        plant.outputs,
        plant.x0,
        plant.u0,
        plant.y0,
        plant.units,
        period,
    )


@lru_cache(maxsize=32)  # one identity per kind, so that loops compile once
def _tracking(outputs: tuple[str, ...], inputs: tuple[str, ...], n: int, steps: int) -> Controller:
    m = len(inputs)

    def init(measurement, parameters):
        """At rest at the first measurement, without load, by the input that the model says."""
        s = parameters.target @ (stacked(measurement, outputs) - parameters.y0)
        past = (parameters.F.shape[0] - n - m) // m
        none = jnp.zeros(parameters.free.shape[0])
        return jnp.concatenate([s[:n], jnp.tile(s[n:], past), jnp.zeros(m)]), Split(none, none)

    def update(state, measurement, reference, parameters):
        z, last = state
        y, level = stacked(measurement, outputs), stacked(reference, outputs)
        z = z + parameters.gain @ (y - parameters.y0 - parameters.H @ z)
        s = parameters.target @ (level - parameters.y0)
        rest = s[n:] - z[-m:]
        past = (z.shape[0] - n - m) // m
        off = z[:-m] - jnp.concatenate([s[:n], jnp.tile(rest, past)])
        moves = parameters.free.shape[0] // m
        free = parameters.free @ off
        low, high = parameters.low - parameters.u0 - rest, parameters.high - parameters.u0 - rest
        split = solved(parameters.task, free, jnp.tile(low, moves), jnp.tile(high, moves), last, steps)
        du = jnp.clip(free[:m] + split.moved[:m], low, high) + rest
        return (parameters.F @ z + parameters.G @ du, split), named(parameters.u0 + du, inputs)

    return Controller(init, update)
