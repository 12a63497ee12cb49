"""Is a filter as sure as it should be: chi-squared tests of its innovations (NIS) and, where the truth is known, its
errors (NEES).

Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), section 5.4.2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from plantfit.errors import RecordingError, SpaceError
from plantfit.estimate.filters.beliefs import Beliefs, FilterRun

LEVEL = 0.95


@dataclass(frozen=True)
class Consistency:
    """A mean of normalised squares against the bounds that hold it in 95 % of all cases, and what its place says."""

    mean: float
    low: float
    high: float
    p_value: float
    consistent: bool
    sentence: str


def nis_test(run: FilterRun, start: float = -np.inf) -> Consistency:
    """Whether the innovations from time `start` (s) on are as large as the filter expects; they are independent if it
    is right.

    Raises RecordingError where nothing was measured.
    """
    chosen = (run.t >= start) & (run.measured > 0)
    if not np.any(chosen):
        raise RecordingError("No sample was measured from that time on; choose an earlier start.")
    return chi_squared_test(run.nis[chosen], run.measured[chosen], "innovations")


def nees(beliefs: Beliefs, truth: Mapping[str, Any]) -> np.ndarray:
    """Normalised estimation error squared (N,) of the states and parameters named in `truth`, arrays (N,) or numbers in
    their units.

    Chi-squared with len(truth) degrees at each time over many runs; along one run its values depend on each other.
    """
    states, names = tuple(beliefs.plant.model.states), (*beliefs.plant.model.states, *beliefs.parameters)
    wrong = [n for n in truth if n not in names]
    if wrong:
        raise SpaceError(f"There is no {wrong[0]!r} to compare; there are {list(names)}.")
    chosen = [names.index(n) for n in truth]
    own = beliefs.mean.copy()
    for name, value in truth.items():
        i = names.index(name)
        if i >= len(states):
            every = np.asarray(beliefs.plant.physical(own[-1, len(states) :])).copy()
            every[i - len(states)] = float(value)
            value = beliefs.plant.place(every)[i - len(states)]
        own[:, i] = value
    error = (beliefs.mean - own)[:, chosen]
    covariance = beliefs.covariance[:, chosen][:, :, chosen]
    return np.einsum("ki,ki->k", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])


def nees_test(runs: Sequence[np.ndarray], degrees: int) -> Consistency:
    """Whether errors of independent runs, each NEES at one time or (N,), are as large as the filter says.

    Values at different times of a run are not independent: each run counts once, by its mean, whose spread is that
    between runs.
    """
    means = np.array([float(np.mean(r)) for r in runs])
    if len(means) < 5:
        raise RecordingError(f"{len(means)} runs are too few for a test of NEES; simulate at least 5.")
    if all(np.size(r) == 1 for r in runs):
        return chi_squared_test(means, np.full(len(means), degrees), "errors")
    width = float(stats.t.isf(0.5 * (1 - LEVEL), len(means) - 1) * np.std(means, ddof=1) / np.sqrt(len(means)))
    t = (np.mean(means) - degrees) / max(float(np.std(means, ddof=1)) / np.sqrt(len(means)), 1e-300)
    p = float(2 * stats.t.sf(abs(t), len(means) - 1))
    return _judged(float(np.mean(means)), degrees - width, degrees + width, p, degrees, "errors")


def chi_squared_test(values: np.ndarray, degrees: np.ndarray, what: str = "innovations") -> Consistency:
    """Independent chi-squared values (N,) with `degrees` (N,) of freedom: does their sum lie where 95 % of such sums
    do."""
    total, n = float(np.sum(values)), int(np.sum(degrees))
    low, high = stats.chi2.ppf([0.5 * (1 - LEVEL), 0.5 * (1 + LEVEL)], n) / len(values)
    p = float(2 * min(stats.chi2.cdf(total, n), stats.chi2.sf(total, n)))
    return _judged(total / len(values), float(low), float(high), min(p, 1.0), n / len(values), what)


def _judged(mean: float, low: float, high: float, p: float, expected: float, what: str) -> Consistency:
    bounds = f"mean square {mean:.3g}, expected {expected:.3g}, 95 % of the time between {low:.3g} and {high:.3g}"
    if low <= mean <= high:
        sentence = f"The {what} are as large as the filter expects ({bounds})."
    elif mean > high:
        factor = np.sqrt(mean / expected)
        sentence = (
            f"The filter is too sure: its {what} are {factor:.2g} times "
            f"as large as it expects ({bounds}); give it more noise."
        )
    else:
        factor = np.sqrt(expected / max(mean, 1e-300))
        sentence = (
            f"The filter is too careful: it expects {what} {factor:.2g} "
            f"times as large as they are ({bounds}); give it less noise."
        )
    return Consistency(mean, low, high, p, low <= mean <= high, sentence)
