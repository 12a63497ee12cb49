"""How much more a sum of squares may grow where other parameters stand near their physical limits."""

from itertools import chain, combinations

import numpy as np

DRAWS = 8000  # of which the quantile is good to 2 %
MOST = 3  # parameters near their limits that are looked at, the nearest ones
LEVEL = 0.95
ALONG = 0.3  # correlation below which another parameter's limit does not matter


def limit_factors(
    spread: np.ndarray, least: np.ndarray, most: np.ndarray, quantile: float, widest: float
) -> np.ndarray:
    """Factors (d,) of the thresholds of a likelihood ratio: 1 where no other parameter is near its limit, up to about
    1.4.

    `spread` (d, d) is the covariance of the values without limits, `least` and `most` (d,) how far the limits are. A
    parameter that is 0 in truth and may not be negative is found at 0 in half of all records. The ratio for another one
    that goes along with it is then no chi-squared variable but a mixture (Self and Liang, J. Am. Statist. Assoc. 82
    (1987) 605), whose 95 % quantile is drawn here with the truth at those limits that are within `quantile` standard
    errors. Errors above `widest` mean no limit is near.
    """
    d, error = len(least), np.sqrt(np.maximum(np.diag(spread), 1e-300))
    room = np.minimum(-least, most) / error
    near = [int(k) for k in np.argsort(room, kind="stable") if room[k] <= quantile and error[k] <= widest]
    result = np.ones(d)
    for i in range(d):
        others = [k for k in near if k != i and abs(spread[i, k]) > ALONG * error[i] * error[k]][:MOST]
        if others and error[i] <= widest:
            at = [i, *others]
            inwards = np.array([1.0, *(1.0 if -least[k] <= most[k] else -1.0 for k in others)]) / error[at]
            result[i] = _factor(spread[np.ix_(at, at)] * np.outer(inwards, inwards))
    return result


def _factor(c: np.ndarray) -> float:
    """The quantile of the ratio for the first of m values with covariance c (m, m), the others at least 0, over that
    without limits."""
    values, vectors = np.linalg.eigh(c)
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    y = np.random.default_rng(1).standard_normal((DRAWS, len(c))) @ root.T
    c = root @ root.T
    ratio = _least(y, c, (0,)) - _least(y, c, ())
    return max(1.0, float(np.quantile(ratio, LEVEL) / np.quantile(y[:, 0] ** 2 / c[0, 0], LEVEL)))


def _least(y: np.ndarray, c: np.ndarray, held: tuple[int, ...]) -> np.ndarray:
    """The least squared distance (n,) from y (n, m) to what has 0 at `held` and at least 0 elsewhere but at the
    first, face by face."""
    rest = range(1, c.shape[0])
    best = np.full(len(y), np.inf)
    for face in chain.from_iterable(combinations(rest, k) for k in range(len(rest) + 1)):
        at = [*held, *face]
        if not at:
            best = np.where(np.all(y[:, 1:] >= 0.0, axis=1), 0.0, best)
            continue
        pulled = np.linalg.solve(c[np.ix_(at, at)], y[:, at].T)
        there = y - (c[:, at] @ pulled).T
        inside = np.all((there >= -1e-12) | np.isin(np.arange(len(c)), at) | (np.arange(len(c)) == 0), axis=1)
        best = np.where(inside, np.minimum(best, np.sum(y[:, at].T * pulled, axis=0)), best)
    return best
