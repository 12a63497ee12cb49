"""Exact steps of linear models: x' = A x + B u + c with inputs held or straight over a step.

Over a step of length h the solution is

    x1 = e^{Ah} x + h phi1(Ah) (B u0 + c) + h phi2(Ah) B (u1 - u0),

with phi1(z) = (e^z - 1) / z and phi2(z) = (e^z - 1 - z) / z^2: M. Hochbruck, A. Ostermann, Acta Numerica 19
(2010) 209, eq. (2.10), with linear inputs. The three functions are blocks of one exponential that holds only A and
ones, so that inputs in large units (pascals, hertz) do not spoil its scaling, and h = 0 is an ordinary value.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.structure import is_linear
from plantfit.simulate.steps.vector import Scalars, VectorModel

import jax
import jax.numpy as jnp

__all__ = ["ExactStep", "advance", "exact_maps", "exact_step", "is_linear"]

SQUARINGS = 60  # enough for norms of Ah up to 1e17
TERMS = 14


class ExactStep(NamedTuple):
    """The matrices of a step, x1 = state x + start u0 + end u1 + constant, with leading axes as `h` had.

    `end` is None when the inputs are held, `start` then carries all of their effect.
    """

    state: Any  # (..., n, n)
    start: Any  # (..., n, m)
    end: Any | None  # (..., n, m)
    constant: Any  # (..., n)


def exact_maps(vector: VectorModel, p: Scalars, h: Any, varying: bool) -> ExactStep:
    """The matrices of steps of length `h` (s), a scalar or an array (...), for scalars `p` of a linear model.

    `varying` says whether inputs are straight lines over a step (first-order hold) or held. One exponential of
    size 2 n (held) or 3 n per distinct `h`; for steps of one length call it once per candidate, outside the scan.
    The model must be linear (`is_linear`); this is not checked here.
    """
    n, m = len(vector.states), len(vector.channels)
    a, b, c = _coefficients(vector, p, n, m)
    h = jnp.asarray(h, dtype=float)
    blocks = 3 if varying else 2
    top = jnp.zeros((n, blocks * n)).at[:, n : 2 * n].set(jnp.eye(n))
    below = jnp.eye((blocks - 1) * n, blocks * n, k=2 * n)
    ah = h[..., None, None] * a
    big = jnp.broadcast_to(jnp.concatenate([top, below]), (*h.shape, blocks * n, blocks * n)).at[..., :n, :n].set(ah)
    exponential = _exponential(big)[..., :n, :]
    state, phi1 = exponential[..., :n], h[..., None, None] * exponential[..., n : 2 * n]
    if not varying:
        return ExactStep(state, phi1 @ b, None, phi1 @ c)
    phi2 = h[..., None, None] * exponential[..., 2 * n :]
    return ExactStep(state, (phi1 - phi2) @ b, phi2 @ b, phi1 @ c)


def advance(maps: ExactStep, x: Scalars, u0: Scalars, u1: Scalars) -> Scalars:
    """The states after one step, as tuples of scalars; `maps` has no leading axes."""

    def row(i):
        total = maps.constant[i]
        pairs = [(maps.state, x), (maps.start, u0)]
        if maps.end is not None:
            pairs.append((maps.end, u1))
        for matrix, values in pairs:
            for j, value in enumerate(values):
                total = total + matrix[i, j] * value
        return total

    return tuple(row(i) for i in range(len(x)))


def exact_step(
    vector: VectorModel, p: Scalars, h: Any, varying: bool
) -> Callable[[Scalars, Scalars, Scalars], Scalars]:
    """`step(x, u0, u1) -> x` of a linear model for one step length `h` (s) and one set of parameters.

    Differentiable in `p`, `h`, the states and the inputs, forward and reverse.
    """
    maps = exact_maps(vector, p, h, varying)
    return lambda x, u0, u1: advance(maps, x, u0, u1)


def _coefficients(vector, p, n, m):
    """A (n, n), B (n, m) and c (n,), read off at the origin."""
    zero = jnp.zeros(())
    x, u = (zero,) * n, (zero,) * m

    def stacked(x, u):
        return jnp.stack(vector.rate(x, u, p))

    a, b = jax.jacfwd(stacked, argnums=(0, 1))(x, u)
    return jnp.stack(a, axis=-1), jnp.stack(b, axis=-1), stacked(x, u)


def _exponential(a):
    """exp of matrices (..., k, k) by scaling, Taylor and squaring: C. Moler, C. Van Loan, SIAM Review 45 (2003) 3,
    method 3.

    Scaled to a norm of 1/4, where 14 terms leave 1e-21. jax's own, with Pade fractions and branches, takes three times
    as long to compile and gives NaN for norms above 1e5.
    """
    norm = jnp.max(jnp.sum(jnp.abs(jax.lax.stop_gradient(a)), axis=-1), axis=-1)[..., None, None]
    times = jnp.ceil(jnp.log2(jnp.maximum(norm, 0.25) / 0.25))
    scaled, one = a * 2.0**-times, jnp.eye(a.shape[-1])
    start = jnp.broadcast_to(one, a.shape)
    series, _ = jax.lax.scan(lambda r, k: (one + scaled @ r / k, None), start, jnp.arange(float(TERMS), 0.0, -1.0))
    return jax.lax.scan(lambda r, k: (jnp.where(k < times, r @ r, r), None), series, jnp.arange(float(SQUARINGS)))[0]
