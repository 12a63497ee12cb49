"""What a filter or smoother believes about states and parameters at every sample."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from plantfit.errors import SpaceError
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.state_space import StateSpace


@dataclass(frozen=True)
class Track:
    """A quantity over time t (N,) in its unit: value, and two standard deviations to either side, (N,) each."""

    name: str
    unit: str | None
    t: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Means (N, n) and square roots (N, n, n) of covariances of states and joint parameters at times t (N,).

    Joint parameters are kept by the coordinate that `StateSpace` says; `track` gives them in their units.
    """

    plant: StateSpace = field(repr=False)
    base: np.ndarray = field(repr=False)
    t: np.ndarray
    mean: np.ndarray
    root: np.ndarray = field(repr=False)

    @property
    def covariance(self) -> np.ndarray:
        """Covariances (N, n, n)."""
        return self.root @ np.swapaxes(self.root, 1, 2)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the joint parameters."""
        return tuple(self.plant.space.names[i] for i in self.plant.joint)

    def track(self, name: str) -> Track:
        """A state or joint parameter with its band of two standard deviations, that of a parameter mapped from its
        coordinate."""
        n, states = self.plant.states, tuple(self.plant.model.states)
        spread = np.sqrt(np.sum(self.root**2, axis=2))
        if name in states:
            i = states.index(name)
            value, sd = self.mean[:, i], spread[:, i]
            return Track(name, self.plant.model.states[name], self.t, value, value - 2 * sd, value + 2 * sd)
        if name not in self.parameters:
            raise SpaceError(
                f"There is no {name!r} to show; there are the states {list(states)} and the parameters "
                f"{list(self.parameters)}."
            )
        j = self.parameters.index(name)
        value, low, high = (
            np.asarray(self.plant.physical(self.mean[:, n:] + k * spread[:, n:]))[:, j] for k in (0, -2, 2)
        )
        return Track(name, self.plant.space.coordinates[self.plant.joint[j]].unit, self.t, value, low, high)

    @property
    def estimate(self) -> Estimate:
        """The joint parameters at the last sample, their covariance carried into their units by the tangent."""
        n = self.plant.states
        s, step = self.mean[-1, n:], 1e-6
        slope = (np.asarray(self.plant.physical(s + step)) - np.asarray(self.plant.physical(s - step))) / (2 * step)
        return Estimate(
            self.parameters, np.asarray(self.plant.physical(s)), self.covariance[-1, n:, n:] * np.outer(slope, slope)
        )

    @property
    def interval(self) -> dict[str, tuple[float, float]]:
        """95 % intervals of the joint parameters at the last sample, symmetric in their coordinates."""
        n, z = self.plant.states, 1.959963984540054
        spread = np.sqrt(np.sum(self.root[-1, n:] ** 2, axis=1))
        low, high = (np.asarray(self.plant.physical(self.mean[-1, n:] + k * spread)) for k in (-z, z))
        return {name: (float(a), float(b)) for name, a, b in zip(self.parameters, low, high, strict=True)}


@dataclass(frozen=True, eq=False)
class FilterRun(Beliefs):
    """Beliefs after each sample's measurement, and what the measurements y (N, m) told.

    `told` and the last two hold every row: samples, at `rank` (N,), and edges of late inputs between them.
    """

    y: np.ndarray = field(repr=False)
    told: Mapping[str, np.ndarray] = field(repr=False)
    rank: np.ndarray = field(repr=False)
    row_mean: np.ndarray = field(repr=False)
    row_root: np.ndarray = field(repr=False)

    @property
    def innovations(self) -> np.ndarray:
        """Measured minus predicted outputs (N, m), NaN where nothing was measured."""
        return np.where(np.isfinite(self.y), self.told["error"][self.rank], np.nan)

    @cached_property
    def nis(self) -> np.ndarray:
        """Normalised innovation squared (N,): chi-squared with as many degrees as outputs were measured, if all is
        well."""
        return np.sum(self.told["white"][self.rank] ** 2, axis=1)

    @cached_property
    def measured(self) -> np.ndarray:
        """How many outputs (N,) were measured at each sample."""
        return np.sum(np.isfinite(self.y), axis=1)

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the probability density of all measurements."""
        return float(np.sum(self.told["log_likelihood"]))


def smoothed(run: FilterRun) -> Beliefs:
    """Beliefs given the whole record: Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445, eqs. (3.30), (3.31), on square
    roots.

    For an unscented run with the gain from its sigma points (Sarkka, IEEE Trans. Automatic Control 53 (2008) 845).
    """
    mean, covariance = run.row_mean.copy(), run.row_root @ np.swapaxes(run.row_root, 1, 2)
    ahead, n = run.told["ahead"], run.row_mean.shape[1]
    # square root of the covariance of (next state, state): gain and what the next state leaves open are its lower
    # blocks
    own = np.concatenate(
        [run.told["own"], np.zeros((*mean.shape, run.told["deviations"].shape[2] - run.told["own"].shape[2]))], axis=2
    )
    joint = np.concatenate([run.told["deviations"], own], axis=1)
    lower = np.swapaxes(np.linalg.qr(np.swapaxes(joint, 1, 2), mode="r"), 1, 2)
    gain = lower[:, n:, :n] @ _inverse(lower[:, :n, :n])
    left = lower[:, n:, n:] @ np.swapaxes(lower[:, n:, n:], 1, 2)
    for k in range(len(mean) - 2, -1, -1):
        g = gain[k + 1]
        mean[k] += g @ (mean[k + 1] - ahead[k + 1])
        covariance[k] = left[k + 1] + g @ covariance[k + 1] @ g.T
    return Beliefs(run.plant, run.base, run.t, mean[run.rank], _roots(covariance[run.rank]))


def _inverse(lower: np.ndarray) -> np.ndarray:
    """Pseudo-inverses of square roots (N, n, n), rows scaled alike, so that a state known exactly takes no part."""
    scale = np.maximum(np.linalg.norm(lower, axis=2), 1e-300)
    return np.linalg.pinv(lower / scale[:, :, None], rcond=1e-13) / scale[:, None, :]


def _roots(covariance: np.ndarray) -> np.ndarray:
    """Symmetric square roots (N, n, n)."""
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 1e-300))
    w, v = np.linalg.eigh(covariance / (scale[:, :, None] * scale[:, None, :]))
    return scale[:, :, None] * (v * np.sqrt(np.maximum(w, 0.0))[:, None, :])
