"""Long signals for display: the lowest and highest sample of every bin, so that no peak is lost."""

import numpy as np


def envelope(values: np.ndarray, points: int) -> np.ndarray:
    """Indices (k,), k <= points + 2, increasing, of the samples to draw.

    `values` (n,) may hold NaN. Signals with n <= points keep every sample. Longer ones are cut into
    points // 2 bins of nearly equal length and keep the minimum and maximum of each, and the first
    and the last sample. A bin of nothing but NaN keeps one NaN, so that long gaps stay gaps.
    """
    n = len(values)
    if n <= points:
        return np.arange(n)
    edges = np.linspace(0, n, max(1, points // 2) + 1).astype(int)[:-1]
    missing = np.isnan(values)
    bin_of = np.repeat(np.arange(len(edges)), np.diff(np.append(edges, n)))
    lowest = _first(bin_of, np.where(missing, np.inf, values), edges, np.minimum)
    highest = _first(bin_of, np.where(missing, -np.inf, values), edges, np.maximum)
    return np.unique(np.concatenate([[0], lowest, highest, [n - 1]]))


def _first(bin_of: np.ndarray, values: np.ndarray, edges: np.ndarray, extreme: np.ufunc) -> np.ndarray:
    """First index in every bin that holds the bin's extreme value."""
    hits = np.flatnonzero(values == extreme.reduceat(values, edges)[bin_of])
    return hits[np.unique(bin_of[hits], return_index=True)[1]]
