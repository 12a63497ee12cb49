"""Draws from a density by an ensemble of walkers, which needs values of the density alone and no scale of its own."""

from collections.abc import Callable

import numpy as np

STRETCH = 2.0  # largest factor of a stretch move, the usual choice
ACROSS = 0.1  # of the moves by a difference that go its whole length, from one hill of the density to another
JITTER = 1e-5  # of the spread of the walkers, added so that moves leave their plane


def walked(
    log_density: Callable[[np.ndarray], np.ndarray], starts: np.ndarray, sweeps: int, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Walkers (w, d), w even, after `sweeps` moves of each from `starts` (w, d), and the share of the moves that were accepted.

    Both halves move in turn by the places of the other: half of the moves are stretches (Goodman and Weare, Comm. App. Math. Comp. Sci. 5
    (2010) 65), half are differences of two walkers (ter Braak, Statistics and Computing 16 (2006) 239). `log_density` (n, d) -> (n,) is
    called with w / 2 places at once, minus infinity where there is none.
    """
    x = np.array(starts, dtype=float)
    count, d = x.shape
    halves = np.arange(count // 2), np.arange(count // 2, count)
    height = np.concatenate([log_density(x[half]) for half in halves])
    spread, accepted = np.std(x, axis=0), 0
    for _ in range(sweeps):
        for own, other in (halves, halves[::-1]):
            n = len(own)
            stretch = rng.random(n) < 0.5
            factor = (1.0 + (STRETCH - 1.0) * rng.random(n)) ** 2 / STRETCH
            one = rng.integers(0, n, n)
            two = (one + rng.integers(1, n, n)) % n  # never the same
            length = np.where(rng.random(n) < ACROSS, 1.0, 2.38 / np.sqrt(2.0 * d))
            noise = JITTER * spread * rng.standard_normal((n, d))
            along = x[other[one]] + factor[:, None] * (x[own] - x[other[one]])
            across = x[own] + length[:, None] * (x[other[one]] - x[other[two]]) + noise
            new = np.where(stretch[:, None], along, across)
            found = log_density(new)
            ratio = found - height[own] + np.where(stretch, (d - 1) * np.log(factor), 0.0)
            take = np.log(rng.random(n)) < ratio
            x[own[take]], height[own[take]] = new[take], found[take]
            accepted += int(np.sum(take))
    return x, accepted / max(1, sweeps * count)
