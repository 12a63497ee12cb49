"""Information criteria of residuals that are correlated in time."""

from collections.abc import Sequence

import numpy as np

from plantfit.problem.measure.long_run import inflation

NEAR = 2.0  # difference of a criterion up to which a model has as much support (Burnham and Anderson 2002, section 2.6)


def criteria(squares: float, samples: int, effective: float, factor: float) -> tuple[float, float, float]:
    """AIC, AICc and BIC. With K effective parameters and one for the variance, n residuals, the logarithm of whose mean
    square is `squares` (several outputs, each with a variance of its own: the mean of theirs), and the factor c by
    which correlation inflates the variance of a mean, in the candidate that fits best (so that all have the same):

        AIC = n ln(s^2)/c + 2 K,   AICc = AIC + 2 K (K + 1)/(n/c - K - 1),   BIC = n ln(s^2)/c + K ln(n/c)        (1)

    Burnham and Anderson, Model Selection and Multimodel Inference, 2nd ed. 2002, sections 2.5 and 6.4.1; smoothed
    tables count by their effective entries (Hastie, Tibshirani and Friedman, Elements of Statistical Learning, 2nd ed.,
    section 7.6).
    """
    fit, count, rest = samples * squares / factor, effective + 1.0, samples / factor - effective - 2.0
    aic = fit + 2.0 * count
    aicc = aic + 2.0 * count * (count + 1.0) / rest if rest > 0 else float("inf")
    return aic, aicc, fit + count * np.log(samples / factor)


def inflation_of(residuals: Sequence[np.ndarray], index: Sequence[np.ndarray]) -> float:
    """c over several series of residuals (m,) at sample numbers (m,), by their power."""
    powers = [float(np.sum(r**2)) for r in residuals]
    factors = [inflation(r, i) for r, i in zip(residuals, index, strict=True)]
    return float(np.dot(powers, factors) / max(np.sum(powers), 1e-300))
