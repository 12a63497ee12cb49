"""States from measurements: the steady-state Kalman filter of a linear plant, as matrices for a controller."""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.linear_plant import LinearPlant, by_name, discretised
from plantfit.control.linear.riccati import filter_gain
from plantfit.errors import SimulationError

import jax.numpy as jnp


class Estimator(NamedTuple):
    """A filter about (x0, u0, y0), arrays; `begin`, `corrected` and `predicted` run it on states (n,) in their own
    units."""

    A: Any
    B: Any
    C: Any
    D: Any
    gain: Any  # (n, p), of the innovation
    x0: Any
    u0: Any
    y0: Any

    def begin(self, y: Any) -> Any:
        """The state at rest nearest to x0 that is measured as y (p,)."""
        return self.x0 + jnp.linalg.pinv(self.C) @ (y - self.y0)

    def corrected(self, x: Any, y: Any, u: Any) -> Any:
        """The predicted state x (n,) after the measurement y (p,), taken while the input u (m,) acted."""
        return x + self.gain @ (y - self.y0 - self.C @ (x - self.x0) - self.D @ (u - self.u0))

    def predicted(self, x: Any, u: Any) -> Any:
        """The state one sample later with the input u (m,) held."""
        return self.x0 + self.A @ (x - self.x0) + self.B @ (u - self.u0)


def kalman_observer(plant: LinearPlant, period: float, process: Any, measurement: Any) -> Estimator:
    """The steady-state Kalman filter of a continuous plant sampled every `period` seconds.

    `process`: standard deviation by which each state wanders in a second (its unit per sqrt s), white noise on its
    rate; `measurement`: standard deviation of each output's noise, quantum / sqrt 12 for rounding. Numbers for all or
    by name; states not named do not wander, outputs must have noise.

    Source: Anderson, Moore, Optimal Filtering, section 4.4 (eq. 4.4 - 4.6); noise sampled by C. Van Loan, IEEE
    Trans. Automatic Control 23 (1978) 395. Raises SimulationError where the outputs do not show a state that wanders or
    grows.
    """
    sampled = discretised(plant, period)
    rate, seen = by_name("process", plant.states, process), by_name("measurement", plant.outputs, measurement)
    if not (np.all(rate >= 0) and np.any(rate > 0)):
        raise SimulationError(f"process = {process}; give standard deviations of at least 0, one of them above.")
    if not np.all(seen > 0):
        raise SimulationError(
            f"measurement = {measurement}; give a standard deviation above 0 for each of {list(plant.outputs)}."
        )
    q, r = sampled_noise(plant.A, np.diag(rate**2), period), np.diag(seen**2)
    gain = filter_gain(sampled.A, sampled.C, q, r)
    if gain is None:
        raise SimulationError(
            f"No steady Kalman filter exists for the outputs {list(plant.outputs)}: a state that "
            "they do not show grows or wanders freely; measure more, or let other states wander."
        )
    return Estimator(
        *(jnp.asarray(m) for m in (sampled.A, sampled.B, sampled.C, sampled.D, gain, plant.x0, plant.u0, plant.y0))
    )


def sampled_noise(a: np.ndarray, density: np.ndarray, period: float) -> np.ndarray:
    """Covariance (n, n) that white noise of `density` (n, n) on the rates of x' = a x adds over `period` s: Van Loan
    1978, eq. (1.1)."""
    n = len(a)
    big = expm(period * np.block([[-a, density], [np.zeros((n, n)), a.T]]))
    covariance = big[n:, n:].T @ big[:n, n:]
    return 0.5 * (covariance + covariance.T)


def measured_states(plant: LinearPlant, period: float) -> Estimator:
    """The estimator where the outputs are as many as the states and show them all: x = x0 + C^-1 (y - y0).

    Raises SimulationError where they do not: give a `kalman_observer`.
    """
    sampled = discretised(plant, period)
    n = len(plant.states)
    if plant.C.shape[0] != n or np.linalg.matrix_rank(plant.C) < n or np.any(plant.D):
        raise SimulationError(
            f"The outputs {list(plant.outputs)} do not give the states "
            f"{list(plant.states)} at once; give estimator = kalman_observer(...)."
        )
    gain = np.linalg.inv(plant.C)
    return Estimator(
        *(jnp.asarray(m) for m in (sampled.A, sampled.B, sampled.C, sampled.D, gain, plant.x0, plant.u0, plant.y0))
    )


def fitting(plant: LinearPlant, period: float, estimator: Estimator | None) -> Estimator:
    """The estimator itself, or `measured_states` for None; raises SimulationError for one of a plant of another
    size."""
    if estimator is None:
        return measured_states(plant, period)
    sizes = [np.shape(m) for m in (estimator.A, estimator.B, estimator.C)]
    if sizes != [plant.A.shape, plant.B.shape, plant.C.shape]:
        raise SimulationError(
            f"The estimator is for matrices A, B, C of shapes {sizes}, the plant has "
            f"{[plant.A.shape, plant.B.shape, plant.C.shape]}; "
            "make it with kalman_observer for this plant."
        )
    return estimator
