"""The plant fitted beside a pattern that repeats every day and that no input shows: in what moves a state, or in what a
sensor shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.models.extensions import parameter_name, with_extensions
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.space import Parameter
from plantfit.trust.diagnosis.judge import Unseen, evidence, independent_share, times_noise, unseen
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.disturbance import PRESSED, values_beside
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted, lengths
from plantfit.trust.diagnosis.plant.sizes import sizes_of
from plantfit.trust.diagnosis.plant.starts import begun_anew
from plantfit.trust.diagnosis.ranges import joined

DAY = 86400.0  # s
SPANNED = 2.5  # days of fitted samples, from which on a pattern is looked for
SAMPLES = 12  # in a day
COUNT = 8  # values of a pattern, every three hours
HARMONICS = 3  # of a day, by which one shows in the residual
OTHERS = (0.55, 1.8)  # days: other periods beside which a day has to stand out,
CLOSER, EVERY = 1.0, 0.25  # none nearer than the record resolves (in 1/length), and so far apart
SEEN, STANDS = 0.4, 1.25  # of the residual that a day accounts for at once; times what the best other period leaves
LARGE = 0.7  # of what the model leaves that the pattern accounts for,
HELD = 0.4  # and of what it leaves of unseen samples
MOST = 4  # states that one is tried at
WIDE = 50.0  # bounds of a pattern, in sizes that would be seen at once
STEPS = 60  # of a fit: a wrong model may have pressed parameters far away
# evidence for one place over another, below which the record does not tell which, or times what the best one leaves: a
# pattern that is not one of so few values is followed better where the plant smooths it, wherever it acts
ALIKE, AS_WELL = (8.0, 2.0)
DRIVEN = 0.5  # of the variance of an input, from which on it repeats every day as well


@dataclass(frozen=True)
class Place:
    """Where a pattern acts: the `kind` of addition and its `signal`, in `unit`, its values within `wide` of zero; each
    of `several` recordings has its own."""

    kind: str
    signal: str
    unit: str | None
    wide: float
    several: bool

    @property
    def parameter(self) -> str:
        return parameter_name(self.kind, self.signal)

    @property
    def name(self) -> str:
        return f"daily pattern of {'the sensor of ' if self.kind == 'sensor_cycle' else ''}{self.signal}"


@dataclass(frozen=True)
class Repeating:
    """A pattern at one of these `places`, the best first, which the record does not tell apart: it accounts for this
    share of what the model leaves (`explains`), `unseen` tells of samples that were not fitted, `rmse` of those that
    were, without and with it. `pattern` are its values at the best place, in its unit, of the first recording. `driven`
    are inputs that repeat as well. `values` are the parameters with it: by coordinate a value with its standard error,
    in their units, which allows for the other places; none where one ends at a bound. `left` (m,) are the residuals."""

    places: tuple[Place, ...]
    explains: float
    unseen: Unseen
    rmse: tuple[float, float]
    pattern: tuple[float, ...]
    driven: tuple[str, ...]
    values: dict[str, tuple[float, float]]
    left: np.ndarray
    times: float
    additions: tuple[()] = ()
    period: float = DAY


def places_of(problem: Problem, z: np.ndarray) -> list[Place]:
    """Where a daily pattern may act in a problem whose answer is z (d,); none where its recordings are too short, or
    sampled too seldom, to show one."""
    model = problem.model
    if not _daily(problem):
        return []
    assert isinstance(model, Model)
    had, many, sizes = {p.name for p in model.parameters}, len(problem.experiments) > 1, sizes_of(problem, z)
    still = {b.state for b in model.backlashes}
    found = []
    for s in [s for s in model.states if s not in still][:MOST]:
        step = units.difference_of(model.states[s])
        unit = None if step is None else joined(step, "/s")
        found.append(Place("cycle", s, unit, WIDE * sizes[s].rate, many))
    for y in problem.outputs:
        unit = units.difference_of(model.outputs[y])
        found.append(Place("sensor_cycle", y, unit, WIDE * problem.scales[y], many))
    return [p for p in found if p.parameter not in had]


def beside(problem: Problem, place: Place) -> Problem:
    """The problem with a pattern at a place."""
    simulator, model = problem.predictor.stepping(), problem.model
    assert isinstance(model, Model)
    pair = (-place.wide, place.wide)
    added = {place.kind: {place.signal: {"bounds": pair, "period": DAY, "count": COUNT}}}
    own = Parameter(pair, per_recording=place.several, shape=(COUNT,))
    made = Problem(
        with_extensions(model, added), problem.experiments, {**problem.space.parameters, place.parameter: own},
        scales=problem.scales, stepper=simulator.stepper, substeps=simulator.substeps,
        hold={u: "linear" if u in simulator.interpolated else "previous" for u in model.inputs}, name=problem.name,
    )  # fmt: skip
    return made.with_starts(problem.start_corrections) if problem.start_corrections else made


def repeating(carrier: Carrier, bare: Fitted, use: np.ndarray, kept: np.ndarray) -> Repeating | None:
    """The pattern that repeats every day in what the model as it is (`bare`) leaves over rows `use` (m,) bool; `kept`
    (m,) bool are those that no outlier takes away.

    None where there is none. The plant is fitted with a pattern at each place. The best one has to account for most of
    what is left, and for much of what is left of samples that were not fitted: noise with a memory, a drift or an error
    of the model has some pattern, too, and it does not come back.
    """
    given = carrier.given
    made: list[tuple[float, Place, Carrier, Fitted]] = []
    for place in places_of(given, bare.x[: carrier.own]):
        problem = beside(given, place)
        z = np.full(problem.space.dimension, 0.5)
        z[[problem.space.names.index(n) for n in given.space.names]] = bare.x[: carrier.own]
        own = Carrier.of(problem, z, {}, carrier.meter)
        fit = fitted(own, (), own.x, np.zeros(0), use, STEPS)
        if np.isfinite(fit.cost(use)):
            own, fit = begun_anew(own, fit, use) or (own, fit)
            made.append((fit.cost(use), place, own, fit))
    if not made:
        return None
    made.sort(key=lambda one: one[0])
    cost, _, own, fit = made[0]
    before = bare.cost(use)
    if cost > (1.0 - LARGE) * before:
        return None
    later = unseen(carrier, bare, fit, use, kept, own)
    if later.extended > (1.0 - HELD) * later.base:
        return None
    alike = [one for one in made if one[0] <= AS_WELL * cost or evidence(one[3], fit, own.rows, use) < ALIKE]
    pattern = [v for n, v in _physical(own, fit).items() if n.startswith(f"{made[0][1].parameter}[")][:COUNT]
    n, unit = int(use.sum()), next(iter(given.scales.values())) if len(given.scales) == 1 else 1.0
    rmse = (float(np.sqrt(before / n)) * unit, float(np.sqrt(cost / n)) * unit)
    roots = Unseen(float(np.sqrt(later.base)) * unit, float(np.sqrt(later.extended)) * unit, later.blocks)
    return Repeating(
        tuple(place for _, place, _, _ in alike), 1.0 - cost / before, roots, rmse, tuple(pattern), _driven(given),
        together([_values(o, f, use, given.space.names) for _, _, o, f in alike]), fit.residuals,
        times_noise(own, fit, ~kept),
    )  # fmt: skip


def work(carrier: Carrier, bare: Fitted) -> float:
    """What the fits of `repeating` cost at most, in evaluations."""
    return len(places_of(carrier.given, bare.x[: carrier.own])) * STEPS * carrier.charge(False)


def _daily(problem: Problem) -> bool:
    """Whether every recording shows some days, well sampled."""
    if not isinstance(problem.model, Model) or not problem.predictor.has_steps or problem.mesh:
        return False
    for e in problem.experiments.values():
        t = e.recording.t[e.mask("fit")]
        if len(t) < SPANNED * SAMPLES or np.ptp(t) < SPANNED * DAY or np.median(np.diff(t)) > DAY / SAMPLES:
            return False
    return True


def shows(carrier: Carrier, bare: Fitted, use: np.ndarray) -> bool:
    """Whether a daily pattern is worth a fit: harmonics of a day account for a good part of the residual of the model
    as it is (`bare`) over rows `use` (m,) bool, the parameters moving along their derivatives, and for more than those
    of other periods of that order."""
    if not _daily(carrier.given):
        return False
    r, a = bare.residuals[use], bare.jacobian[np.ix_(use, columns(carrier, bare.additions))]
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(a))):
        return False
    square = float(r @ r)
    day = _missed(carrier, r, a, use, DAY)
    if day > (1.0 - SEEN) * square:
        return False
    length = max(float(np.ptp(e.recording.t[e.mask("fit")])) for e in carrier.given.experiments.values())
    turns = np.arange(0.0, length / DAY / OTHERS[0], EVERY) / length
    apart = (np.abs(turns - 1.0 / DAY) * length >= CLOSER) & (turns > 1.0 / (OTHERS[1] * DAY))
    return all(day <= STANDS * _missed(carrier, r, a, use, 1.0 / f) for f in turns[apart])


def _missed(carrier: Carrier, r: np.ndarray, a: np.ndarray, use: np.ndarray, period: float) -> float:
    """What harmonics of a period on all outputs leave of the square of residuals r (n,) with derivatives a (n, d)."""
    rows, blocks, place = carrier.rows, [], np.cumsum(use) - 1
    for y in carrier.given.outputs:
        for name, e in carrier.given.experiments.items():
            at = rows.part(name, y)
            at = at[use[at]]
            angle = 2.0 * np.pi / period * e.recording.t[rows.sample[at]]
            own = np.column_stack([f(k * angle) for k in range(1, HARMONICS + 1) for f in (np.cos, np.sin)])
            block = np.zeros((len(r), own.shape[1]))
            block[place[at]] = own * rows.weight[at][:, None]
            blocks.append(block)
    every = np.hstack([a, *blocks])
    q, s, _ = np.linalg.svd(every / lengths(every), full_matrices=False)
    q = q[:, s > 1e-7 * s[0]]
    return float(np.sum((r - q @ (q.T @ r)) ** 2))


def _driven(problem: Problem) -> tuple[str, ...]:
    """Inputs that repeat every day as well."""
    found = []
    for u in getattr(problem.model, "inputs", {}):
        for e in problem.experiments.values():
            t, v = e.recording.t, np.asarray(e.recording[u], dtype=float)
            a = np.column_stack(
                [np.ones(len(t)), *(f(2 * np.pi * t / DAY * k) for k in (1, 2) for f in (np.cos, np.sin))]
            )
            moved = float(np.sum((v - np.mean(v)) ** 2))
            if moved > 0 and np.sum((v - a @ np.linalg.lstsq(a, v, rcond=None)[0]) ** 2) < (1.0 - DRIVEN) * moved:
                found.append(u)
                break
    return tuple(found)


def _physical(carrier: Carrier, fit: Fitted) -> dict[str, float]:
    space = carrier.given.space
    return dict(zip(space.names, np.asarray(space.physical(fit.x[: carrier.own])).tolist(), strict=True))


def _values(carrier: Carrier, fit: Fitted, use: np.ndarray, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The parameters of these names with their standard errors, those that the record shows; none where one is at a
    bound."""
    free = columns(carrier, ())
    own = [carrier.given.space.names.index(n) for n in names]
    if np.any((fit.x[own] < PRESSED) | (fit.x[own] > 1.0 - PRESSED)):
        return {}
    a = fit.jacobian[np.ix_(use, free)]
    size = lengths(a)
    _, s, right = np.linalg.svd(a / size, full_matrices=False)
    shown = s > 1e-7 * max(s[0], 1e-300)
    variance = fit.cost(use) / max(int(use.sum()) - int(shown.sum()), 1)
    variance *= independent_share(fit.residuals, carrier.rows, use)
    spread = np.linalg.norm(right[shown].T / s[shown], axis=1) / size
    spread = np.maximum(spread * np.sqrt(variance), _by_days(carrier, fit, use, a / size) / size)
    errors = np.where(np.sum(right[~shown] ** 2, axis=0) > 1e-7, np.inf, spread)
    found = values_beside(carrier, (), np.r_[fit.x, fit.theta], free, errors)
    return {n: found[n] for n in names if n in found}


def _by_days(carrier: Carrier, fit: Fitted, use: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Standard errors (d,) from what leaving out one day after the other moves along the derivatives a (n, d) of the
    used rows: a pattern is not quite the same every day, as of sun behind clouds.

    The jackknife over clusters (CR3; Bell and McCaffrey, Survey Methodology 28 (2002) 169), widened from the 95 %
    interval of Student's t with one day less to that of a normal distribution.
    """
    rows, r = carrier.rows, fit.residuals[use]
    day, known = np.zeros(len(rows.sample), dtype=int), 0
    for name, e in carrier.given.experiments.items():
        own = (rows.recording == name) & use
        t = e.recording.t[rows.sample[own]]
        day[own] = known + ((t - np.min(t)) // DAY).astype(int)
        known = int(np.max(day[own])) + 1
    day = day[use]
    if known < 2:
        return np.zeros(a.shape[1])
    here = np.linalg.lstsq(a, r, rcond=1e-7)[0]
    moved = [np.linalg.lstsq(a[day != d], r[day != d], rcond=1e-7)[0] - here for d in range(known)]
    widened = float(stdtrit(known - 1, 0.975)) / 1.96
    return widened * np.sqrt((known - 1) / known * np.sum(np.square(moved), axis=0))


def together(every: Sequence[dict[str, tuple[float, float]]]) -> dict[str, tuple[float, float]]:
    """Values of the first, with errors that reach those of the others."""
    best, *others = every
    if not all(every):
        return {}
    return {
        n: (v, max([e, *(float(np.hypot(o[n][1], o[n][0] - v)) for o in others)]))
        for n, (v, e) in best.items()
        if all(n in o for o in others)
    }


__all__ = ["DAY", "Place", "Repeating", "beside", "places_of", "repeating", "shows", "together", "work"]
