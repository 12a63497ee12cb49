"""Small linear least squares within bounds, of any rank: min |r + A (s - at)| over 0 <= s <= 1.

Active set by P. B. Stark, R. L. Parker, Computational Statistics 10 (1995) 129, begun from the unbounded answer.
Columns are brought to length 1 and singular values below `RANK` of the largest dropped; what these leave open stays
where it is, or goes to the middle of the box where no bound is met.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # scipy.linalg is loaded at its first use

import plantfit.runtime  # noqa: F401

RANK = 1e-12
PLAIN = 1e-4  # smallest diagonal of a triangle, as a share of the largest, that needs no look at singular values
ROUNDING = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Orthogonal:
    """A = U [S V'; 0] D: U (k, k) orthogonal, of which the first `rank` columns span those of A (k, p)."""

    u: np.ndarray
    s: np.ndarray  # (rank,)
    v: np.ndarray  # (p, rank)
    scale: np.ndarray  # (p,)

    @classmethod
    def of(cls, columns: np.ndarray) -> "Orthogonal":
        """Raises LinAlgError for entries that are not finite."""
        length = np.sqrt(np.sum(columns**2, axis=0))
        scale = np.where(length > 0, length, 1.0)
        u, s, vt = np.linalg.svd(columns / scale, full_matrices=True)
        rank = int(np.sum(s > RANK * s[0])) if len(s) and s[0] > 0 else 0
        return cls(u, s[:rank], vt[:rank].T, scale)

    @property
    def rank(self) -> int:
        return len(self.s)

    def step(self, r: np.ndarray) -> np.ndarray:
        """The shortest d (p,), in columns of length 1, with |r + A d| least."""
        return -(self.v @ ((self.u[:, : self.rank].T @ r) / self.s)) / self.scale

    def open(self, d: np.ndarray) -> np.ndarray:
        """The part of d (p,) that A does not see."""
        scaled = d * self.scale
        return (scaled - self.v @ (self.v.T @ scaled)) / self.scale

    def below(self, rows: np.ndarray) -> np.ndarray:
        """What of rows (k, ...) is orthogonal to A: (k - rank, ...), of the same length."""
        return self.u[:, self.rank :].T @ rows

    def forced(self, products: np.ndarray) -> np.ndarray:
        """(A^+)' m for m (p, n), in the coordinates of the first columns of U: (rank, n)."""
        return (self.v.T @ (products / self.scale[:, None])) / self.s[:, None]


class Within(NamedTuple):
    """An answer s (p,), which of it are free (p,), the others are at a bound, and s - at (p,) with the digits that s
    has no room for."""

    s: np.ndarray
    free: np.ndarray
    step: np.ndarray


def solve_within(columns: np.ndarray, r: np.ndarray, at: np.ndarray) -> Within:
    """The least squares answer for A (k, p), r (k,) and `at` (p,) inside the bounds."""
    p = len(at)
    every = Orthogonal.of(columns)
    whole = every.step(r)
    if every.rank < p:
        whole = whole + every.open(0.5 - at - whole)
    s = at + whole
    if np.all((s >= 0.0) & (s <= 1.0)):
        return Within(s, np.ones(p, dtype=bool), whole)
    return _active(columns, r, at, s)


def _active(columns: np.ndarray, r: np.ndarray, at: np.ndarray, outside: np.ndarray) -> Within:
    p, length = len(at), np.sqrt(np.sum(columns**2, axis=0))
    s, free = np.clip(outside, 0.0, 1.0), (outside > 0.0) & (outside < 1.0)
    allowed = np.ones(p, dtype=bool)  # to leave their bound
    noise = ROUNDING * (np.sqrt(np.sum(r**2)) + np.sum(length * np.abs(s - at)))
    for _ in range(10 * p + 20):
        s, free = _inner(columns, r, at, s, free)
        slope = columns.T @ (r + columns @ (s - at))
        # a lower bound holds what wants to sink, an upper one what wants to rise
        pull = np.where(s <= 0.0, -slope, slope) / np.where(length > 0, length, 1.0)
        waiting = ~free & allowed & (pull > noise)
        if not np.any(waiting):
            break
        j = int(np.argmax(np.where(waiting, pull, -np.inf)))
        trial = free.copy()
        trial[j] = True
        step = _step(columns, r, at, s, trial)
        if step[j] * (1.0 if s[j] <= 0.0 else -1.0) <= 0.0:  # rounding alone asked for it
            allowed[j] = False
            continue
        allowed[:] = True
        free = trial
    return Within(s, free, s - at)


def _step(columns: np.ndarray, r: np.ndarray, at: np.ndarray, s: np.ndarray, free: np.ndarray) -> np.ndarray:
    """From s to the best for the free ones (p,)."""
    step = np.zeros(len(s))
    if not np.any(free):
        return step
    some, rest = columns[:, free], r + columns @ (s - at)
    scale = np.sqrt(np.sum(some**2, axis=0))
    if len(some) >= len(scale) and np.all(
        scale > 0
    ):  # far from dependent, a triangle says the same in a tenth of the time
        q, triangle = np.linalg.qr(some / scale)
        diagonal = np.abs(np.diag(triangle))
        if np.min(diagonal) > PLAIN * np.max(diagonal):
            step[free] = -scipy.linalg.solve_triangular(triangle, q.T @ rest, check_finite=False) / scale
            return step
    step[free] = Orthogonal.of(some).step(rest)
    return step


def _inner(
    columns: np.ndarray, r: np.ndarray, at: np.ndarray, s: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The best for the free ones; those that meet a bound on the way stay there."""
    free = free.copy()
    while True:
        step = _step(columns, r, at, s, free)
        after = s + step
        out = free & ((after < 0.0) | (after > 1.0))
        if not np.any(out):
            return np.where(free, after, s), free
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(out, np.where(step < 0, s / -step, (1.0 - s) / step), np.inf)
        first = float(np.min(share))
        s = np.where(free, np.clip(s + first * step, 0.0, 1.0), s)
        met = out & (share <= first)
        s[met] = np.where(step[met] < 0, 0.0, 1.0)
        free &= ~met
