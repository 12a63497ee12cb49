"""Do estimates of one quantity from several recordings agree: Cochran's Q, with few degrees of freedom as Welch has it,
and Holm's levels.

Cochran, Biometrics 10 (1954) 101; Welch, Biometrika 38 (1951) 330, eq. 28; Holm, Scand. J. Statistics 6 (1979) 65; I^2
of Higgins and Thompson, Statistics in Medicine 21 (2002) 1539; the spread between recordings of Paule and Mandel, J.
Research of the National Bureau of Standards 87 (1982) 377.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

LEVEL = 0.05
POWER = 0.8
NEWTON = 100  # steps at most
HALVINGS = 60  # of the scatter that is looked for


@dataclass(frozen=True)
class Heterogeneity:
    """Estimates (k,) against their weighted mean: Cochran's `q` with `degrees` of freedom, the `p` of Welch's test
    (that of q for standard errors without error), `i_squared`, the share of the scatter that is more than the
    errors', and `between`, the standard deviation between recordings. `mean` with `error` is the estimate of all."""

    mean: float
    error: float
    q: float
    degrees: float
    p: float
    i_squared: float
    between: float


def heterogeneity(values: np.ndarray, errors: np.ndarray, freedom: np.ndarray) -> Heterogeneity:
    """Of estimates (k,) with standard errors (k,) of so many degrees of freedom (k,); k >= 2."""
    weights = 1.0 / np.asarray(errors, dtype=float) ** 2
    total, count = float(weights.sum()), len(weights)
    mean = float(weights @ values) / total
    q, degrees = float(weights @ (values - mean) ** 2), count - 1.0
    # Welch: weights that are themselves estimates make q larger
    lost = float(np.sum((1.0 - weights / total) ** 2 / np.asarray(freedom, dtype=float)))
    f = q / degrees / (1.0 + 2.0 * (count - 2.0) / (count**2 - 1.0) * lost)
    within = (count**2 - 1.0) / (3.0 * lost) if lost > 0 else np.inf
    p = float(special.fdtrc(degrees, within, f)) if within < 1e7 else float(special.chdtrc(degrees, q))
    share = max(0.0, 1.0 - degrees / q) if q > 0 else 0.0
    return Heterogeneity(mean, total**-0.5, q, degrees, p, share, between(values, errors))


def between(values: np.ndarray, errors: np.ndarray) -> float:
    """The standard deviation s between recordings of estimates (k,) with standard errors (k,): that which makes
    Cochran's Q with weights 1 / (errors^2 + s^2) equal to k - 1, its mean; 0 where Q is smaller without it (Paule and
    Mandel).

    Newton's steps of DerSimonian and Kacker, Contemporary Clinical Trials 28 (2007) 105; Q falls and is convex in s^2.
    """
    variance, squares = 0.0, np.asarray(errors, dtype=float) ** 2
    for _ in range(NEWTON):
        weights = 1.0 / (squares + variance)
        away = np.asarray(values, dtype=float) - float(weights @ values) / float(weights.sum())
        excess = float(weights @ away**2) - (len(squares) - 1.0)
        if excess <= 1e-9:
            break
        variance += excess / float(weights**2 @ away**2)
    return variance**0.5


def seen_from(errors: np.ndarray, level: float = LEVEL) -> float:
    """The standard deviation s between recordings that Cochran's Q of estimates with standard errors (k,) tells with a
    chance of `POWER`.

    Of Q its mean and variance are used, which is exact for equal errors (Satterthwaite).
    """
    squares = np.asarray(errors, dtype=float) ** 2
    weights = 1.0 / squares
    away = np.diag(weights) - np.outer(weights, weights) / weights.sum()
    most = float(special.chdtri(len(squares) - 1.0, level))

    def told(s: float) -> float:
        form = away * (squares + s**2)[None, :]
        mean, spread = float(np.trace(form)), 2.0 * float(np.sum(form * form.T))
        return float(special.chdtrc(2.0 * mean**2 / spread, most * 2.0 * mean / spread))

    low, high = 0.0, float(np.sqrt(squares.max()))
    while told(high) < POWER:
        high *= 2.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if told(middle) >= POWER else (middle, high)
    return high


def together(values: np.ndarray, covariances: np.ndarray, freedom: np.ndarray) -> tuple[float, float, float]:
    """Of vectors (k, d) with covariances (k, d, d): the sum of squares about their weighted mean, its degrees of
    freedom, and p.

    By Hotelling's F with the least degrees of freedom of any covariance, which is never too sure.
    """
    count, d = values.shape
    weights = np.array([np.linalg.pinv(c, hermitian=True) for c in covariances])
    mean = np.linalg.solve(weights.sum(axis=0), np.einsum("kij,kj->i", weights, values))
    away = values - mean
    q, degrees = float(np.einsum("ki,kij,kj->", away, weights, away)), float(d * (count - 1))
    least = float(np.min(freedom))
    if least <= d:
        return q, degrees, 1.0
    f = q / degrees * (least - d + 1.0) / least
    return q, degrees, float(special.fdtrc(degrees, least - d + 1.0, f))


def difference(first: tuple[float, float, float], second: tuple[float, float, float]) -> float:
    """The p-value of two estimates (value, standard error, degrees of freedom) being one: Welch's t."""
    (a, s, m), (b, r, n) = first, second
    total = s**2 + r**2
    if total <= 0:
        return 1.0
    freedom = total**2 / (s**4 / m + r**4 / n)
    return 2.0 * float(special.stdtr(freedom, -abs(a - b) / total**0.5))


def holm(p: Mapping[str, float]) -> dict[str, float]:
    """Adjusted p-values: those below a level are told with no more than that chance of any false one."""
    ordered, adjusted, last = sorted(p, key=lambda n: p[n]), {}, 0.0
    for k, name in enumerate(ordered):
        last = max(last, min(1.0, (len(ordered) - k) * p[name]))
        adjusted[name] = last
    return {n: adjusted[n] for n in p}


def pooled(
    values: Sequence[float] | np.ndarray, errors: Sequence[float] | np.ndarray, freedom: Sequence[float] | np.ndarray
) -> tuple[float, float, float]:
    """The weighted mean, its standard error, and its degrees of freedom (Satterthwaite)."""
    v, s, n = (np.asarray(x, dtype=float) for x in (values, errors, freedom))
    weights = 1.0 / s**2
    shares = weights / weights.sum()
    error = float(weights.sum() ** -0.5)
    return float(shares @ v), error, float(1.0 / np.sum(shares**2 / n))
