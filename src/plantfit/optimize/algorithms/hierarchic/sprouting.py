"""Where a tree of populations may grow a new branch: nearest-better clustering and what keeps branches apart."""

from collections.abc import Callable, Iterable

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import gammaincinv


def nearest_better(points: np.ndarray, costs: np.ndarray, share: float, factor: float) -> tuple[np.ndarray, float]:
    """Rows of `points` (n, d) that head a cluster, best first, and the mean distance to a nearest better point.

    Of the best `share` of the points, the heads are the best one and those farther from every better point than
    `factor` times the mean (Preuss 2012, EvoApplications 7248:386, without the rule on incoming edges). Points whose
    cost is not finite are left out; no head comes out when none is left.
    """
    order = np.argsort(costs, kind="stable")
    order = order[: max(1, int(share * len(order)))]
    order = order[np.isfinite(costs[order])]
    if len(order) == 0:
        return order, 0.0
    best = points[order]
    apart = cdist(best, best)
    nearest = np.array([apart[i, :i].min() for i in range(1, len(best))])
    if len(nearest) == 0:
        return order, 0.0
    mean = float(nearest.mean())
    return order[np.concatenate([[True], nearest > factor * mean])], mean


def far_enough(seed: np.ndarray, centres: Iterable[np.ndarray], radius: float) -> bool:
    """Whether no centre (d,) is within `radius` of the seed (d,)."""
    return all(np.linalg.norm(seed - c) > radius for c in centres)


def covered(seed: np.ndarray, mean: np.ndarray, cov: np.ndarray, share: float = 0.95) -> bool:
    """Whether the seed (d,) lies inside the ellipsoid that holds `share` of a normal distribution (mean (d,), cov
    (d, d))."""
    difference = seed - mean
    values, vectors = np.linalg.eigh(cov)
    along = (vectors.T @ difference) ** 2
    return bool(np.sum(along / np.maximum(values, 1e-300)) < 2 * gammaincinv(len(seed) / 2, share))


def spread_around(seed: np.ndarray, points: np.ndarray, count: int) -> float:
    """Root mean variance over the coordinates of the `count` points (n, d) nearest to the seed; 0 for fewer than two
    points."""
    if len(points) < 2:
        return 0.0
    near = points[np.argsort(np.linalg.norm(points - seed, axis=1), kind="stable")[:count]]
    return float(np.sqrt(np.mean(np.var(near, axis=0, ddof=1)))) if len(near) > 1 else 0.0


def same_valley(
    costs: Callable[[np.ndarray], np.ndarray],
    one: np.ndarray,
    one_cost: float,
    two: np.ndarray,
    two_cost: float,
    count: int,
) -> bool:
    """Whether none of `count` points between two (d,) costs more than both: no ridge parts them (Ursem 1999, CEC
    3:1633).

    Points are evaluated one after another, until a ridge shows.
    """
    ridge = max(one_cost, two_cost)
    return all(costs((one + s * (two - one))[None])[0] <= ridge for s in np.linspace(0.0, 1.0, count + 2)[1:-1])
