"""The plant fitted with a parameter, a load or a sensor's offset that becomes another one at a moment."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.extensions import with_extensions
from plantfit.models.extensions.steps import moment_of
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.space import Parameter
from plantfit.trust.diagnosis.judge import (
    Unseen,
    evidence,
    independent_share,
    needed,
    times_noise,
    unseen,
)
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.cycles import together
from plantfit.trust.diagnosis.plant.disturbance import PRESSED, values_beside
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted, lengths, whole
from plantfit.trust.diagnosis.plant.starts import begun_anew
from plantfit.trust.diagnosis.plant.stepping.moments import MOMENTS, StepPlace, inner, looked_at

SEEN = 0.6  # of the residual that a step accounts for along derivatives, from which on it is fitted
WITHIN, ROOM, MOST = 3.0, 0.1, 4  # times what the best one leaves, and more of the residual: what is fitted as well
STEPS, AGAIN = 40, 2  # of a fit, and of each behind a moment that is held
TURNS, GAIN = 6, 1e-4  # of fits and moments, and the part of the square below which they end
ASIDE, TRIED = 2.0, 17  # hundredths of the fitted part to each side of the moment, and how many are looked at there
# of what the model leaves that a step accounts for, and times the sample-to-sample noise that it may leave then: nearly
# all, or what there is beyond noise
LARGE = ((0.9, 1.5), (0.6, 1.15))
HELD = 0.5  # of what the model leaves of unseen samples
ALIKE, AS_WELL = 8.0, 1.1  # evidence for one place over another below which the record does not tell which, or times
NORMAL = 3.84  # of chi-squared, 5 % of one number
OUTWARDS, HALVINGS = 12, 6  # doublings and halvings in which an end of the moment's interval is found


@dataclass(frozen=True)
class StepAt:
    """A step of a `place` at the moment `at`, s, which is in `within` (low, high) with 95 %; `size` with its standard
    error is that of the addition, `before` and `behind` are a parameter on both sides with standard errors, in its
    `unit`."""

    place: StepPlace
    at: float
    within: tuple[float, float]
    size: tuple[float, float]
    before: tuple[float, float] | None = None
    behind: tuple[float, float] | None = None
    unit: str | None = None


@dataclass(frozen=True)
class Stepping:
    """One of these `steps`, the best first, which the record does not tell apart: it accounts for this share of what
    the model leaves (`explains`), `unseen` tells of samples that were not fitted, `rmse` of those that were, without
    and with it. `values` are the other parameters with it: by coordinate a value with its standard error, in their
    units, which allows for all of these steps. `left` (m,) are the residuals, `times` the sample-to-sample noise that
    they are."""

    steps: tuple[StepAt, ...]
    explains: float
    unseen: Unseen
    rmse: tuple[float, float]
    values: dict[str, tuple[float, float]]
    left: np.ndarray
    times: float
    additions: tuple[()] = ()


def worth_a_fit(carrier: Carrier, bare: Fitted, use: np.ndarray) -> list[StepPlace]:
    """Where a step accounts for most of what the model as it is (`bare`) leaves over rows `use` (m,) bool, along
    derivatives; the best first."""
    every = looked_at(carrier, bare, use)
    if not every or every[0].share < SEEN:
        return []
    worth = 1.0 - WITHIN * (1.0 - every[0].share) - ROOM
    return [p for p in every if p.share >= worth][:MOST]


def work(carrier: Carrier, places: Sequence[StepPlace]) -> float:
    """Simulations that the fits with a step at each of these places take at most, about."""
    return len(places) * 2 * STEPS * carrier.charge(False)


def stepping(
    carrier: Carrier, bare: Fitted, places: Sequence[StepPlace], use: np.ndarray, kept: np.ndarray
) -> Stepping | None:
    """The step at a moment in what the model as it is (`bare`) leaves over rows `use` (m,) bool; `kept` (m,) bool are
    those that no outlier takes away, `places` those that are worth a fit.

    None where there is none: the plant with one has to come near the noise, on unseen samples, too.
    """
    made = [_fitted_with(carrier, place, use) for place in places]
    made = [one for one in made if np.isfinite(one.cost(use))]
    if not made:
        return None
    made.sort(key=lambda one: one.cost(use))
    best, before, n = made[0], bare.cost(use), int(use.sum())
    after, times = best.cost(use), times_noise(best.carrier, best.fit, ~kept)
    explains = 1.0 - after / before
    if not any(explains >= share and times <= most for share, most in LARGE) or evidence(
        bare, best.fit, carrier.rows, use
    ) < _chance(carrier):
        return None
    later = unseen(carrier, bare, best.fit, use, kept, best.carrier, best.held)
    if later.extended > HELD * later.base:
        return None
    alike = [
        one
        for one in made
        if one.cost(use) <= AS_WELL * after or evidence(one.fit, best.fit, carrier.rows, use) < ALIKE
    ]
    steps = [s for s in (one.told(use) for one in alike) if s is not None]
    if not steps or steps[0].place.name != best.place.name:
        return None
    unit = next(iter(carrier.given.scales.values())) if len(carrier.given.scales) == 1 else 1.0
    rmse = (float(np.sqrt(before / n)) * unit, float(np.sqrt(after / n)) * unit)
    roots = Unseen(float(np.sqrt(later.base)) * unit, float(np.sqrt(later.extended)) * unit, later.blocks)
    told = {s.place.signal for s in steps if s.place.kind == "step"}
    names = [n for n in carrier.given.space.names if n not in told]
    values = together([{n: v for n, v in one.values(use).items() if n in names} for one in alike])
    return Stepping(tuple(steps), explains, roots, rmse, values, best.fit.residuals, times)


def beside(problem: Problem, place: StepPlace, at: tuple[float, float]) -> Problem:
    """The problem with a step at a place, its moment between two (s)."""
    simulator, model = problem.predictor.stepping(), problem.model
    assert isinstance(model, Model)
    added = {place.kind: {place.signal: {"bounds": place.bounds, "at": at}}}
    own = {place.parameter: Parameter(place.bounds), moment_of(place.parameter): Parameter(at)}
    made = Problem(
        with_extensions(model, added), problem.experiments, {**problem.space.parameters, **own},
        scales=problem.scales, stepper=simulator.stepper, substeps=simulator.substeps,
        hold={u: "linear" if u in simulator.interpolated else "previous" for u in model.inputs}, name=problem.name,
    )  # fmt: skip
    return made.with_starts(problem.start_corrections) if problem.start_corrections else made


@dataclass(frozen=True)
class _Made:
    """A place with the plant that has it (`carrier`), and its fit."""

    place: StepPlace
    carrier: Carrier
    fit: Fitted

    def cost(self, use: np.ndarray) -> float:
        return self.fit.cost(use)

    @property
    def _at(self) -> int:
        return self.carrier.names.index(moment_of(self.place.parameter))

    @property
    def held(self) -> tuple[int, ...]:
        """What is not fitted by its derivatives: between two samples the moment of a sensor does nothing."""
        return (self._at,) if self.place.kind == "sensor_step" else ()

    def better(self, x: np.ndarray, use: np.ndarray, held: tuple[int, ...] = ()) -> "_Made":
        """Fitted from coordinates (d,), where that is better."""
        one = fitted(self.carrier, (), x, np.zeros(0), use, STEPS, held=held or self.held)
        return replace(self, fit=one) if one.cost(use) < self.cost(use) else self

    def values(self, use: np.ndarray) -> dict[str, tuple[float, float]]:
        """By coordinate its value with its standard error, those that the record shows; none where one is at a
        bound."""
        own = [i for i, n in enumerate(self.carrier.names) if not n.startswith(self.place.parameter)]
        if np.any((self.fit.x[own] < PRESSED) | (self.fit.x[own] > 1.0 - PRESSED)):
            return {}
        cov, shown = self._covariance(use)
        errors = np.where(shown, np.sqrt(np.maximum(np.diag(cov), 0.0)), np.inf)
        return values_beside(self.carrier, (), np.r_[self.fit.x, self.fit.theta], columns(self.carrier, ()), errors)

    def _covariance(self, use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the coordinates in the cube (d, d), and which of them the record shows (d,) bool."""
        a = self.fit.jacobian[np.ix_(use, columns(self.carrier, ()))]
        a[:, list(self.held)] = 0.0
        size = lengths(a)
        _, s, right = np.linalg.svd(a / size, full_matrices=False)
        known = s > 1e-7 * max(s[0], 1e-300)
        half = right[known].T / s[known] / size[:, None]
        shown = np.sum(right[~known] ** 2, axis=0) <= 1e-7
        return half @ half.T * self.variance(use), shown

    def variance(self, use: np.ndarray) -> float:
        """Of a residual, times how many of them count as one."""
        freedom = max(int(use.sum()) - len(self.carrier.names), 1)
        return self.cost(use) / freedom * independent_share(self.fit.residuals, self.carrier.rows, use)

    def told(self, use: np.ndarray) -> StepAt | None:
        """The step with its intervals; None where its size or moment is at a bound."""
        space, x, name = self.carrier.given.space, self.fit.x[: self.carrier.own], self.place.parameter
        physical, slopes = np.asarray(space.physical(x)), np.asarray(space.slopes(x))
        cov, _ = self._covariance(use)
        i = self.carrier.names.index(name)
        size = float(physical[i]), float(slopes[i] * np.sqrt(max(cov[i, i], 0.0)))
        pressed = x[[i, self._at]]
        if np.any((pressed < PRESSED) | (pressed > 1.0 - PRESSED)):
            return None
        at, within = float(physical[self._at]), self._interval(use)
        (low, high), around = within, max(abs(b - self.place.at) for b in self.place.between)
        place = replace(self.place, at=at, size=size[0], between=(min(low, at - around), max(high, at + around)))
        found = StepAt(place, at, within, size)
        if self.place.kind != "step":
            return found
        k = self.carrier.names.index(self.place.signal)
        pair = cov[np.ix_([k, i], [k, i])] * np.outer(slopes[[k, i]], slopes[[k, i]])
        value, along = float(physical[k]), np.array([1.0 + size[0], physical[k]])
        return replace(
            found, before=(value, float(np.sqrt(pair[0, 0]))),
            unit=space.coordinates[space.names.index(self.place.signal)].unit,
            behind=(value * (1.0 + size[0]), float(np.sqrt(max(along @ pair @ along, 0.0)))),
        )  # fmt: skip

    def _interval(self, use: np.ndarray) -> tuple[float, float]:
        """Moments (low, high) s that the record does not refuse: the others fitted anew beside each, by the likelihood
        ratio."""
        space, k = self.carrier.given.space, self._at
        limit = self.cost(use) + NORMAL * self.variance(use)
        width = float(space.upper[k] - space.lower[k])
        (e,) = self.carrier.given.experiments.values()
        first = 0.25 * float(np.median(np.diff(e.recording.t))) / width
        at, ends = float(self.fit.x[k]), []
        for side in (-1.0, 1.0):
            inside, outside, d = 0.0, np.inf, first
            for _ in range(OUTWARDS):
                if self._beside(at + side * d, use)[0] > limit:
                    outside = d
                    break
                inside, d = d, 2.0 * d
            for _ in range(HALVINGS if outside < np.inf else 0):
                middle = 0.5 * (inside + outside)
                refused = self._beside(at + side * middle, use)[0] > limit
                inside, outside = (inside, middle) if refused else (middle, outside)
            ends.append(np.clip(at + side * (outside if outside < np.inf else inside), 0.0, 1.0))
        # beyond a moment that is refused another one may be as good, where an input jumps between them
        ends += [at + d for d in _around() if self._beside(at + d, use)[0] <= limit]
        ends = [min(ends), max(ends)]
        low, high = (float(space.lower[k] + width * v) for v in ends)
        return low, high

    def _beside(self, at: float, use: np.ndarray) -> tuple[float, np.ndarray]:
        """The square that is left with the moment held, and the coordinates (d,) there."""
        x, k = self.fit.x.copy(), self._at
        least, best = np.inf, x
        if not 0.0 <= at <= 1.0:
            return least, best
        x[k] = at
        free = np.array([i for i in range(len(x)) if i != k])
        for _ in range(AGAIN + 1):
            r, jacobian = whole(self.carrier, (), x)
            square, a = float(np.sum(r[use] ** 2)), jacobian[np.ix_(use, free)]
            if not (np.all(np.isfinite(a)) and np.isfinite(square)):
                break
            if square < least:
                least, best = square, x.copy()
            norms = lengths(a)
            x[free] = np.clip(x[free] - np.linalg.lstsq(a / norms, r[use], rcond=1e-9)[0] / norms, 0.0, 1.0)
        return least, best

    def settled(self, use: np.ndarray) -> "_Made":
        """Fitted with its moment held, then from the best of other moments near it, in turns until that gains nothing:
        where inputs jump the square has kinks, at which a step in all coordinates is stuck."""
        made = self
        for _ in range(TURNS):
            before = made.cost(use)
            made = made.better(made.fit.x, use, held=(made._at,))
            at = float(made.fit.x[made._at])
            square, x = min((made._beside(at + d, use) for d in _around()), key=lambda one: one[0])
            if square < made.cost(use):
                made = made.better(x, use)
            if made.cost(use) >= (1.0 - GAIN) * before:
                break
        return made

    def begun_anew(self, use: np.ndarray) -> "_Made":
        """With the noise of first values as it is beside the step: the model without one may have put a part of it
        there, which would then be in the parameters."""
        anew = begun_anew(self.carrier, self.fit, use)
        return self if anew is None else replace(self, carrier=anew[0], fit=anew[1]).settled(use)


def _around() -> np.ndarray:
    """Moments (k,) beside one, in the cube."""
    return np.linspace(-ASIDE, ASIDE, TRIED) / MOMENTS


def _fitted_with(carrier: Carrier, place: StepPlace, use: np.ndarray) -> _Made:
    """The plant fitted with a step at a place, from its moment along derivatives and others near it."""
    (e,) = carrier.given.experiments.values()
    samples = inner(carrier, use)
    assert samples is not None  # or nothing would have been looked at
    ends = float(e.recording.t[samples[0]]), float(e.recording.t[samples[1]])
    problem = beside(carrier.given, place, ends)
    names = problem.space.names
    z = np.full(problem.space.dimension, 0.5)
    z[[names.index(n) for n in carrier.given.space.names]] = place.begin
    size, moment = names.index(place.parameter), names.index(moment_of(place.parameter))
    z[size] = (place.size - place.bounds[0]) / (place.bounds[1] - place.bounds[0])
    own = Carrier.of(problem, z, {}, carrier.meter)
    x = own.x.copy()
    x[moment] = (place.at - ends[0]) / (ends[1] - ends[0])
    made = _Made(place, own, fitted(own, (), x, np.zeros(0), use, 0))
    for off in (0.0, -ASIDE / MOMENTS, ASIDE / MOMENTS):
        x[moment] = np.clip((place.at - ends[0]) / (ends[1] - ends[0]) + off, 0.01, 0.99)
        made = made.better(x, use)
    return made.settled(use).begun_anew(use) if np.isfinite(made.cost(use)) else made


def _chance(carrier: Carrier) -> float:
    """The evidence that chance gives in 1 % of records: two numbers, at a hundred moments of some places."""
    return needed(MOMENTS * (len(carrier.names) + 1), 2)


__all__ = ["StepAt", "Stepping", "beside", "stepping", "work", "worth_a_fit"]
