"""Two estimates of the same parameters: do they differ by more than chance, and where."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from plantfit.errors import SearchError
from plantfit.estimate.estimate import Estimate
from plantfit.problem.measure.long_run import prewhitened_long_run, widening

SURE = 0.01  # p-value below which a difference is called one


@dataclass(frozen=True)
class Comparison:
    """`difference` (k,) = first - second, its covariance, chi-squared (k,) of each with one degree of freedom and
    p-values.

    `statistic` is the chi-squared of all together with `degrees` of freedom and `p_value` its tail. `paired` tells
    whether the covariance is that of the difference itself, from the same samples, or the sum of both covariances.
    """

    names: tuple[str, ...]
    difference: np.ndarray
    covariance: np.ndarray
    chi_squared: np.ndarray
    p_values: np.ndarray
    statistic: float
    degrees: int
    p_value: float
    paired: bool
    sentence: str


def compare_estimates(
    first: Estimate, second: Estimate, labels: tuple[str, str] = ("the first estimate", "the second")
) -> Comparison:
    """Chi-squared tests of the difference of two estimates, parameter by parameter and together (Wald).

    From the same samples, both with influences, the variance of the difference is the long-run variance of the
    difference of the influences, with nothing assumed about which is better; for instrumental variables against least
    squares this is the test of Durbin, Wu and Hausman (Hausman, Econometrica 46 (1978) 1251) with a robust covariance.
    Otherwise the two count as independent. Raises SearchError for different names.
    """
    if first.names != second.names:
        raise SearchError(
            f"Estimates of {list(first.names)} and {list(second.names)} "
            "cannot be compared; estimate the same parameters."
        )
    difference = first.values - second.values
    covariance, paired = _covariance(first, second)
    variance = np.diag(covariance)
    chi = np.where(difference == 0.0, 0.0, difference**2 / np.maximum(variance, 1e-300))
    scale = 1.0 / np.sqrt(np.maximum(variance, 1e-300))
    w, v = np.linalg.eigh(covariance * np.outer(scale, scale))
    seen = w > 1e-8 * w.max()
    statistic = float(np.sum((v[:, seen].T @ (scale * difference)) ** 2 / w[seen]))
    degrees, p_values = int(seen.sum()), np.asarray(stats.chi2.sf(chi, 1))
    p = float(stats.chi2.sf(statistic, degrees)) if degrees else 1.0
    worst = int(np.argmax(chi))
    name, base = first.names[worst], abs(float(second.values[worst]))
    share = f"{float(f'{100.0 * difference[worst] / base:.2g}'):+g} %" if base > 0 else f"{difference[worst]:+.3g}"
    verdict = "differs" if p < SURE else "does not differ"
    said = f"p = {p:.2g}" if p > 0 else "p below 1e-300"
    sentence = (
        f"{labels[0][:1].upper()}{labels[0][1:]} {verdict} from {labels[1]} by more than chance ({said}), "
        f"most in {name}: {share}, {np.sqrt(chi[worst]):.1f} standard errors of the difference."
    )
    return Comparison(first.names, difference, covariance, chi, p_values, statistic, degrees, p, paired, sentence)


def _covariance(first: Estimate, second: Estimate) -> tuple[np.ndarray, bool]:
    a, b = first.influence, second.influence
    if (
        a is None
        or b is None
        or first.index is None
        or second.index is None
        or not np.array_equal(first.index, second.index)
    ):
        return first.covariance + second.covariance, False
    covariance = prewhitened_long_run(a - b, first.index)
    if (
        first.degrees is not None and second.degrees is not None
    ):  # the variance of the difference rests on as few samples
        few = widening(np.minimum(first.degrees, second.degrees))
        covariance = covariance * np.outer(few, few)
    return covariance, True
