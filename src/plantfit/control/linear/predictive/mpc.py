"""Linear model-predictive control: the least quadratic cost over a horizon, within limits of inputs and states."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.design import Design, Limits, followed, limits_of, named, stacked, weight
from plantfit.control.linear.kalman import Estimator, fitting
from plantfit.control.linear.linear_plant import LinearPlant, by_name, discretised
from plantfit.control.linear.lqr import regulator
from plantfit.control.linear.predictive.quadratic import Prepared, Split, prepared, solved
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


class Prediction(NamedTuple):
    """Rows over the horizon: the inputs of every move, then the limited states after every move, as deviations from
    the reference."""

    task: Prepared
    free: Any  # (rows, n): rows = free (x - x_ref) where no limit acts
    low: Any  # (rows,) of the signals themselves
    high: Any
    inputs: Any  # (rows, m): which input a row is
    states: Any  # (rows, n): which state
    estimator: Estimator


def mpc(
    plant: LinearPlant,
    period: float,
    Q: Any,
    R: Any,
    *,
    limits: Limits,
    horizon: int = 40,
    hold: int = 1,
    state_limits: Mapping[str, tuple[float, float]] | None = None,
    softness: float = 1e4,
    estimator: Estimator | None = None,
    steps: int = 25,
) -> Design:
    """The controller that plans `horizon` moves of `hold` samples each, takes the first, and plans anew every sample.

    Least sum over the moves of (x - x0)' Q (x - x0) + (u - u0)' R (u - u0), and after the last one the cost of the
    `lqr` that has no limits: where none acts the command is that of `lqr` with a period of hold * period. `limits` of
    the inputs are hard; `state_limits` by name are soft, a violation d costs 1/2 softness d^2 a move. The reference of
    now is taken to last. Every sample takes `steps` steps of `control.linear.predictive.quadratic`, which begin where
    those of the last sample ended.

    Source: Rawlings, Mayne, Diehl, Model Predictive Control, 2nd ed., sections 1.3, 2.5 and 8.8 (condensing about the
    regulator, as Rossiter, Kouvaritakis, Rice, Automatica 34 (1998) 65). Q, R, `estimator` and errors as in `lqr`.
    """
    for name, value in (("horizon", horizon), ("hold", hold), ("steps", steps)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise SimulationError(f"{name} = {value!r}; give a whole number of at least 1.")
    if not softness > 0:
        raise SimulationError(f"softness = {softness}; give a weight above 0.")
    slow = discretised(plant, hold * period)
    q, r = weight("Q", Q, plant.states, False), weight("R", R, plant.inputs, True)
    gain, p = regulator(slow, q, r)
    limited = [plant.states.index(name) for name in _known(state_limits, plant)]
    free, moved = condensed(slow, gain, horizon, limited)
    low_u, high_u = limits_of(limits, plant.inputs)
    low_x, high_x = limits_of(state_limits or {}, plant.states)
    m, n, count = len(plant.inputs), len(plant.states), len(limited)
    task = prepared(
        np.kron(np.eye(horizon), r + slow.B.T @ p @ slow.B),
        moved,
        np.r_[np.full(horizon * m, np.inf), np.full(horizon * count, softness)],
    )
    which = np.concatenate(
        [np.tile(np.eye(m + n)[:m], (horizon, 1)), np.tile(np.eye(m + n)[[m + i for i in limited]], (horizon, 1))]
    )
    parameters = Prediction(
        task,
        jnp.asarray(free),
        jnp.asarray(np.concatenate([np.tile(low_u, horizon), np.tile(low_x[limited], horizon)])),
        jnp.asarray(np.concatenate([np.tile(high_u, horizon), np.tile(high_x[limited], horizon)])),
        jnp.asarray(which[:, :m]),
        jnp.asarray(which[:, m:]),
        fitting(plant, period, estimator),
    )
    return Design(_predictive(plant.outputs, plant.inputs, plant.states, steps), parameters, plant, float(period))


def _known(state_limits: Mapping[str, tuple[float, float]] | None, plant: LinearPlant) -> list[str]:
    by_name("state_limits", plant.states, {k: 0.0 for k in state_limits or {}})
    return [name for name in plant.states if name in (state_limits or {})]


def condensed(plant: LinearPlant, gain: np.ndarray, horizon: int, limited: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """(rows, n) and (rows, horizon m): the rows by the first state and by the moves v, with u = -gain x + v."""
    n, m = plant.B.shape
    closed = plant.A - plant.B @ gain
    state, moves = np.eye(n), np.zeros((n, horizon * m))  # x at move k = state x + moves v
    u_free, u_moved, x_free, x_moved = [], [], [], []
    for k in range(horizon):
        own = np.zeros((m, horizon * m))
        own[:, k * m : (k + 1) * m] = np.eye(m)
        u_free.append(-gain @ state)
        u_moved.append(-gain @ moves + own)
        state, moves = closed @ state, closed @ moves + plant.B @ own
        x_free.append(state[limited])
        x_moved.append(moves[limited])
    return np.concatenate(u_free + x_free), np.concatenate(u_moved + x_moved)


def _predictive(outputs: tuple[str, ...], inputs: tuple[str, ...], states: tuple[str, ...], steps: int) -> Controller:
    m = len(inputs)

    def init(measurement, parameters):
        estimator, none = parameters.estimator, jnp.zeros(parameters.low.shape)
        return estimator.begin(stacked(measurement, outputs)), jnp.broadcast_to(estimator.u0, (m,)), Split(none, none)

    def update(state, measurement, reference, parameters):
        x, u, last = state
        estimator = parameters.estimator
        x = estimator.corrected(x, stacked(measurement, outputs), u)
        x_ref, u_ref = (
            followed(reference, states, estimator.x0, inputs),
            followed(reference, inputs, estimator.u0, states),
        )
        origin = parameters.inputs @ u_ref + parameters.states @ x_ref
        free = parameters.free @ (x - x_ref)
        split = solved(parameters.task, free, parameters.low - origin, parameters.high - origin, last, steps)
        u = jnp.clip(free[:m] + split.moved[:m] + u_ref, parameters.low[:m], parameters.high[:m])
        return (estimator.predicted(x, u), u, split), named(u, inputs)

    return Controller(init, update)
