"""Square roots of covariances, P = S S' with S lower triangular, kept through every step of a filter.

Nothing is ever subtracted from a covariance: joint square roots are stacked and made triangular again (array
algorithms: Kailath, Sayed, Hassibi, Linear Estimation (2000), chapter 12). So covariances stay positive semidefinite,
in twice the digits.
"""

from typing import Any

import plantfit.runtime  # noqa: F401

# isort: split
import jax.numpy as jnp
from jax import lax

NOTHING = 1e-14  # share of a row's own length below which what is left of it counts as rounding
LEAST = 1e-100  # variance below which a direction counts as known exactly; its derivatives would overflow
DOUBLINGS = 12  # of the step of process noise: |eigenvalue| x step up to 1000


def triangular(rows: Any) -> Any:
    """Lower triangular L (m, m) with L L' = rows rows' for rows (m, k): modified Gram-Schmidt, row by row."""
    m = rows.shape[0]
    powers = jnp.sum(rows * rows, axis=1)
    columns = []
    for i in range(m):
        unit, length = _unit(rows[0], powers[i])
        below = rows[1:] @ unit
        columns.append(jnp.concatenate([jnp.zeros(i), length[None], below]))
        rows = rows[1:] - below[:, None] * unit[None, :]
    return jnp.stack(columns, axis=1)


def _unit(row: Any, power: Any) -> tuple[Any, Any]:
    """A row over its length, and the length; zeros where hardly anything is left of it."""
    left = jnp.sum(row * row)
    some = left > jnp.maximum(NOTHING**2 * power, LEAST)
    length = jnp.sqrt(jnp.where(some, left, 1.0))
    return jnp.where(some, row / length, 0.0), jnp.where(some, length, 0.0)


def cholesky(matrix: Any) -> Any:
    """Lower triangular L (n, n) with L L' = matrix, positive semidefinite: columns of pivots that are rounding are
    zero."""
    n, own = matrix.shape[0], diagonal(matrix)
    columns = []
    for i in range(n):
        pivot = matrix[i, i]
        some = pivot > jnp.maximum(NOTHING * own[i], LEAST)
        root = jnp.sqrt(jnp.where(some, pivot, 1.0))
        column = jnp.where(some, matrix[:, i] / root, 0.0)
        column = jnp.concatenate([jnp.zeros(i), column[i:]])
        columns.append(column)
        matrix = matrix - column[:, None] * column[None, :]
    return jnp.stack(columns, axis=1)


def diagonal(matrix: Any) -> Any:
    """The diagonal (n,); `jnp.diagonal` would ask for the platform, which native loops do not know."""
    return jnp.stack([matrix[i, i] for i in range(matrix.shape[0])])


def whitened(lower: Any, vector: Any) -> Any:
    """lower^-1 vector (n,); rows with a zero on the diagonal give 0."""
    found: list[Any] = []
    for i in range(vector.shape[0]):
        left = vector[i] - sum((lower[i, j] * found[j] for j in range(i)), jnp.zeros(()))
        found.append(_ratio(left, lower[i, i]))
    return jnp.stack(found)


def _ratio(a: Any, b: Any) -> Any:
    return jnp.where(b > 0.0, a / jnp.where(b > 0.0, b, 1.0), 0.0)


def sampled_noise_root(a: Any, intensity: Any, h: Any) -> Any:
    """Square root (n, n) of what white noise adds to x' = a x over h seconds: the integral of exp(a s)
    diag(intensity^2) exp(a' s).

    By its Taylor series over h / 2^12, then Q(2h) = F(h) Q(h) F(h)' + Q(h): C. Van Loan, IEEE Trans. Automatic Control
    23 (1978) 395, with the exponential as in eq. (1.4) there replaced by doubling, which needs no inverse.
    """
    small = h / 2.0**DOUBLINGS
    term = jnp.diag(intensity**2) * small
    power = jnp.eye(a.shape[0])
    q, f = term, power
    for k in range(1, 5):
        term = (a @ term + term @ a.T) * (small / (k + 1))
        power = a @ power * (small / k)
        q, f = q + term, f + power

    def doubled(_, pair):
        f, q = pair
        return f @ f, f @ q @ f.T + q

    return cholesky(lax.fori_loop(0, DOUBLINGS, doubled, (f, q))[1])
