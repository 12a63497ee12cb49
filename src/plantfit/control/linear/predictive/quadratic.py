"""Quadratic programs with limits, solved inside compiled loops: a fixed number of steps of a method that converges.

    least 1/2 v' W v  with  low <= T v + s <= high

Rows may be soft: leaving their limits by d then costs 1/2 weight d^2. Alternating direction method of multipliers,
which converges for every rho > 0 and relaxation in (0, 2): J. Eckstein, D. Bertsekas, Math. Programming 55 (1992) 293,
theorem 8; rho by E. Ghadimi, A. Teixeira, I. Shames, M. Johansson, IEEE Trans. Automatic Control 60 (2015) 644, theorem
4.
"""

from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401

import jax.numpy as jnp
from jax import lax

RELAXATION = 1.6


class Prepared(NamedTuple):
    """What the iteration needs of W, T and the soft rows: arrays."""

    project: Any  # (rows, rows): T (W + rho T'T)^-1 rho T'
    yielding: Any  # (rows,): share of an excess that is given back, 1 for hard rows


class Split(NamedTuple):
    """Where an iteration ended, and one for another s may begin: rows inside their limits less s, scaled multipliers,
    (rows,) each.

    Zeros are the answer where no limit acts.
    """

    moved: Any
    multipliers: Any


def prepared(w: Any, t: Any, soft: Any = None) -> Prepared:
    """For W (n, n) positive definite and T (rows, n); `soft` (rows,) are weights, inf for hard rows (all if left
    out). jax-traceable."""
    xp: Any = np if isinstance(w, np.ndarray) and isinstance(t, np.ndarray) else jnp
    spread = xp.linalg.eigvalsh(t @ xp.linalg.solve(w, t.T))
    least = xp.min(xp.where(spread > 1e-12 * spread[-1], spread, spread[-1]))
    rho = 1.0 / xp.sqrt(least * spread[-1])
    project = t @ xp.linalg.solve(w + rho * t.T @ t, rho * t.T)
    weights = np.full(len(t), np.inf) if soft is None else np.asarray(soft, dtype=float)
    return Prepared(jnp.asarray(project), jnp.asarray(1.0 / (1.0 + rho / weights)))


def solved(task: Prepared, s: Any, low: Any, high: Any, begin: Split, steps: int) -> Split:
    """`steps` iterations from `begin` for the offsets s and limits (rows,); T v + s is s + `moved`."""

    def step(_, at):
        free = task.project @ (at.moved - at.multipliers)
        eased = RELAXATION * free + (1.0 - RELAXATION) * at.moved + at.multipliers
        moved = eased + task.yielding * (jnp.clip(eased, low - s, high - s) - eased)
        return Split(moved, eased - moved)

    return lax.fori_loop(0, steps, step, begin)
