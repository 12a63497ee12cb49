"""Columns of a recording that are not followed as they stand, and are with the other sign, in another unit, or one in
the place of the other."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.sobol import Sobol
from plantfit.trust.finish.descent import Descent, descent
from plantfit.trust.finish.other_starts import rmse_and_noise
from plantfit.units import compatible, dimension, equal, factor_offset, parse

POINTS, SEARCHES = 64, 3  # random points of the box, and searches from the best of these and the answer
STEPS = 40  # Jacobians of each
LEFT = 0.1  # of the mean square, relative to what each output moves, at most, that a change leaves ...
NOISES, SURELY = 3.0, 0.01  # ... down to so many times the sample-to-sample noise; more may be left below this share
FOLLOWED = 0.2  # of the standard deviation of every output, at most, that it leaves
ALIKE = 1.2  # times the least that a change leaves, up to which another one is named beside it
LONG, MANY = 700_000, 30  # samples of all records times changes, and coordinates, beyond which that takes too long
# what a number in the first unit is multiplied by to be one in the second
CONFUSED = (
    ("deg", "rad"), ("turn", "rad"), ("deg/s", "rad/s"), ("turn/s", "rad/s"), ("rpm", "rad/s"), ("rpm", "turn/s"),
    ("km/h", "m/s"), ("mile/hour", "m/s"), ("psi", "bar"), ("mbar", "bar"), ("kPa", "bar"), ("g", "kg"),
    ("mm", "m"), ("cm", "m"), ("inch", "m"), ("mV", "V"), ("mA", "A"), ("ms", "s"), ("l/min", "m^3/h"),
    ("l/min", "l/s"), ("kN", "N"), ("kW", "W"), ("mT", "T"), ("standard_gravity", "m/s^2"),
)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """What is done to all recordings: `signals` times `factor`, or the two of them exchanged (factor 1). `units`: the
    unit that the numbers are in, and the one that is stated, of a wrong unit."""

    signals: tuple[str, ...]
    factor: float = 1.0
    units: tuple[str, str] | None = None

    def of(self, recording: Recording) -> Recording:
        made = dict(recording.signals)
        if len(self.signals) == 2:
            a, b = self.signals
            made[a], made[b] = (replace(made[a], values=made[b].values), replace(made[b], values=made[a].values))
        else:
            [a] = self.signals
            made[a] = replace(made[a], values=self.factor * np.asarray(made[a].values))
        return replace(recording, signals=made)


@dataclass(frozen=True)
class OtherColumns:
    """The changes with which a record is followed, the best first: they explain alike. RMSE of each output as it is
    recorded (`before`) and with the first of them (`after`), in the output's unit."""

    changes: tuple[Change, ...]
    before: dict[str, float]
    after: dict[str, float]


def other_columns(
    problem: Problem,
    z: np.ndarray,
    progress: Callable[[str], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> OtherColumns | None:
    """With which changes of its columns a problem is followed whose answer z (d,) does not follow it; None where none
    does, where the same searches follow it as it is, where looking would take long, and where `stop` ends it."""
    if not isinstance(problem.model, Model) or problem.space.dimension > MANY:
        return None
    if problem.smoothing is not None or problem.own_estimate is not None:
        return None
    changes = _changes(problem)
    if sum(len(e.recording) for e in problem.experiments.values()) * len(changes) > LONG:
        return None
    before = min(_left(problem, z), _searched(problem, z)[0])
    tried = []
    for change in changes:
        if stop is not None and stop():
            return None
        if progress is not None:
            progress(f"trying columns: {' and '.join(change.signals)}")
        made = problem.with_recordings({n: change.of(e.recording) for n, e in problem.experiments.items()})
        tried.append((*_searched(made, z), change, made))
    tried = [one for one in tried if one[0] <= LEFT * before and _follows(one[3], one[1].z, one[0] <= SURELY * before)]
    if not tried:
        return None
    tried.sort(key=lambda one: one[0])
    best = tried[0]
    alike = tuple(change for left, _, change, _ in tried if left <= ALIKE * best[0])
    return OtherColumns(alike, rmse_and_noise(problem, z)[0], rmse_and_noise(best[3], best[1].z)[0])


def _changes(problem: Problem) -> list[Change]:
    """The other sign of every input, and of every output that has negative values; two inputs or two outputs of one
    unit exchanged; every signal in the units that its own is mistaken for. Only signals that all recordings have, and
    that move in some."""
    model, records = problem.model, [e.recording for e in problem.experiments.values()]
    assert isinstance(model, Model)
    names = [
        n
        for n in (*model.inputs, *problem.outputs)
        if all(n in r.signals for r in records) and any(np.ptp(r[n][np.isfinite(r[n])]) > 0 for r in records)
    ]
    units = {n: records[0].signals[n].unit for n in names}
    made = [
        Change((n,), -1.0)
        for n in names
        if any(np.min(r[n][np.isfinite(r[n])]) < 0 for r in records) or n in model.inputs
    ]
    made += [
        Change((a, b))
        for k, a in enumerate(names)
        for b in names[k + 1 :]
        if (a in model.inputs) == (b in model.inputs)
        and (units[a] == units[b] or equal(units[a] or "", units[b] or ""))
    ]
    return [*made, *(Change((n,), f, pair) for n in names for f, pair in _factors(units[n]))]


def _factors(unit: str | None) -> Iterator[tuple[float, tuple[str, str]]]:
    """Each other size of the numbers of a signal in this unit, with the unit that they may be in and the stated one."""
    seen: list[float] = []
    for pair in CONFUSED:
        if not unit or not compatible(unit, pair[0]) or _is_number(unit) != _is_number(pair[0]):
            continue
        for wrong, right in (pair, pair[::-1]):
            factor, _ = factor_offset(wrong, right)
            if not any(np.isclose(factor, s, rtol=0.02) for s in seen):
                seen.append(factor)
                yield factor, (wrong, right)


def _is_number(unit: str) -> bool:
    """Whether a unit is none, as that of a share, and not that of an angle, which has no dimension either."""
    return not dimension(unit) and str(parse(unit)) not in ("radian", "degree", "turn")


def _searched(problem: Problem, z: np.ndarray) -> tuple[float, Descent]:
    """The best of a few short searches, from the answer z (d,) and from where random points cost least: what it leaves,
    and where it ended."""
    points = Sobol(problem.space.dimension, np.random.default_rng(1)).random(POINTS)
    costs = np.asarray(problem.costs(points))
    order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))
    starts = [z, *points[order[: SEARCHES - 1]]]
    found = min((descent(problem, s, STEPS * problem.jacobian_charge) for s in starts), key=lambda d: _finite(d.cost))
    return _left(problem, found.z), found


def _finite(cost: float) -> float:
    return cost if np.isfinite(cost) else np.inf


def _follows(problem: Problem, z: np.ndarray, surely: bool) -> bool:
    """Whether every output is followed at z (d,), and unless `surely` down to near its noise."""
    size, noise = rmse_and_noise(problem, z)
    if max(_shares(problem, size).values()) > FOLLOWED:
        return False
    return surely or all(size[o] <= NOISES * noise[o] for o in size)


def _left(problem: Problem, z: np.ndarray) -> float:
    """The mean square that is left of all outputs, each relative to what it moves."""
    return float(np.mean(np.square(list(shares(problem, z).values()))))


def shares(problem: Problem, z: np.ndarray) -> dict[str, float]:
    """RMSE of each output that has fitted samples as a share of its standard deviation; infinite where it cannot be
    simulated."""
    return _shares(problem, rmse_and_noise(problem, z)[0])


def _shares(problem: Problem, size: dict[str, float]) -> dict[str, float]:
    measured = {o: np.concatenate([m[o] for m in problem.data["measured"].values()]) for o in size}
    return {o: _finite(r) / max(float(np.std(measured[o])), 1e-300) for o, r in size.items()}


__all__ = ["Change", "OtherColumns", "other_columns", "shares"]
