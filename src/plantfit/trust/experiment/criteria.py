"""What makes one input better than another: small errors of the parameters, or two models told apart. Costs are
logarithms of a mean standard error, so that a difference of 0.1 is one of 10 %."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plantfit.trust.experiment.trial_record import Told, TrialRecord

WIDE = 10.0  # times the width of the bounds: standard deviation of what nothing is known of
KINDS = ("D", "A")


@dataclass(frozen=True, eq=False)
class Precision:
    """Errors of the parameters after a new recording, as `criterion` sums them up over the plants.

    `known` (d, d) is the information that the study's own recordings give, in the parameters' units, 0 where it shall
    not count; `inflation` how many times larger variances are than those of white noise, `unlike` those of errors that
    are only of unlike size. "D": the mean log error of all axes of the ellipsoid; "A": the root of the mean square
    relative error, of `chosen` coordinates (d,) only. (Fedorov, Theory of Optimal Experiments, 1972, section 2.1;
    averaged over the plants: Pronzato and Walter, Math. Biosci. 75 (1985) 103.)
    """

    trial: TrialRecord
    known: np.ndarray
    inflation: float
    criterion: str
    chosen: np.ndarray
    unlike: float = 1.0

    @cached_property
    def shared(self) -> np.ndarray:
        """Numbers (s,) of the coordinates that the new recording shares with the old ones."""
        return self.trial.coordinates[~self.trial.own]

    @cached_property
    def scale(self) -> np.ndarray:
        """Sizes (s,) that errors are divided by: of each value, or of the width of its bounds where that is larger
        than 1000 values."""
        space, values = self.trial.problem.space, np.abs(self.trial.plants[0][self.shared])
        typical = np.array([space.coordinates[i].typical for i in self.shared])
        return np.maximum(np.maximum(values, typical), 1e-3 * (space.upper - space.lower)[self.shared])

    @cached_property
    def known_before(self) -> np.ndarray:
        """Information (s, s) in units of `scale` that is there before the new recording; hardly any of what nothing
        is known of."""
        on = self.shared
        return self.known[np.ix_(on, on)] * np.outer(self.scale, self.scale) + self._hardly

    def information(self, told: Told) -> np.ndarray:
        """Information (K, s, s) in units of `scale` that the new recording gives for each plant, whatever its own
        coordinates are."""
        own, sizes = self.trial.own, self.trial.sizes[self.trial.coordinates]
        unit = np.where(own, np.maximum(np.nan_to_num(np.abs(sizes)), 1e-12), 1.0)
        unit[~own] = self.scale
        effects = told.effects * unit
        full = np.swapaxes(effects, 1, 2) @ effects / self.inflation
        if not np.any(own):
            return full
        inner = full[:, own][:, :, own] + 1e-9 * np.eye(int(own.sum()))
        cross = full[:, ~own][:, :, own]
        return full[:, ~own][:, :, ~own] - cross @ np.linalg.solve(inner, np.swapaxes(cross, 1, 2))

    def covariance(self, told: Told | None, before: bool = True) -> np.ndarray:
        """Covariance (K, s, s) in units of `scale` with a recording (None: without), and with or without what was
        known before."""
        base = self.known_before if before else self._hardly
        return np.linalg.inv(base[None] + (0.0 if told is None else self.information(told)))

    @cached_property
    def _hardly(self) -> np.ndarray:
        """Information (s, s) of bounds alone, so that nothing is singular."""
        space, on = self.trial.problem.space, self.shared
        return np.diag((WIDE * (space.upper - space.lower)[on] / self.scale) ** -2.0)

    def cost(self, told: Told) -> float:
        """Mean over the plants of the log of the mean error."""
        if not told.finite:
            return np.inf
        total = self.known_before[None] + self.information(told)
        if self.criterion == "D":
            sign, log_det = np.linalg.slogdet(total)
            return float(np.mean(np.where(sign > 0, -0.5 * log_det / len(self.shared), np.inf)))
        variances = np.diagonal(np.linalg.inv(total), axis1=1, axis2=2)[:, self.chosen[self.shared]]
        with np.errstate(all="ignore"):
            return float(np.nan_to_num(np.mean(0.5 * np.log(np.mean(variances, axis=1))), nan=np.inf))


@dataclass(frozen=True, eq=False)
class Difference:
    """How far apart two models foretell a new recording, over what noise and their own parameters leave open.

    The squared distance is d'C^-1 d of the difference d of the outputs, where C is the mean of the covariances that the
    two models foretell, of noise and of what their own parameters leave open (Box and Hill, Technometrics 9 (1967) 57,
    with the covariance of Bhattacharyya's distance). The cost is minus its log.
    """

    one: Precision
    other: Precision

    def distance(self, told: Told, other: Told) -> float:
        """The distance of the two models' means, in standard deviations."""
        if not (told.finite and other.finite):
            return 0.0
        d = told.course[0] - other.course[0]
        columns = np.hstack([_open(self.one, told), _open(self.other, other)]) / np.sqrt(2.0)
        inflation = max(self.one.inflation, self.other.inflation)
        d, columns = d / np.sqrt(inflation), columns / np.sqrt(inflation)
        seen = columns.T @ d
        left = np.linalg.solve(np.eye(columns.shape[1]) + columns.T @ columns, seen)
        return float(np.sqrt(max(d @ d - seen @ left, 0.0)))

    def cost(self, told: Told, other: Told) -> float:
        """Minus the log of the distance, infinite where there is none."""
        far = self.distance(told, other)
        return -float(np.log(far)) if far > 0 else np.inf


def _open(model: Precision, told: Told) -> np.ndarray:
    """What the errors of a model's parameters do to its outputs: columns (m, c) of one standard deviation each."""
    shared, own = ~model.trial.own, model.trial.own
    values, vectors = np.linalg.eigh(np.linalg.inv(model.known_before))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    columns = [told.effects[0][:, shared] * model.scale @ root]
    if np.any(own):
        space = model.trial.problem.space
        on = model.trial.coordinates[own]
        columns.append(told.effects[0][:, own] * (space.upper - space.lower)[on])
    return np.hstack(columns)
