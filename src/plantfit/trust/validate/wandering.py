"""Whether what a model leaves wanders by itself: a random walk beside noise, in which nothing follows the inputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from scipy.special import fdtrc

from plantfit.trust.validate.residuals.residual_tests import whiteness

FEWEST = 150  # samples
BLOCKS, SLOW = 10, 0.6  # of a record, and the share of the residual's variance that their means have to hold
LARGE = 0.5  # of the residual's mean square that the walk has to account for
LAGS = 20  # samples, over which innovations have to be white
SINGULAR = 1e-7  # of the largest singular value: directions that nothing shows
MEMORIES = (0.0, 3.0, 10.0, 30.0, 100.0)  # samples: how slowly an answer to an input may die out
HUGE = 1e100
ALONE = 0.01  # chance that innovations follow an input by chance, and that they are not white


@dataclass(frozen=True)
class Wandering:
    """A residual as a random walk with independent `steps` a sample (standard deviation) beside white `noise`; it
    `explains` this share of the mean square of the residual."""

    steps: float
    noise: float
    explains: float

    @property
    def gain(self) -> float:
        """The share of an innovation by which the level moves: q = gain^2/(1 - gain), q = (steps/noise)^2."""
        if self.noise == 0:
            return 1.0
        q = (self.steps / self.noise) ** 2
        return float((np.sqrt(q * q + 4.0 * q) - q) / 2.0)

    def moves(self, samples: float) -> float:
        """Standard deviation of what the walk moves by in so many samples."""
        return self.steps * float(np.sqrt(samples))


@dataclass(frozen=True)
class Left:
    """What a fit leaves of a recording: `residuals` (n,), evenly sampled, NaN where missing, their derivatives by
    the parameters (n, k) at the fit, and the `inputs`, each (n,)."""

    residuals: np.ndarray
    derivatives: np.ndarray
    inputs: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Whitened:
    """`innovations` (m,) once the parameters have `moved` (k,) to what suits them best: their values less this.
    `known` (m, r) is an orthonormal base of the derivatives of innovations by the parameters and the levels at the
    begin; `spread` (k,) are the standard errors of the parameters where innovations have variance 1, infinite for
    those that an unseen direction changes."""

    gain: float
    innovations: np.ndarray
    known: np.ndarray
    moved: np.ndarray
    spread: np.ndarray

    @property
    def square(self) -> float:
        """Sum of squares."""
        return float(self.innovations @ self.innovations)

    @property
    def variance(self) -> float:
        """Of the innovations."""
        return self.square / max(len(self.innovations) - self.known.shape[1], 1)

    @property
    def standard_errors(self) -> np.ndarray:
        """Of the parameters (k,)."""
        return self.spread * float(np.sqrt(self.variance))


def usable(left: Sequence[Left]) -> list[Left]:
    """The recordings that are long enough, gaps filled by straight lines."""
    return [_filled(one) for one in left if np.isfinite(one.residuals).sum() >= FEWEST]


def whitened(left: Sequence[Left], gain: float | None = None) -> Whitened:
    """Innovations of a walk in what a fit leaves of `usable` recordings, with the parameters of the plant moved along
    their derivatives.

    A local level model (random walk and white noise, in its innovations form an ARIMA(0, 1, 1); Harvey, Forecasting,
    Structural Time Series Models and the Kalman Filter, 1989, section 4.1.2) by least squares of the innovations; the
    `gain` is found unless it is given.
    """
    if gain is None:
        gain = float(minimize_scalar(lambda g: whitened(left, g).square, bounds=(1e-3, 1.0), method="bounded").x)
    v = np.concatenate([_foretold(one.residuals, gain) for one in left])
    a = np.concatenate([_foretold(one.derivatives, gain) for one in left])
    k, a = a.shape[1], np.hstack([a, _begun([len(one.residuals) - 1 for one in left], gain)])
    size = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    q, s, right = np.linalg.svd(a / size, full_matrices=False)
    shown = s > SINGULAR * s[0]
    q, inverse = q[:, shown], right[shown].T / s[shown]
    told = q.T @ v
    spread = np.where(np.sum(right[~shown] ** 2, axis=0) > SINGULAR, np.inf, np.linalg.norm(inverse, axis=1)) / size
    return Whitened(gain, v - q @ told, q, (inverse @ told / size)[:k], spread[:k])


def wandering(left: Sequence[Left], best: Whitened) -> Wandering | None:
    """The walk that `whitened` found; None where what is left is no such thing.

    It has to account for half of the mean square, and the means of tenths of a record for 0.6 of the variance (noise
    with a short memory does not wander); its innovations have to be white, and must not follow the changes of an input
    or of its square, as an error of the model would, with a memory of up to 100 samples.
    """
    apart = [one.residuals - one.derivatives @ best.moved for one in left]
    if max(float(np.max(np.abs(r))) for r in apart) > HUGE:
        return None  # a parameter that hardly acts would have to move without end
    explained = 1.0 - best.variance / float(np.mean(np.concatenate(apart) ** 2))
    if explained < LARGE or _slow(apart) < SLOW:
        return None
    series = np.split(best.innovations, np.cumsum([len(r) - 1 for r in apart])[:-1])
    white = min(whiteness(v, LAGS, 1)[1] for v in series) * len(series) >= ALONE  # Bonferroni
    if not white or _follows(best, [one.inputs for one in left]):
        return None
    size = float(np.sqrt(best.variance))
    return Wandering(best.gain * size, float(np.sqrt(max(1.0 - best.gain, 0.0))) * size, explained)


def _begun(lengths: Sequence[int], gain: float) -> np.ndarray:
    """How innovations answer to the level before the first sample of each recording, which nobody knows."""
    found = np.zeros((sum(lengths), len(lengths)))
    for k, (n, end) in enumerate(zip(lengths, np.cumsum(lengths), strict=True)):
        found[end - n : end, k] = (1.0 - gain) ** np.arange(n)
    return found


def _foretold(x: np.ndarray, gain: float) -> np.ndarray:
    return lfilter([1.0, -1.0], [1.0, gain - 1.0], x, axis=0, zi=-x[:1])[0][1:]


def _filled(one: Left) -> Left:
    r = one.residuals
    at, good = np.arange(len(r)), np.isfinite(r)
    columns = (
        np.column_stack([np.interp(at, at[good], c[good]) for c in one.derivatives.T])
        if one.derivatives.shape[1]
        else one.derivatives
    )
    return Left(np.interp(at, at[good], r[good]), columns, one.inputs)


def _slow(residuals: Sequence[np.ndarray]) -> float:
    between = [float(np.mean([np.mean(b) ** 2 for b in np.array_split(r - r.mean(), BLOCKS)])) for r in residuals]
    return float(np.sum(between) / max(np.sum([np.var(r) for r in residuals]), 1e-300))


def _follows(best: Whitened, inputs: Sequence[Mapping[str, np.ndarray]]) -> bool:
    """Whether innovations follow the changes of an input or its square, filtered by lags of some memories."""
    if not inputs[0]:
        return False
    a = np.concatenate([np.column_stack([c for u in own.values() for c in answers(u)])[1:] for own in inputs])
    return followed(best.innovations, best.known, a) < ALONE


def followed(left: np.ndarray, known: np.ndarray, told: np.ndarray) -> float:
    """The chance (F test) with which residuals (n,) follow columns `told` (n, q) as they do, beside an orthonormal
    base `known` (n, k) that they do not have any more."""
    a = told - known @ (known.T @ told)
    size = np.linalg.norm(a, axis=0)
    a = a[:, size > 1e-9 * np.max(np.linalg.norm(told, axis=0), initial=0.0)]
    if not a.shape[1]:
        return 1.0
    q, s, _ = np.linalg.svd(a / np.linalg.norm(a, axis=0), full_matrices=False)
    q = q[:, s > 1e-6 * s[0]]
    square, k, n = float(np.sum((q.T @ left) ** 2)), q.shape[1], len(a) - known.shape[1]
    return float(fdtrc(k, n - k, square / k / (float(left @ left) - square) * (n - k))) if n > k else 1.0


def answers(u: np.ndarray) -> list[np.ndarray]:
    """How an output that the model lacks may answer to an input (n,): its changes and those of its square, dying out
    over some memories."""
    found = []
    for w in (u, (u - np.mean(u)) ** 2):
        step = np.r_[0.0, np.diff(w)]
        found += [lfilter([1.0], [1.0, -np.exp(-1.0 / m) if m else 0.0], step) for m in MEMORIES]
    return found
