"""The cost and its gradient by diffrax: adaptive Kvaerno5, begun at the delayed edge of each opening, recursive
checkpoints."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from benchmarks.data import Steam

try:
    import diffrax
except ImportError:
    diffrax = None
import jax
import jax.numpy as jnp
from jax import Array


@dataclass(frozen=True)
class DiffraxCost:
    """Compiled functions of theta (310,): cost () in bar^2, value and gradient, responses (10, 4500)."""

    cost: Callable[[Array | np.ndarray], Array]
    value_and_gradient: Callable[[Array | np.ndarray], tuple[Array, Array]]
    responses: Callable[[Array | np.ndarray], Array]


def diffrax_cost(steam: Steam, tolerance: float) -> DiffraxCost | None:
    """By Kvaerno5 (Kvaerno3 took longer at equal error) with rtol = atol = `tolerance`; None without diffrax (extra
    `bench`).

    The openings are solved one after the other: together, all would wait for the longest and the most difficult.
    """
    if diffrax is None:
        return None
    kept = ~np.isnan(steam.y)
    target, weight = jnp.asarray(np.where(kept, steam.y, 0.0)), jnp.asarray(kept / steam.samples[:, None])
    t = jnp.asarray(float(steam.period) * np.arange(1, steam.samples.max() + 1))
    ends, inputs = jnp.asarray(float(steam.period) * steam.samples), jnp.asarray(steam.opening)

    def one(opening: tuple[Array, Array, Array]) -> Array:
        row, u, end = opening
        return _response(t, row, u, end, tolerance)

    def responses(theta: Array) -> Array:
        return jax.lax.map(one, (theta.reshape(10, 31), inputs, ends))

    def cost(theta: Array) -> Array:
        return jnp.sum(weight * (responses(theta) - target) ** 2)

    return DiffraxCost(jax.jit(cost), jax.jit(jax.value_and_grad(cost)), jax.jit(responses))


def _response(t: Array, row: Array, u: Array, end: Array, tolerance: float) -> Array:
    """Pressures (samples,) up to `end`, its last value after it; row (31,)."""
    assert diffrax is not None
    delay = row[30]

    def rate(_, x: Array, tables: Array) -> Array:
        place = jnp.clip(x[0] * (9 / 20.0), 0.0, 9.0)
        piece = jnp.minimum(place.astype(int), 8)
        below, above = tables[:, piece], tables[:, piece + 1]
        k, a1, a2 = below + (place - piece) * (above - below)
        return jnp.stack([x[1], (k * u - x[0] - a1 * x[1]) / a2])

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        diffrax.Kvaerno5(),
        delay,
        end,
        0.01,
        jnp.zeros(2),
        row[:30].reshape(3, 10),
        saveat=diffrax.SaveAt(ts=jnp.clip(t, delay, end)),
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        max_steps=8192,
        adjoint=diffrax.RecursiveCheckpointAdjoint(),
    )
    assert solution.ys is not None
    return solution.ys[:, 0]
