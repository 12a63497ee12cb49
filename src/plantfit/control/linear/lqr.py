"""Linear-quadratic regulator: the state feedback of least quadratic cost, on states as a filter estimates them."""

from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.design import Design, Limits, followed, limits_of, named, stacked, weight
from plantfit.control.linear.kalman import Estimator, fitting
from plantfit.control.linear.linear_plant import LinearPlant, discretised
from plantfit.control.linear.riccati import regulator_gain
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


class StateFeedback(NamedTuple):
    """u = u_ref - gain (x - x_ref) clipped to [lower, upper], x from the estimator."""

    gain: Any  # (m, n)
    estimator: Estimator
    lower: Any  # (m,)
    upper: Any


def lqr(
    plant: LinearPlant, period: float, Q: Any, R: Any, *, estimator: Estimator | None = None, limits: Limits = None
) -> Design:
    """The regulator that holds a continuous `plant` at its x0, or follows a reference, sampled every `period` seconds.

    Least sum over the samples of (x - x0)' Q (x - x0) + (u - u0)' R (u - u0). Q (n, n) and R (m, m), or weights
    by name; Bryson's rule takes 1 / (largest deviation to accept)^2. `estimator` gives the states (`kalman_observer`),
    left out where the outputs are the states. Commands are clipped to `limits` = (low, high), or by name, and the
    estimator knows it.

    Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sections 9.2 - 9.4.
    Raises SimulationError for weights that do not fit and for a plant that the inputs cannot hold.
    """
    gain, _ = regulator(
        discretised(plant, period), weight("Q", Q, plant.states, False), weight("R", R, plant.inputs, True)
    )
    chosen = fitting(plant, period, estimator)
    low, high = limits_of(limits, plant.inputs)
    parameters = StateFeedback(jnp.asarray(gain), chosen, jnp.asarray(low), jnp.asarray(high))
    return Design(state_feedback(plant.outputs, plant.inputs, plant.states), parameters, plant, float(period))


def regulator(plant: LinearPlant, q: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain (m, n) and cost-to-go P (n, n) of a discrete plant."""
    found = regulator_gain(plant.A, plant.B, q, r)
    if found is None:
        raise SimulationError(
            f"No regulator exists for the inputs {list(plant.inputs)} and these weights: some state grows "
            "or lasts, and is not moved by the inputs or not weighted; weigh it, or drive more inputs."
        )
    return found


def state_feedback(outputs: tuple[str, ...], inputs: tuple[str, ...], states: tuple[str, ...]) -> Controller:
    """The controller whose parameters are `StateFeedback`."""

    def init(measurement, parameters):
        estimator = parameters.estimator
        return estimator.begin(stacked(measurement, outputs)), jnp.broadcast_to(estimator.u0, (len(inputs),))

    def update(state, measurement, reference, parameters):
        estimator = parameters.estimator
        x = estimator.corrected(state[0], stacked(measurement, outputs), state[1])
        wanted = followed(reference, inputs, estimator.u0, states) - parameters.gain @ (
            x - followed(reference, states, estimator.x0, inputs)
        )
        u = jnp.clip(wanted, parameters.lower, parameters.upper)
        return (estimator.predicted(x, u), u), named(u, inputs)

    return Controller(init, update)
