"""Multiple shooting: a start for records on which simulating from the first sample to the last leads nowhere.

Every record is cut into segments with initial states of their own; the gaps between segments are closed little by
little. H. G. Bock, Recent advances in parameter identification techniques for O.D.E., in Numerical Treatment of Inverse
Problems in Differential and Integral Equations, Birkhaeuser 1983, 95-121. Continuity enters as a penalty whose weight
grows until the step is that of the constrained Gauss-Newton method.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import SearchError, SimulationError
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.climb import Point, descend
from plantfit.problem.shooting.elimination import Linear
from plantfit.problem.shooting.one_segment import Local
from plantfit.problem.shooting.segments import Cut, cut
from plantfit.runtime import jit
from plantfit.simulate.simulator import Drive

import jax

WEIGHTS = (0.01, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4, 1e6, 1e8)
LOOSE = WEIGHTS[:3]  # that leave gaps: where segments fit best, also of records that no whole simulation follows
ROUNDS = 30
SETTLED, SETTLED_LAST = 1e-3, 1e-9  # relative fall of the merit below which a weight is done, and the last one
CLOSED = 1e-3  # gap, as a share of the spread of a state, under which segments are one trajectory
AGREE = 1e-6  # relative difference of the costs of two shots that ended in the same place


@dataclass(frozen=True)
class Shot:
    """Where multiple shooting ended: cube point `z` (d,), initial states of the segments (L, n) in their units.

    `cost` is the mean squared scaled residual of the segments, `gap` the largest jump between two of them as a share of
    the spread of that state; both inf where nothing could be simulated. `evaluations` counts simulations with
    derivatives.
    """

    z: np.ndarray
    states: np.ndarray
    cost: float
    gap: float
    evaluations: int

    @property
    def closed(self) -> bool:
        """Whether the segments have become one trajectory."""
        return self.gap < CLOSED


@dataclass(frozen=True, eq=False)
class Shooting:
    """A problem cut into segments, with its compiled functions; use `Shooting.of`."""

    problem: Problem
    cut: Cut
    unit: float  # root mean square of the measured values about their means, scaled
    functions: dict[str, Callable[..., Any]]

    @classmethod
    def of(cls, problem: Problem, *, segments: int | None = None, length: float | None = None) -> "Shooting":
        """Cut the fitted parts into pieces of `length` seconds, or the longest into `segments` pieces; the others as
        long as these.

        A good length is half a period of an oscillation, or the time in which an unstable deviation grows three times;
        a shorter one costs time but seldom harms. Raises SearchError for a number that does not fit the records,
        SimulationError for a model without states or with late states and for steady records.
        """
        _refuse(problem)
        pieces, unit = cut(problem, segments, length), _unit(problem)
        samples = sum(int(np.sum(s)) for s in pieces.segments.scored)
        local = Local(problem, tuple(1.0 / (problem.scales[o] * unit * np.sqrt(samples)) for o in problem.outputs))
        names = ("initial", "inverted", "linearised", "simulated")
        return cls(problem, pieces, unit, {n: jit(jax.vmap(getattr(local, n))) for n in names})

    def solve(self, z: Any, *, rounds: int = ROUNDS, weights: Sequence[float] = WEIGHTS) -> Shot:
        """Close the gaps from a cube point (d,), with at most `rounds` steps for each weight of continuity.

        With weight 1 jumps of one spread of each state count as much as outputs that explain nothing.
        Raises SearchError for a point of the wrong size or settings that cannot work.
        """
        z = self._checked(z, rounds, weights)
        path = _Path(self)
        point = path.begin(z)
        if point is None:
            return Shot(z, np.full((len(self.cut.record), 0), np.nan), np.inf, np.inf, path.evaluations)
        # the states first: wrong parameters must not be moved to make up for states that nobody has looked for yet
        point = path.rescaled(descend(path.linearise, point, weights[0], rounds, SETTLED, held=True))
        for weight in weights[:-1]:
            point = descend(path.linearise, point, weight, rounds, SETTLED)
        return path.shot(descend(path.linearise, point, weights[-1], rounds, SETTLED_LAST))

    def start(self, z: Any, *, rounds: int = ROUNDS, weights: Sequence[float] = WEIGHTS) -> np.ndarray:
        """The cube point (d,) where `solve` ends, or `z` itself if that costs less.

        Beside the plain cost there, the cost of closed segments counts: when a deviation grows by more than about e^30
        over the record, the plain cost is rounding errors grown large.
        """
        z = self._checked(z, rounds, weights)
        shot = self.solve(z, rounds=rounds, weights=weights)
        before, after = np.asarray(self.problem.costs(np.stack([z, shot.z])))
        return shot.z if after < before or (shot.closed and shot.cost < before) else z

    def search(
        self, *, starts: int = 8, seed: int = 0, rounds: int = ROUNDS, weights: Sequence[float] = WEIGHTS
    ) -> Shot:
        """The best of up to `starts` shots: from the guess of the space if it has one, then from uniform points.

        Values per recording begin at their guess or in their middle: the states that they begin at are looked for
        anyway. Ends early when two closed shots agree. A closed shot counts as better than an open one.
        """
        if starts < 1:
            raise SearchError(f"starts = {starts} of multiple shooting; give at least 1.")
        space, rng = self.problem.space, np.random.default_rng(seed)
        guess, own = space.start, np.array([c.recording is not None for c in space.coordinates])
        middle = np.full(space.dimension, 0.5) if guess is None else guess
        best: Shot | None = None
        for k in range(starts):
            z = guess if k == 0 and guess is not None else np.where(own, middle, rng.random(space.dimension))
            shot = self.solve(z, rounds=rounds, weights=weights)
            if best is not None and best.closed and shot.closed and abs(shot.cost - best.cost) <= AGREE * best.cost:
                return min(best, shot, key=_rank)
            best = shot if best is None else min(best, shot, key=_rank)
        assert best is not None
        return best

    def _checked(self, z: Any, rounds: int, weights: Sequence[float]) -> np.ndarray:
        z, d = np.asarray(z, dtype=float), self.problem.space.dimension
        if z.shape != (d,) or not np.all(np.isfinite(z)):
            raise SearchError(
                f"The start of multiple shooting has shape {z.shape}; give {d} finite numbers between 0 and 1."
            )
        if rounds < 1:
            raise SearchError(f"rounds = {rounds} of multiple shooting; give at least 1.")
        if len(weights) == 0 or min(weights) <= 0 or list(weights) != sorted(weights):
            raise SearchError(f"weights = {list(weights)} of multiple shooting; give positive numbers that grow.")
        return np.clip(z, 0.0, 1.0)


def shooting_start(
    problem: Problem,
    z: Any,
    *,
    segments: int | None = None,
    length: float | None = None,
    rounds: int = ROUNDS,
    weights: Sequence[float] = WEIGHTS,
) -> np.ndarray:
    """A better cube point (d,) for the plain problem, found by multiple shooting from `z` (d,); `z` itself if none is
    found.

    For many starts make one `Shooting.of(problem, ...)`, which compiles once. See `Shooting.of` for segments and
    length, `Shooting.solve` for the rest. Raises SearchError for settings that do not fit, SimulationError for a model
    without states.
    """
    return Shooting.of(problem, segments=segments, length=length).start(z, rounds=rounds, weights=weights)


class _Path:
    """Linearises along one solution and counts; states are scaled by their spread."""

    def __init__(self, shooting: Shooting):
        self.shooting, self.evaluations = shooting, 0
        self.scale = np.zeros(0)
        record = shooting.cut.record
        self.joined = np.append(record[1:] == record[:-1], False)

    def linearise(self, z: np.ndarray, s: np.ndarray) -> Point | None:
        """None where the segments cannot be simulated."""
        pieces, scale = self.shooting.cut, self.scale
        self.evaluations += 1
        result = self.shooting.functions["linearised"](z[pieces.local], s * scale, pieces.segments)
        rows, end, by = (np.array(a) for a in result)
        if not all(np.all(np.isfinite(a)) for a in (rows, end, by)):
            return None
        q = pieces.local.shape[1]
        rows[:, :, q:-1] *= scale
        by[:, :, q:] *= scale
        by /= scale[:, None]
        gap = np.where(self.joined[:, None], end / scale - np.roll(s, -1, axis=0), 0.0)
        return Point(z, s, Linear(rows, by, gap, self.joined, pieces.local))

    def begin(self, z: np.ndarray) -> Point | None:
        """Initial states from the measured outputs, or else from the model's initial state."""
        pieces, run = self.shooting.cut, self.shooting.functions
        local = z[pieces.local]
        initial = np.nan_to_num(np.asarray(run["initial"](local, pieces.segments)), posinf=0.0, neginf=0.0)
        inverted = np.asarray(run["inverted"](local, initial, pieces.segments))
        measured = np.where(pieces.segments.first[:, None] | ~np.isfinite(inverted), initial, inverted)
        for states in (measured, initial):
            self.scale = self._spread(z, states)
            if (point := self.linearise(z, states / self.scale)) is not None:
                return point
        return None

    def rescaled(self, point: Point) -> Point:
        """The same point with the spreads that the states have there."""
        before, states = self.scale, point.s * self.scale
        self.scale = self._spread(point.z, states)
        moved = self.linearise(point.z, states / self.scale)
        if moved is None:
            self.scale = before
        return moved or point

    def _spread(self, z: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Standard deviation (n,) of every state over all segments, its size where it stands still."""
        pieces = self.shooting.cut
        x = np.asarray(self.shooting.functions["simulated"](z[pieces.local], states, pieces.segments))  # (L, n, T)
        x = np.where(np.all(np.isfinite(x), axis=(1, 2), keepdims=True), x, states[:, :, None])
        spread, size = np.std(x, axis=(0, 2)), np.max(np.abs(x), axis=(0, 2))
        return np.where(spread > 1e-6 * size, spread, np.where(size > 0, size, 1.0))

    def shot(self, point: Point) -> Shot:
        cost = float(np.sum(point.linear.rows[:, :, -1] ** 2)) * self.shooting.unit**2
        gap = float(np.max(np.abs(point.linear.gap), initial=0.0))
        return Shot(point.z, point.s * self.scale, cost, gap, self.evaluations)


def _refuse(problem: Problem) -> None:
    name = problem.model.name
    if not problem.predictor.has_steps:
        raise SimulationError(f"Model {name!r} has no states, so there is nothing to shoot; use the plain fit.")
    if problem.predictor.stepping().vector.model.state_delays:
        raise SimulationError(
            f"Model {name!r} has late states, whose history a segment would have to guess; use the plain fit."
        )
    steady = [n for n, drive in problem.data["drive"].items() if not isinstance(drive, Drive)]
    if steady:
        raise SimulationError(
            f"Recording {steady[0]!r} is steady and cannot be cut "
            "into segments; make the problem for shooting without it."
        )


def _rank(shot: Shot) -> tuple[bool, float]:
    return not shot.closed, shot.cost


def _unit(problem: Problem) -> float:
    squares, count = 0.0, 0
    for output in problem.outputs:
        y = (
            np.concatenate([problem.data["measured"][name][output] for name in problem.data["drive"]])
            / problem.scales[output]
        )
        squares, count = squares + float(np.sum((y - np.mean(y)) ** 2)), count + len(y)
    return float(np.sqrt(squares / count)) or 1.0
