"""A likelihood of residuals whose scale and autoregression are unknown, for white and coloured noise."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.linearised import named_blocks
from plantfit.trust.validate.residuals.residual_tests import whiteness

import jax
import jax.numpy as jnp

MOST_ORDER = 8  # of an autoregression; what needs more is a model error and no noise
LAGS = 20  # of the test of what an autoregression leaves
CHANCE = 1e-3  # p-value below which that is not white
MEMORY = 0.1  # of the longest run: residuals that remember for longer drift
JUMPS = 5.0  # excess kurtosis of the innovations from which on they are no normal noise (100 samples)
UNEVEN = 0.01  # of the sample period: clocks that differ by more have no autoregression


@dataclass(frozen=True)
class OutputNoise:
    """Noise of one output: `rows` (n,) of the residuals, `lagged` (n, order) the rows before each, the p-value of
    what is left being white, and what speaks against noise, as the end of a sentence; nothing where it is noise."""

    output: str
    order: int
    rows: np.ndarray
    lagged: np.ndarray
    p_value: float
    against: str


def noise_of(problem: Problem, residuals: np.ndarray) -> list[OutputNoise]:
    """The autoregression of each output's residuals (m,): the lowest order that leaves white innovations, else the best
    by BIC.

    Recordings share the coefficients of an output. Samples that lie apart in time or follow a gap begin anew.
    """
    return [_of_output(residuals, name, runs, even) for name, runs, even in _runs(problem)]


def _runs(problem: Problem) -> Iterator[tuple[str, list[np.ndarray], bool]]:
    """Of each output its name, runs of row numbers whose samples follow each other, and whether all clocks are even."""
    found: dict[str, list[np.ndarray]] = {}
    even: dict[str, bool] = {}
    for name, output, block in named_blocks(problem):
        steps = np.diff(problem.experiments[name].recording.t)
        regular = bool(len(steps) == 0 or np.max(np.abs(steps - np.median(steps))) <= UNEVEN * np.median(steps))
        rows = np.arange(block.rows.start, block.rows.stop)
        found.setdefault(output, []).extend(np.split(rows, 1 + np.flatnonzero(np.diff(block.index) != 1)))
        even[output] = even.get(output, True) and regular
    yield from ((o, runs, even[o]) for o, runs in found.items())


def _of_output(residuals: np.ndarray, name: str, runs: list[np.ndarray], even: bool) -> OutputNoise:
    found = []
    longest = max(map(len, runs))
    for order in range(MOST_ORDER + 1 if even else 1):
        rows, lagged = _placed(runs, order)
        if len(rows) < 10 * (order + 1):
            break
        X, y = residuals[lagged], residuals[rows]
        phi = np.linalg.lstsq(X, y, rcond=None)[0]
        left = y - X @ phi
        p_value = _p_value(left, runs, order)
        noise = OutputNoise(name, order, rows, lagged, p_value, _against(left, phi, p_value, longest, even))
        if p_value > CHANCE:
            return noise
        found.append(
            (len(rows) * np.log(max(float(left @ left), 1e-300) / len(rows)) + order * np.log(len(rows)), noise)
        )
    if not found:
        return OutputNoise(name, 0, *_placed(runs, 0), 1.0, "are too few")
    return min(found, key=lambda f: f[0])[1]


def _against(left: np.ndarray, phi: np.ndarray, p_value: float, longest: int, even: bool) -> str:
    """What speaks against innovations (n,) of coefficients (order,) being those of noise."""
    if p_value <= CHANCE:
        return (
            "are correlated in a way that no autoregression describes"
            if even
            else "are correlated, and the clock is uneven"
        )
    roots = np.abs(np.roots(np.r_[1.0, -phi])) if len(phi) else np.zeros(1)
    if roots.max(initial=0.0) >= 1.0 or (roots.max(initial=0.0) > 0 and -1.0 / np.log(roots.max()) > MEMORY * longest):
        return "are slower than a tenth of the record"
    centred = left - left.mean()
    if len(left) >= 100 and np.mean(centred**4) > (3.0 + JUMPS) * np.mean(centred**2) ** 2:
        return "jump, or have outliers"
    return ""


def _placed(runs: list[np.ndarray], order: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) with `order` samples before them, and these rows (n, order), the last one first."""
    long = [r for r in runs if len(r) > order] or [np.zeros(order, int)]
    lagged = [np.concatenate([r[order - k : len(r) - k] for r in long]) for k in range(1, order + 1)]
    rows = np.concatenate([r[order:] for r in long])
    return rows, np.stack(lagged, axis=1) if order else np.zeros((len(rows), 0), int)


def _p_value(left: np.ndarray, runs: list[np.ndarray], order: int) -> float:
    """p-value of innovations (n,) being white, runs so far apart that none follows another."""
    lags = min(LAGS, len(left) // 5)
    if lags <= order or not np.any(left):
        return 1.0
    ends = np.cumsum([len(r) - order for r in runs if len(r) > order])[:-1]
    apart = [np.r_[part, np.full(lags, np.nan)] for part in np.split(left, ends)]
    return whiteness(np.concatenate(apart), lags, order)[1]


def log_likelihood(noises: list[OutputNoise], residuals: jax.Array | np.ndarray) -> jax.Array:
    """Log likelihood of residuals (m,), the variance and the coefficients of each output integrated out.

    A flat prior of the coefficients and 1/sigma of the scale leave -(n - p)/2 log S - 1/2 log det X'X, with S the sum
    of squares of the innovations at the best coefficients and X the residuals before (Box, Jenkins and Reinsel, Time
    Series Analysis, 4th ed. 2008, appendix A7.4, given the first p residuals of each run).
    """
    total = jnp.zeros(())
    for noise in noises:
        y, n, p = residuals[noise.rows], len(noise.rows), noise.order
        squares = y @ y
        if p:
            X = residuals[noise.lagged]
            gram, seen = X.T @ X, X.T @ y
            squares = squares - seen @ jnp.linalg.solve(gram, seen)
            total = total - 0.5 * jnp.linalg.slogdet(gram)[1]
        total = total - 0.5 * (n - p) * jnp.log(squares)
    return total
