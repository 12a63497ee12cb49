"""The discrete Riccati equation inside compiled code: for searches that solve it for every candidate."""

from typing import Any

import plantfit.runtime  # noqa: F401

import jax.numpy as jnp
from jax import lax

DOUBLINGS = 30  # a mode that takes 1e9 samples has settled


def doubled(a: Any, b: Any, q: Any, r: Any) -> tuple[Any, Any]:
    """Gain K (m, n) and cost-to-go P (n, n) for x+ = a x + b u, u = -K x, least sum of x'q x + u'r u; jax-traceable.

    Structure-preserving doubling: step k has summed the costs of 2^k samples. Source: E. Chu, H. Fan, W. Lin, C. Wang,
    Int. J. Control 77 (2004) 767, algorithm SDA. Where no gain holds the plant the result does not hold it either, or
    is NaN.
    """
    eye = jnp.eye(a.shape[-1])

    def step(_, at):
        a, g, h = at
        both = jnp.linalg.solve(eye + g @ h, jnp.concatenate([a, g], axis=1))
        n = a.shape[-1]
        moved, spread = both[:, :n], both[:, n:]
        return a @ moved, g + a @ spread @ a.T, h + a.T @ h @ moved

    p = lax.fori_loop(0, DOUBLINGS, step, (a, b @ jnp.linalg.solve(r, b.T), q))[2]
    p = 0.5 * (p + p.T)
    return jnp.linalg.solve(r + b.T @ p @ b, b.T @ p @ a), p
