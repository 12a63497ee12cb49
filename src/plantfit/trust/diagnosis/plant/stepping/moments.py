"""Where a parameter, what moves a state, or what a sensor shows may have become another one at a moment: looked at for
every moment along the derivatives of the fit, which takes hardly a simulation."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.models.extensions import KINDS, brought, parameter_name
from plantfit.models.extensions.steps import numbers_of
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.sobol import Sobol
from plantfit.trust.diagnosis.plant.carrier import Carrier
from plantfit.trust.diagnosis.plant.disturbance import even
from plantfit.trust.diagnosis.plant.hypothesis import Fitted, columns, fitted, lengths
from plantfit.trust.diagnosis.plant.sizes import sizes_of
from plantfit.trust.diagnosis.ranges import joined

MOMENTS = 100  # of the fitted part that are looked at first, then every sample about the best one
SIDE, FEWEST = 0.04, 15  # of the fitted samples before a moment and behind it, at least, and how many
PARTS, PART_STEPS = 3, 30  # of the fitted part, the first and last of which are fitted alone, by so many steps
# of the cube: from where these begin, what is at a bound, and at how many other points they begin then
OFF_BOUNDS, NEAR_BOUND, ELSEWHERE = 0.1, 0.02, 3
ROUND = 0.05  # of the fitted part to each side of a moment: where a study file looks for it
NUDGE = 1e-5  # of the cube, by which states are differenced
NOTHING = 1e-9  # of a column, projected: what no sample tells
LESS, MORE = -0.95, 99.0  # of a parameter: what it may be less and more
WIDE = 50.0  # bounds of other steps, in sizes that would be seen at once


@dataclass(frozen=True)
class StepPlace:
    """What may change at a moment: the `kind` of addition and its `signal`, in `unit`, its size within `bounds`. `at`
    (s), `size` and `begin` (d,) of the cube are where it is begun, `share` is the part of the mean square that it
    explains along derivatives. `between` are the moments (low, high) s that the study file allows."""

    kind: str
    signal: str
    unit: str | None
    bounds: tuple[float, float]
    at: float = 0.0
    size: float = 0.0
    share: float = 0.0
    begin: tuple[float, ...] = ()
    between: tuple[float, float] = (0.0, 0.0)

    @property
    def parameter(self) -> str:
        return parameter_name(self.kind, self.signal)

    @property
    def name(self) -> str:
        before = {"step": "step of", "load_step": "load step of", "sensor_step": "step of the sensor of"}
        return f"{before[self.kind]} {self.signal}"


def step_places(problem: Problem, z: np.ndarray) -> list[StepPlace]:
    """What may change at a moment in a problem whose answer is z (d,); nothing of several recordings, of models that
    are not simulated, and of records that are not evenly sampled."""
    model = problem.model
    if not isinstance(model, Model) or not problem.predictor.has_steps or problem.mesh or len(problem.experiments) > 1:
        return []
    if not even(problem):
        return []
    had, sizes = {p.name for p in model.parameters}, sizes_of(problem, z)
    free: dict[str, list[object]] = {}
    added = {name for kind, own in KINDS.items() for s in own.signals(model) for name in brought(kind, s)}
    for c in problem.space.coordinates:
        free.setdefault(c.parameter, []).append(c)
    found = [
        StepPlace("step", n, "1", (LESS, MORE))
        for n in numbers_of(model)
        if len(free.get(n, ())) == 1 and n not in added
    ]
    still = {b.state for b in model.backlashes}
    for s in (s for s in model.states if s not in still and s.isidentifier()):
        step = units.difference_of(model.states[s])
        wide = WIDE * sizes[s].rate
        found.append(StepPlace("load_step", s, None if step is None else joined(step, "/s"), (-wide, wide)))
    for y in problem.outputs:
        wide = WIDE * problem.scales[y]
        found.append(StepPlace("sensor_step", y, units.difference_of(model.outputs[y]), (-wide, wide)))
    return [p for p in found if p.parameter not in had]


def looked_at(carrier: Carrier, bare: Fitted, use: np.ndarray) -> list[StepPlace]:
    """All places, the best first, each at its best moment; over rows `use` (m,) bool of the model as it is (`bare`).

    What a step does to the outputs is a straight line of its size, made of what is known at the fit: of a load the
    response to an initial state, summed up and moved to the moment; of a parameter the derivative behind the moment
    less what the states had of it by then. It is exact for small steps of linear plants; others are near enough to
    begin at. A step that is not small may press the parameters far away, so the same is done where the first third of
    the record has them, and the last.
    """
    places = step_places(carrier.given, bare.x[: carrier.own])
    found: dict[str, StepPlace] = {}
    for one in _bases(carrier, bare, use) if places else ():
        for p in _at_best(carrier, one, places, use, bare.cost(use)):
            if p.share > found.get(p.name, p).share or p.name not in found:
                found[p.name] = p
    return sorted(found.values(), key=lambda p: -p.share)


def _bases(carrier: Carrier, bare: Fitted, use: np.ndarray) -> Iterator[Fitted]:
    """The model as it is, and fitted to each end of the record."""
    yield bare
    order = np.unique(carrier.rows.sample[use])
    here = bare.x[: carrier.own]
    begins = [np.clip(here, OFF_BOUNDS, 1.0 - OFF_BOUNDS)]
    if np.any((here < NEAR_BOUND) | (here > 1.0 - NEAR_BOUND)):  # a large step has pressed them far away
        begins += list(Sobol(max(carrier.own, 1), np.random.default_rng(0)).random(ELSEWHERE)[:, : carrier.own])
    for part in (order[: len(order) // PARTS], order[-(len(order) // PARTS) :]):
        if len(part) < FEWEST or not carrier.meter.holds(len(begins) * PART_STEPS * carrier.charge(False)):
            continue
        rows = use & (carrier.rows.sample >= part[0]) & (carrier.rows.sample <= part[-1])
        every = []
        for z in begins:
            own = bare.x.copy()
            own[: carrier.own] = z
            every.append(fitted(carrier, (), own, np.zeros(0), rows, PART_STEPS))
        yield min(every, key=lambda one: np.nan_to_num(one.cost(rows), nan=np.inf))


def _at_best(
    carrier: Carrier, base: Fitted, places: list[StepPlace], use: np.ndarray, square: float
) -> list[StepPlace]:
    """The places at their best moments, along the derivatives of one fit; `square` is what the model leaves."""
    given = carrier.given
    ((name, e),) = given.experiments.items()
    seen = _Seen.of(carrier, base, use, name, places, square)
    if seen is None:
        return []
    t = e.recording.t
    ends = inner(carrier, use)
    if ends is None:
        return []
    first, last = ends
    stride = max(1, (last - first) // MOMENTS)
    best: dict[int, tuple[float, float, int]] = {}
    seen.search(range(first, last + 1, stride), best)
    if stride > 1:
        near = {k + d for _, _, k in best.values() for d in range(1 - stride, stride)}
        seen.search(sorted(k for k in near if first <= k <= last), best)
    period = float(np.median(np.diff(t)))
    found = []
    for i, (share, size, k) in best.items():
        p = places[i]
        size = float(np.clip(size * seen.scale(p, period), *p.bounds))
        at = float(t[k]) - (0.5 * period if p.kind == "sensor_step" else 0.0)
        begin = tuple(float(v) for v in base.x[: carrier.own])
        between = at - ROUND * float(t[last] - t[first]), at + ROUND * float(t[last] - t[first])
        found.append(replace(p, at=at, size=size, share=share, begin=begin, between=between))
    return found


def inner(carrier: Carrier, use: np.ndarray) -> tuple[int, int] | None:
    """The first and the last sample with enough of the used rows on both sides; None of a short record."""
    samples = np.unique(carrier.rows.sample[use])
    side = max(FEWEST, int(SIDE * len(samples)))
    return (int(samples[side]), int(samples[-side])) if len(samples) >= 3 * side else None


@dataclass
class _Seen:
    """`left` (n,) are the residuals of the used rows without what the parameters can take up, `base` (n, k) an
    orthonormal base of that, `square` what the model leaves. `pushed` is by state the response (m,) to its
    initial value, `states` by coordinate and state the derivative (N,) of the state."""

    carrier: Carrier
    bare: Fitted
    use: np.ndarray
    places: list[StepPlace]
    left: np.ndarray
    base: np.ndarray
    square: float
    pushed: dict[str, np.ndarray]
    states: list[dict[str, np.ndarray]]

    @classmethod
    def of(cls, carrier: Carrier, bare: Fitted, use: np.ndarray, name: str, places: list[StepPlace],
           square: float) -> "_Seen | None":  # fmt: skip
        r, a = bare.residuals[use], bare.jacobian[np.ix_(use, columns(carrier, bare.additions))]
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(a)) and r @ r > 0):
            return None
        q, s, _ = np.linalg.svd(a / lengths(a), full_matrices=False)
        q = q[:, s > 1e-7 * s[0]]
        pushed = {}
        for state in getattr(carrier.given.model, "states", ()):
            wanted = parameter_name("start", state)
            if wanted in carrier.names:
                pushed[state] = bare.jacobian[:, carrier.names.index(wanted)]
        own = any(p.kind == "step" for p in places)
        return cls(carrier, bare, use, places, r - q @ (q.T @ r), q, square, pushed,
                   list(_of_states(carrier, bare.x[: carrier.own], name)) if own else [])  # fmt: skip

    def search(self, moments: "range | list[int]", best: dict[int, tuple[float, float, int]]) -> None:
        """By place the share, size and sample of the best of these moments, where that is better than what was."""
        for k in moments:
            made = np.column_stack([self.column(p, k)[self.use] for p in self.places])
            apart = made - self.base @ (self.base.T @ made)
            sizes = np.sum(apart**2, axis=0)
            along, left = apart.T @ self.left, float(self.left @ self.left)
            for i, size in enumerate(sizes):
                if not size > NOTHING * float(np.sum(made[:, i] ** 2)):
                    continue
                share = 1.0 - (left - float(along[i] ** 2 / size)) / self.square
                if i not in best or share > best[i][0]:
                    best[i] = share, float(-along[i] / size), k

    def column(self, p: StepPlace, k: int) -> np.ndarray:
        """What a step of a place at sample k does to all rows (m,), for each unit of the column."""
        carrier, rows = self.carrier, self.carrier.rows
        behind = rows.sample >= k
        if p.kind == "sensor_step":
            return np.where(behind & (rows.output == p.signal), rows.weight, 0.0)
        if p.kind == "load_step":
            return self._moved(p.signal, k, summed=True)
        i = [c.parameter for c in carrier.given.space.coordinates].index(p.signal)
        column = np.where(behind, self.bare.jacobian[:, i], 0.0)
        for s, along in self.states[i].items():
            if s in self.pushed:
                column = column - along[k] * self._moved(s, k)
        return column

    def _moved(self, state: str, k: int, summed: bool = False) -> np.ndarray:
        """The response to a state (m,), begun at sample k, or to a push at every sample from there on."""
        if state not in self.pushed:
            return np.zeros(len(self.use))
        found, rows = np.zeros(len(self.use)), self.carrier.rows
        (name,) = self.carrier.given.experiments
        for y in self.carrier.given.outputs:
            at = rows.part(name, y)
            own = self.pushed[state][at]
            found[at[k:]] = (np.cumsum(own) if summed else own)[: len(at) - k]
        return found

    def scale(self, p: StepPlace, period: float) -> float:
        """What a unit of a column is of the size of a step: of a parameter it is a coordinate of the cube."""
        given = self.carrier.given
        if p.kind == "sensor_step":
            return float(given.scales[p.signal])
        if p.kind == "load_step":
            return 1.0 / period
        i = [c.parameter for c in given.space.coordinates].index(p.signal)
        z = self.bare.x[: self.carrier.own]
        value = float(np.asarray(given.space.physical(z))[i])
        return float(np.asarray(given.space.slopes(z))[i]) / value if value else 0.0  # of 0 nothing is a share


def _of_states(carrier: Carrier, z: np.ndarray, name: str) -> Iterator[dict[str, np.ndarray]]:
    """By coordinate what it does to the states at every sample (N,), by differences."""
    given = carrier.given
    model, n = given.model, len(given.experiments[name].recording.t)
    assert isinstance(model, Model)
    states = tuple(model.states)

    def at(z: np.ndarray) -> dict[str, np.ndarray]:
        carrier.meter.charge(1.0)
        values = np.asarray(given.space.physical(z))
        found = given.compiled["trajectories"](given.space.tree(values, name), given.whole_drives[name])
        return {s: np.broadcast_to(np.asarray(found[s], dtype=float)[:n], (n,)) for s in states}

    here = at(z)
    for i in range(len(z)):
        moved = z.copy()
        moved[i] += NUDGE if z[i] < 0.5 else -NUDGE
        there = at(moved)
        yield {s: (there[s] - here[s]) / (moved[i] - z[i]) for s in here}


__all__ = ["MOMENTS", "StepPlace", "inner", "looked_at", "step_places"]
