"""Is one model's error on unseen samples less than another's: paired losses, with a variance that allows for their
correlation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import special

from plantfit.problem.measure.long_run import inflation

COSINES = 0.4  # times n^(2/3): those averaged at most (Lazarus and others, eq. 4)
SLOW = 0.2  # times n over the correlation time: of those above, correlation would show
FEW, FEWEST = 12, 5  # cosines below which the inputs are taken as they are, and nothing is claimed
ENOUGH = 10  # cosines of the noise from which on that is done, and FEW where there are as many
EQUAL = 0.005  # of an RMSE: what the accuracy of a simulation leaves open (`plantfit check --verify`)


@dataclass(frozen=True)
class Difference:
    """RMSE of the second less that of the first: `value`, its 95 % interval value -+ `half_width` (NaN where there
    are too few `degrees` of freedom), p-value. `over` what it holds: "stretches" of such data, or the "noise" of
    these samples alone. `told`: the interval, corrected for the pairs compared, leaves out zero, and the difference
    is over EQUAL."""

    value: float
    half_width: float
    p: float
    degrees: int
    samples: int
    correlation: float
    over: Literal["stretches", "noise"]
    told: bool


def paired_difference(first: Sequence[np.ndarray], second: Sequence[np.ndarray], pairs: int = 1) -> Difference:
    """The difference of two models' RMSE from errors by recording (outputs, n), NaN where nothing is compared; the
    second's is the larger.

    With squared errors a_k and b_k and their means a and b, sample k moves the difference of the roots by (b_k - b)/(2
    sqrt b) - (a_k - a)/(2 sqrt a) (Diebold and Mariano, J. Business and Economic Statistics 13 (1995) 253). The
    variance of the mean of that series is the average of its squared products with the first B cosines over the
    samples, and Student's t with B degrees of freedom gives the interval, which is right for few samples and correlated
    losses where a normal distribution, or blocks, tell alike models apart too often (Lazarus, Lewis, Stock and Watson,
    J. Business and Economic Statistics 36 (2018) 541, eqs. 9 and 10). B falls with the correlation time of the series,
    the factor by which correlation inflates the variance of its mean. With several models the level is shared by all
    `pairs` (Bonferroni).

    Where that leaves under FEW cosines, as with a model that drifts away or a few large steps of the input, the inputs
    are taken as they are: errors e and e + d differ by the known d, and e^2 and (e + d)^2 by d^2 + 2 d e, of which only
    2 d e is moved by noise. Where that is fast enough for ENOUGH cosines, and its mean no more than noise makes it,
    which is not so where the first model lacks what the second has, the interval is that over the noise of these
    samples.

    Where nothing is fast enough, a model is still told where its error is so much the larger that a few numbers, or a
    single one, would hardly ever be: the ratio of two mean squares (`_at_worst`).
    """
    pieces = [_paired(a, b) for a, b in zip(first, second, strict=True)]
    pieces = [p for p in pieces if len(p)]
    if not pieces:
        return Difference(np.nan, np.nan, 1.0, 0, 0, 1.0, "stretches", False)
    both = np.vstack(pieces)
    a, b = both[:, 0].mean(), both[:, 1].mean()
    value = float(np.sqrt(b) - np.sqrt(a))
    if not np.isfinite(b):
        return Difference(
            value, np.nan, 0.0 if np.isfinite(a) else 1.0, 0, len(both), 1.0, "stretches", bool(np.isfinite(a))
        )
    if min(a, b) <= 0:
        return Difference(value, 0.0, 0.0, 0, len(both), 1.0, "stretches", bool(b > 0))
    series = [(p[:, 1] - b) / (2 * np.sqrt(b)) - (p[:, 0] - a) / (2 * np.sqrt(a)) for p in pieces]
    over: Literal["stretches", "noise"] = "stretches"
    degrees, memory = _degrees(series)
    half, error = _half_width(series, degrees, pairs)
    if degrees < min(FEW, _most(len(both))):
        known = both[:, 2].mean() / (2 * np.sqrt(b))
        noise = [p[:, 2] / (2 * np.sqrt(b)) - known for p in pieces]
        fast, own = _degrees(noise)
        reach, spread = _half_width(noise, fast, pairs)
        if fast >= max(ENOUGH, min(FEW, _most(len(both)))) and abs(known) <= reach:
            half, error, degrees, memory, over = reach, spread, fast, own, "noise"
    if degrees < FEWEST:
        worth = [max(1, _degrees([p[:, k] for p in pieces])[0]) for k in (0, 1)]
        half, p = _at_worst(a, b, (worth[0], worth[1]), pairs)
        if value > half:
            return Difference(
                value,
                half,
                p,
                max(1, degrees),
                len(both),
                memory,
                "noise",
                not equal(float(np.sqrt(a)), float(np.sqrt(b))),
            )
        return Difference(value, np.nan, 1.0, degrees, len(both), memory, over, False)
    p = min(1.0, pairs * 2.0 * float(special.stdtr(degrees, -abs(value) / error))) if error > 0 else 1.0
    told = abs(value) > half and not equal(float(np.sqrt(a)), float(np.sqrt(b)))
    return Difference(value, half, p, degrees, len(both), memory, over, bool(told))


def _at_worst(a: float, b: float, worth: tuple[int, int], pairs: int) -> tuple[float, float]:
    """Half the interval of a difference of RMSE, and its p-value, if the errors of the models are worth so few
    independent numbers: the ratio b/a of the mean squares of equally good models then has the distribution F, and
    either may be the better one."""
    own, other = worth
    most = float(special.fdtri(other, own, 1.0 - 0.025 / pairs))
    return float(np.sqrt(a) * (np.sqrt(most) - 1.0)), min(1.0, pairs * 2.0 * float(special.fdtrc(other, own, b / a)))


def _half_width(series: Sequence[np.ndarray], degrees: int, pairs: int) -> tuple[float, float]:
    """Half the 95 % interval of the mean of a series by recording, and its standard error."""
    if degrees < 1:
        return np.nan, np.nan
    error = _error(np.concatenate(series), degrees)
    return float(special.stdtrit(degrees, 1.0 - 0.025 / pairs)) * error, error


def _degrees(series: Sequence[np.ndarray]) -> tuple[int, float]:
    """How many cosines a series by recording is averaged over, and its correlation time in samples."""
    memory, count = _memory(series), sum(map(len, series))
    slow = SLOW * count / np.sqrt(memory**2 - 1.0) if memory > 1.0 else np.inf
    return min(_most(count), int(min(slow, count))), memory


def _most(count: int) -> int:
    """Cosines for a series of so many samples that is not slow."""
    return int(COSINES * count ** (2.0 / 3.0))


def _error(series: np.ndarray, degrees: int) -> float:
    """Standard error of the mean of a series (n,) by that many cosines."""
    n = len(series)
    cosines = np.cos(np.pi / n * np.outer(np.arange(1, degrees + 1), np.arange(n) + 0.5))
    return float(np.sqrt(2.0 * np.mean((cosines @ series) ** 2)) / n)


def _paired(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Means over the outputs (m, 3) of e_a^2, e_b^2 and 2 (e_b - e_a) e_a at the samples that both have."""
    a, b = np.atleast_2d(first), np.atleast_2d(second)
    known = ~(np.isnan(a) | np.isnan(b))
    with np.errstate(invalid="ignore", over="ignore"):
        terms = np.stack([a**2, b**2, 2.0 * (b - a) * a])
    count = known.sum(axis=0)
    return (np.where(known, terms, 0.0).sum(axis=1)[:, count > 0] / count[count > 0]).T


def equal(first: float, second: float) -> bool:
    """Whether two RMSE are the same as far as simulations are exact."""
    return abs(first - second) <= EQUAL * min(first, second)


def _memory(series: Sequence[np.ndarray]) -> float:
    """Correlation time in samples, over recordings by their power."""
    centre = float(np.mean(np.concatenate(series)))
    powers = [float(np.sum((s - centre) ** 2)) for s in series]
    if sum(powers) <= 0:
        return 1.0
    # a mean is taken off, which hides correlation
    factors = [inflation(s - centre, np.arange(len(s)), 1) for s in series]
    return float(np.dot(powers, factors) / sum(powers))
