"""Is one model's error on unseen samples less than another's: paired losses, in blocks longer than their correlation time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from plantfit.problem.measure.long_run import inflation

LONGER = 5.0  # blocks over the correlation time
MOST_BLOCKS, FEW_BLOCKS, FEWEST_BLOCKS = 40, 12, 5
EQUAL = 0.005  # of an RMSE: what the accuracy of a simulation leaves open (`plantfit check --verify`)


@dataclass(frozen=True)
class Difference:
    """RMSE of the second less that of the first: `value`, its 95 % interval value -+ `half_width` (NaN where there are too few `blocks`),
    p-value. `over` what it holds: "stretches" of such data, or the "noise" of these samples alone. `told`: the interval, corrected for the
    pairs compared, leaves out zero, and the difference is over EQUAL."""

    value: float
    half_width: float
    p: float
    blocks: int
    samples: int
    correlation: float
    over: str
    told: bool


def paired_difference(first: Sequence[np.ndarray], second: Sequence[np.ndarray], pairs: int = 1) -> Difference:
    """The difference of two models' RMSE from errors by recording (outputs, n), NaN where nothing is compared; the second's is the larger.

    A recording is cut into blocks of LONGER times the correlation time of the paired differences of the squared errors, the factor by
    which correlation inflates the variance of their mean. With a block's mean squared errors a_k and b_k, and their means a and b over all,
    the difference of the roots moves by (b_k - b)/(2 sqrt b) - (a_k - a)/(2 sqrt a); the scatter of these over the blocks gives the
    standard error, Student's t with blocks - 1 degrees of freedom the interval (Diebold and Mariano, J. Business and Economic Statistics 13
    (1995) 253, by batch means). With several models the level is shared by all `pairs` (Bonferroni).

    Where that leaves under FEW_BLOCKS blocks, as with a model that drifts away or a few large steps of the input, the inputs are taken as
    they are: errors e and e + d differ by the known d, and e^2 and (e + d)^2 by d^2 + 2 d e, of which only 2 d e is moved by noise. It is
    cut into blocks by its own correlation time, and the interval then is that over the noise of these samples.
    """
    pieces = [_paired(a, b) for a, b in zip(first, second, strict=True)]
    pieces = [p for p in pieces if len(p)]
    if not pieces:
        return Difference(np.nan, np.nan, 1.0, 0, 0, 1.0, "stretches", False)
    both = np.vstack(pieces)
    a, b = both[:, 0].mean(), both[:, 1].mean()
    value = float(np.sqrt(b) - np.sqrt(a))
    if not np.isfinite(b):
        return Difference(value, np.nan, 0.0 if np.isfinite(a) else 1.0, 0, len(both), 1.0, "stretches", bool(np.isfinite(a)))
    if min(a, b) <= 0:
        return Difference(value, 0.0, 0.0, 0, len(both), 1.0, "stretches", bool(b > 0))
    blocks, memory = _blocks(pieces, [p[:, 1] - p[:, 0] for p in pieces])
    moves = [(block[:, 1].mean() - b) / (2 * np.sqrt(b)) - (block[:, 0].mean() - a) / (2 * np.sqrt(a)) for block in blocks]
    over = "stretches"
    if len(blocks) < FEW_BLOCKS:
        noisy, own = _blocks(pieces, [p[:, 2] for p in pieces])
        if max(len(noisy), len(blocks)) < FEWEST_BLOCKS:
            return Difference(value, np.nan, 1.0, len(blocks), len(both), memory, over, False)
        if len(noisy) > len(blocks):
            blocks, memory, over = noisy, own, "noise"
            moves = [(block[:, 2].mean() - both[:, 2].mean()) / (2 * np.sqrt(b)) for block in blocks]
    weights, count = np.array([len(block) for block in blocks]) / len(both), len(blocks)
    error = float(np.sqrt(count / (count - 1) * np.sum((weights * np.array(moves)) ** 2)))
    half = float(special.stdtrit(count - 1, 1.0 - 0.025 / pairs)) * error
    p = min(1.0, pairs * 2.0 * float(special.stdtr(count - 1, -abs(value) / error))) if error > 0 else 1.0
    told = abs(value) > half and not equal(float(np.sqrt(a)), float(np.sqrt(b)))
    return Difference(value, half, p, count, len(both), memory, over, bool(told))


def _paired(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Means over the outputs (m, 3) of e_a^2, e_b^2 and 2 (e_b - e_a) e_a at the samples that both have."""
    a, b = np.atleast_2d(first), np.atleast_2d(second)
    known = ~(np.isnan(a) | np.isnan(b))
    with np.errstate(invalid="ignore", over="ignore"):
        terms = np.stack([a**2, b**2, 2.0 * (b - a) * a])
    count = known.sum(axis=0)
    return (np.where(known, terms, 0.0).sum(axis=1)[:, count > 0] / count[count > 0]).T


def _blocks(pieces: Sequence[np.ndarray], series: Sequence[np.ndarray]) -> tuple[list[np.ndarray], float]:
    """The pieces cut into blocks longer than the correlation time of a series, and that time in samples."""
    memory, total = _memory(series), sum(map(len, pieces))
    length = max(LONGER * memory if memory > 1.0 else 1.0, total / MOST_BLOCKS)
    return [part for p in pieces for part in np.array_split(p, max(1, int(len(p) / length)))], memory


def equal(first: float, second: float) -> bool:
    """Whether two RMSE are the same as far as simulations are exact."""
    return abs(first - second) <= EQUAL * min(first, second)


def _memory(series: Sequence[np.ndarray]) -> float:
    """Correlation time in samples, over recordings by their power."""
    centre = float(np.mean(np.concatenate(series)))
    powers = [float(np.sum((s - centre) ** 2)) for s in series]
    if sum(powers) <= 0:
        return 1.0
    factors = [inflation(s - centre, np.arange(len(s))) for s in series]
    return float(np.dot(powers, factors) / sum(powers))
