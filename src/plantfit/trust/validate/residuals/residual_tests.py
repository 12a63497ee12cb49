"""Is anything left in the residuals: autocorrelation, and correlation with the inputs."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # scipy.special is loaded at its first use


@dataclass(frozen=True)
class Correlation:
    """Correlations (k,) at `lags` (samples) and the half-width of their 95 % band under independence."""

    lags: np.ndarray
    values: np.ndarray
    bound: float


MOST_LAGS, POINTS, FEWEST = 100, 500, 150  # of `explained_by_past`
SHORTEST, PAIRS = 4, 10  # samples of a short recording, and neighbours of all, that a test needs
RIDGES = (1e-3, 1e-2, 0.1, 1.0)  # times the mean power of a lag


def autocorrelation(residuals: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelations (lags + 1,) of a series (n,) in which missing samples are NaN."""
    centred = np.nan_to_num(residuals - np.nanmean(residuals))
    n = len(centred)
    size = 1 << int(np.ceil(np.log2(2 * n)))
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    r = np.fft.irfft(spectrum, size)[: lags + 1]
    return r / r[0] if r[0] > 0 else np.r_[1.0, np.zeros(lags)]


def whiteness(residuals: np.ndarray, lags: int | None = None, order: int = 0) -> tuple[Correlation, float]:
    """Autocorrelation and the p-value of Ljung and Box, Biometrika 65 (1978) 297, for what an autoregression of
    `order` left."""
    n = int(np.isfinite(residuals).sum())
    lags = lags or max(1, min(40, n // 5))
    r = autocorrelation(residuals, lags)
    statistic = n * (n + 2) * float(np.sum(r[1:] ** 2 / (n - np.arange(1, lags + 1))))
    return Correlation(np.arange(lags + 1), r, 1.96 / np.sqrt(n)), float(scipy.special.chdtrc(lags - order, statistic))


def short_recordings(series: Sequence[np.ndarray]) -> tuple[float, float] | None:
    """Correlation from one sample to the next of residuals of several short recordings, (n,) each, and the p-value of
    white noise having it or a larger one; None where they have too few samples.

    Each is divided by its RMS. Under white noise the sum of so many products of neighbours has about a normal
    distribution with their number as variance. What a fit takes from the residuals makes it smaller, never larger.
    """
    long = [r for r in series if len(r) >= SHORTEST and np.any(r)]
    pairs = sum(len(r) - 1 for r in long)
    if pairs < PAIRS:
        return None
    total = sum(float(np.sum(r[1:] * r[:-1]) / np.mean(r**2)) for r in long)
    return total / pairs, float(scipy.special.ndtr(-total / np.sqrt(pairs)))


def cross_correlation(residuals: np.ndarray, signal: np.ndarray, lags: int | None = None) -> Correlation:
    """Correlation of residual(t + lag) with signal(t), lags -k..k; positive lags: the past input is not explained.

    Band: 1.96 sqrt(sum r_e r_u / n), the variance of the correlation of two independent
    autocorrelated series (Bartlett, J. R. Stat. Soc. B 8 (1946) 27).
    """
    e = np.nan_to_num(residuals - np.nanmean(residuals))
    u = signal - np.mean(signal)
    n = len(e)
    lags = lags or max(1, min(40, n // 5))
    size = 1 << int(np.ceil(np.log2(2 * n)))
    both = np.fft.irfft(np.fft.rfft(e, size) * np.conj(np.fft.rfft(u, size)), size)
    values = np.r_[both[-lags:], both[: lags + 1]]
    scale = np.sqrt(np.sum(e**2) * np.sum(u**2))
    values = values / scale if scale > 0 else np.zeros(2 * lags + 1)
    far = min(n - 1, 10 * lags)
    joint = autocorrelation(e, far) * autocorrelation(u, far) if scale > 0 else np.r_[1.0, np.zeros(far)]
    spread = max(1.0, float(joint[0] + 2 * joint[1:].sum())) / n
    return Correlation(np.arange(-lags, lags + 1), values, 1.96 * float(np.sqrt(spread)))


def independent(correlation: Correlation) -> bool:
    """No lag beyond the band widened for the number of lags looked at (Sidak, 1 % in all)."""
    return within(correlation.values, correlation.bound, 0.01)


def within(values: np.ndarray, bound: float, level: float) -> bool:
    """Whether all correlations (k,) with a 95 % band of half-width `bound` are within the one that so many of
    independent series leave with probability `level` (Sidak)."""
    wide = -scipy.special.ndtri(0.5 * (1.0 - (1.0 - level) ** (1.0 / len(values)))) / 1.96
    return bool(np.max(np.abs(values)) <= wide * bound)


def explained_by_past(residuals: np.ndarray, signal: np.ndarray) -> float:
    """Share of the residuals' (n,) mean square, NaN where missing, that the past of a signal (n,) foretells in
    stretches left out.

    A linear combination of up to `MOST_LAGS` past values by ridge regression, on at most `POINTS` means of neighbouring
    samples, fifths of the record left out in turn; the best of some weights of the ridge. A lightly damped answer may
    correlate with its input at no single lag. About zero or below where the residual does not follow the signal; NaN
    for records too short.
    """
    width = max(1, -(-len(residuals) // POINTS))
    n = len(residuals) // width
    if n < FEWEST:
        return float("nan")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # means of nothing are missing
        r, u = (
            np.nanmean(np.asarray(v, dtype=float)[: n * width].reshape(n, width), axis=1) for v in (residuals, signal)
        )
    lags = min(MOST_LAGS, n // 4)
    u = np.where(np.isfinite(u), u, np.nanmean(u))
    past = np.lib.stride_tricks.sliding_window_view(u, lags + 1)[:, ::-1]
    r = r[lags:]
    known = np.isfinite(r)
    past, r = past[known] - past[known].mean(axis=0), r[known] - np.mean(r[known])
    folds = np.array_split(np.arange(len(r)), 5)
    size = float(np.sum(past**2)) / (lags + 1)
    left = {w: 0.0 for w in RIDGES}
    for fold in folds:
        rest = np.setdiff1d(np.arange(len(r)), fold)
        a, b = past[rest].T @ past[rest], past[rest].T @ r[rest]
        for w in RIDGES:
            found = np.linalg.solve(a + w * max(size, 1e-300) * np.eye(lags + 1), b)
            left[w] += float(np.sum((r[fold] - past[fold] @ found) ** 2))
    total = float(r @ r)
    return 1.0 - min(left.values()) / total if total > 0 else float("nan")


def measured_rows(residuals: np.ndarray) -> np.ndarray:
    """Places (k,) of the residuals (n,) that follow each other: all of them, or the finite ones where most stand
    between missing ones, as those of a signal with times of its own do."""
    there = np.isfinite(residuals)
    beside = np.sum(there[1:] & there[:-1])
    return np.flatnonzero(there) if beside < 0.5 * there.sum() else np.arange(len(residuals))
