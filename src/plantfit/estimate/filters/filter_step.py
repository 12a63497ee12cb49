"""One step of a Kalman filter on square roots; filters differ only in how they carry a spread through a function."""

from collections.abc import Callable
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.filters.square_root import diagonal, triangular, whitened
from plantfit.estimate.filters.state_space import Constants, Row, StateSpace, jacobian

import jax
import jax.numpy as jnp

# (f, mean, root) -> f's mean, its deviations (out, q), those of x (n, q): covariances are products of deviations
Spread = Callable[[Callable, Any, Any], tuple[Any, Any, Any]]


def linearised(f: Callable, mean: Any, root: Any) -> tuple[Any, Any, Any]:
    """Moments of f(x) by its tangent at the mean (extended Kalman filter); exact for linear f."""
    return f(mean), jacobian(f, mean) @ root, root


def unscented(kappa: float, f: Callable, mean: Any, root: Any) -> tuple[Any, Any, Any]:
    """Moments of f(x) by 2 n + 1 sigma points with weights that are never negative: Julier, Uhlmann, Proc. IEEE 92
    (2004) 401, eq. (12).

    kappa = 0 leaves the centre out: the cubature rule of Arasaratnam, Haykin, IEEE Trans. Automatic Control 54 (2009)
    1254.
    """
    n = mean.shape[0]
    offsets = np.sqrt(n + kappa) * jnp.concatenate([root.T, -root.T])
    weight = 0.5 / (n + kappa)
    values = jax.vmap(f)(mean + offsets)
    centre = f(mean) if kappa > 0 else values[0]
    # about the centre, so that a small spread of large values keeps its digits
    shift = weight * jnp.sum(values - centre, axis=0)
    deviations = np.sqrt(weight) * (values - centre - shift).T
    own = np.sqrt(weight) * offsets.T
    if kappa > 0:
        middle = np.sqrt(kappa / (n + kappa)) * -shift
        deviations = jnp.concatenate([deviations, middle[:, None]], axis=1)
        own = jnp.concatenate([own, jnp.zeros((n, 1))], axis=1)
    return centre + shift, deviations, own


def filter_step(
    plant: StateSpace, spread: Spread, keep: bool, c: Constants, belief: tuple[Any, Any], row: Row
) -> tuple[tuple[Any, Any], dict[str, Any]]:
    """From the belief (mean, root) after the row before to that after this one; beside it what the row told, a dict.

    `keep` adds what the smoother needs: the predicted mean, its deviations and those of the state before; and the root
    of the innovations' covariance, lower triangular (m, m).
    """
    mean, root = belief
    moved, deviations, own = spread(lambda x: plant.transition(c, x, row), mean, root)
    noise = plant.noise_root(c, mean, row)
    predicted = triangular(_beside(deviations, noise))
    told = {"ahead": moved, "deviations": _beside(deviations, noise), "own": own} if keep else {}
    expected, deviations, own = spread(lambda x: plant.outputs(c, x, row), moved, predicted)
    seen = jnp.isfinite(row.y)
    deviations = jnp.where(seen[:, None], deviations, 0.0)
    error = jnp.where(seen, row.y - expected, 0.0)
    m = error.shape[0]
    joint = triangular(
        jnp.concatenate([_beside(deviations, jnp.diag(c.measurement)), _beside(own, jnp.zeros((len(mean), m)))])
    )
    scale = joint[:m, :m]
    white = whitened(scale, error)
    own_scale = diagonal(scale)
    told["log_likelihood"] = -0.5 * jnp.sum(jnp.where(seen, white**2 + jnp.log(2.0 * np.pi * own_scale**2), 0.0))
    if keep:
        told["scale"] = scale
    told |= {"error": error, "white": white, "spread": jnp.sqrt(jnp.sum(scale**2, axis=1))}
    return (moved + joint[m:, :m] @ white, joint[m:, m:]), told


def _beside(a: Any, b: Any) -> Any:
    return jnp.concatenate([a, b], axis=1)
