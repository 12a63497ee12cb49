"""The steps of `steppers` on rows of numpy arrays, for what is computed a few times only: only the rate of a model is
compiled.

A `Rates` evaluates the rate f (B, n), its Jacobian (B, n, n) and its change by the inputs (df/du) du (B, n) for B rows
of states (B, n), inputs (B, m) and parameters. The same methods as those of `steppers`, to rounding.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.kept_programs import Kept, described
from plantfit.simulate.steps.steppers import GAMMA
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp


class Rates:
    """The rate of a model for rows; compiled once for each number of rows."""

    def __init__(self, vector: VectorModel):
        def rate(x, u, p):
            return jnp.stack([jnp.asarray(v, dtype=float) for v in vector.rate(tuple(x), tuple(u), p)])

        def all_of(x, u, du, p):
            f, by_input = jax.jvp(lambda u: rate(x, u, p), (u,), (du,))
            return f, jax.jacfwd(rate)(x, u, p), by_input

        description = described(vector.model)
        self._all = Kept(jax.vmap(all_of), "rates with slopes", description)
        self._rate = Kept(jax.vmap(rate), "rates", description)

    def linear(self, x: np.ndarray, u: np.ndarray, du: np.ndarray, p: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rate, Jacobian, and the change of the rate by that of the inputs."""
        f, jacobian, by_input = self._all(x, u, du, p)
        return np.asarray(f), np.asarray(jacobian), np.asarray(by_input)

    def rate(self, x: np.ndarray, u: np.ndarray, p: Any) -> np.ndarray:
        """The rate alone."""
        return np.asarray(self._rate(x, u, p))


def exponential(rates: Rates, x: np.ndarray, u0: np.ndarray, u1: np.ndarray, h: np.ndarray, p: Any) -> np.ndarray:
    """States (B, n) after steps of h (B,) s, as `exponential.exponential`."""
    f, jacobian, d = rates.linear(x, u0, u1 - u0, p)
    z = h[:, None, None] * jacobian
    right = f + 0.5 * d - _times(z, f + d) / 6.0
    return x + h[:, None] * _solved(np.eye(x.shape[1]) - 2.0 / 3.0 * z + z @ z / 6.0, right)


def rosenbrock(rates: Rates, x: np.ndarray, u0: np.ndarray, u1: np.ndarray, h: np.ndarray, p: Any) -> np.ndarray:
    """As `steppers.rosenbrock`."""
    f, jacobian, d = rates.linear(x, u0, u1 - u0, p)
    matrix, d, step = np.eye(x.shape[1]) - GAMMA * h[:, None, None] * jacobian, GAMMA * d, h[:, None]
    k1 = _solved(matrix, f + d)
    k2 = _solved(matrix, rates.rate(x + step * k1, u1, p) - 2.0 * k1 - d)
    return x + step * (1.5 * k1 + 0.5 * k2)


def rk4(rates: Rates, x: np.ndarray, u0: np.ndarray, u1: np.ndarray, h: np.ndarray, p: Any) -> np.ndarray:
    """As `steppers.rk4`."""
    middle, step = 0.5 * (u0 + u1), h[:, None]
    k1 = rates.rate(x, u0, p)
    k2 = rates.rate(x + 0.5 * step * k1, middle, p)
    k3 = rates.rate(x + 0.5 * step * k2, middle, p)
    k4 = rates.rate(x + step * k3, u1, p)
    return x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def propagator(jacobian: np.ndarray, h: np.ndarray) -> np.ndarray:
    """exp(h J) (B, n, n) of steps, as (1 + z/3) / (1 - 2z/3 + z^2/6): how a small change of the state goes on."""
    z, one = h[:, None, None] * jacobian, np.eye(jacobian.shape[-1])
    return _inverse(one - 2.0 / 3.0 * z + z @ z / 6.0, one + z / 3.0)


def _times(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.einsum("bij,bj->bi", a, x)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    return _inverse(matrix, right[..., None])[..., 0]


def _inverse(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions of rows; NaN where a matrix is singular or not finite, which leaves the other rows alone."""
    good = np.all(np.isfinite(matrix), axis=(1, 2))
    try:
        return np.where(
            good[:, None, None],
            np.linalg.solve(np.where(good[:, None, None], matrix, np.eye(matrix.shape[1])), right),
            np.nan,
        )
    except np.linalg.LinAlgError:
        return np.stack(
            [_one(a, b) for a, b in zip(matrix, np.broadcast_to(right, (len(matrix), *right.shape[-2:])), strict=True)]
        )


def _one(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.nan)


Step = Callable[[Rates, np.ndarray, np.ndarray, np.ndarray, np.ndarray, Any], np.ndarray]

__all__ = ["Rates", "Step", "propagator"]
