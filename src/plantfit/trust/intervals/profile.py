"""How far one parameter can move while all others follow: an interval by likelihood ratio, sound for correlated
residuals."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.problem.problem import Problem
from plantfit.trust.finish.refit import refit
from plantfit.trust.finish.unknown_noise import as_known
from plantfit.trust.intervals.covariance import (
    box_prior,
    inverse_beside,
    known_variance,
    normal_matrix,
    own_student,
    sandwich,
)
from plantfit.trust.intervals.first_values import FreeStarts, free_starts
from plantfit.trust.intervals.linearised import EDGE, residual_blocks
from plantfit.trust.intervals.ranges import degrees_left
from plantfit.trust.intervals.robust_or_classical import robust_errors

STEPS = 12  # points to either side at most
CLOSE = 0.03  # of the interval's half width: how near an end is found
BETTER = 1e-3  # of the threshold: a profile that falls so much has found a better answer


@dataclass(frozen=True)
class Profile:
    """A parameter in its unit: its best `value`, the interval from `low` to `high`, and whether the box cut an end of
    it.

    `points` (n,) and `excess` (n,): values tried, in order, and by how much chi-squared grew there, all others
    refitted; `threshold`: that of the level, times `inflation`, the robust variance of the value over that of white
    residuals (1 where errors are classical). `answer` (d,): the cube point with the lowest cost met.
    """

    name: str
    unit: str | None
    value: float
    low: float
    high: float
    at_lower: bool
    at_upper: bool
    points: np.ndarray
    excess: np.ndarray
    threshold: float
    inflation: float
    answer: np.ndarray


def profile(problem: Problem, answer: Any, name: str, level: float = 0.95) -> Profile:
    """The interval of the coordinate `name` that the recordings leave at `level`.

    `answer` is a cube point (d,) or what `fit` returns. The coordinate is moved to either side and the others are
    fitted anew, by bounded least squares. An end is where the sum of squares has grown by the residual variance times
    the square of Student's t, with as many degrees of freedom as samples are left, times the ratio of the sandwich to
    the plain variance (Kent, Biometrika 69 (1982) 19, sec. 3: what the likelihood ratio of one parameter is distributed
    as when the residuals are not white). With classical errors residuals are taken as white. Starts that the
    fit has estimated are free as the others are. Raises SpaceError for an unknown name.
    """
    names = problem.space.names
    if name not in names:
        raise SpaceError(f"There is no parameter {name!r} to profile; free are {list(names)}.")
    place, problem = names.index(name), as_known(problem)
    walk = _Walk(problem, np.array(getattr(getattr(answer, "best", None), "x", answer), dtype=float), place)
    for _ in range(4):  # again from a better answer that a side has met
        variance, inflation, degrees = _spread(problem, walk.best, place, walk.starts)
        threshold = float(stdtrit(degrees, 0.5 + level / 2)) ** 2 * inflation
        walk.begin(variance, threshold)
        if all([walk.side(-1.0), walk.side(1.0)]):
            break
    z = np.array(sorted(walk.excess))
    excess = np.array([walk.excess[v] for v in z])
    physical = walk.physical
    low, high = walk.end(z, excess, -1.0), walk.end(z, excess, 1.0)
    coordinate = problem.space.coordinates[place]
    return Profile(
        name, coordinate.unit, float(physical(walk.best[place])[0]), float(physical(low)[0]), float(physical(high)[0]),
        bool(low <= EDGE), bool(high >= 1 - EDGE), physical(z), excess, threshold, inflation, walk.best,
    )  # fmt: skip


class _Walk:
    """Refits with one coordinate held: sums of squares, and answers to begin the next refit from."""

    def __init__(self, problem: Problem, start: np.ndarray, place: int):
        self.problem, self.place = problem, place
        self.own = np.arange(len(start))
        for group in problem.separable or ():  # others have no part in it
            if place in group:
                self.own = np.asarray(group)
        self.starts = free_starts(problem.unsmoothed, start, residual_blocks(problem))
        self.best, self.least = refit(problem, start, np.isin(np.arange(len(start)), self.own), starts=self.starts)
        self.excess: dict[float, float] = {}

    def begin(self, variance: float, threshold: float) -> None:
        at = float(self.best[self.place])
        self.variance, self.threshold = variance, threshold
        self.excess, self.solved = {at: 0.0}, {at: self.best}

    def side(self, sign: float) -> bool:
        """Find the end on one side; False when a better answer was met on the way."""
        at = float(self.best[self.place])
        edge = 0.0 if sign < 0 else 1.0
        inside, outside, step = at, None, 0.02
        for _ in range(STEPS):
            here = float(np.clip(inside + sign * step, 0.0, 1.0)) if outside is None else 0.5 * (inside + outside)
            if outside is not None:
                here = self._guess(inside, outside, at)
            if here == inside:
                break
            grown = self._grown(here)
            if grown < -BETTER * self.threshold:
                return False
            if grown > self.threshold:
                outside = here
            else:
                inside, step = here, 2.0 * step
            if (outside is None and inside == edge) or (
                outside is not None and abs(outside - inside) <= CLOSE * abs(outside - at)
            ):
                break
        return True

    def end(self, z: np.ndarray, excess: np.ndarray, sign: float) -> float:
        """Where the excess passes the threshold on one side, its root linear between points as it is for a parabola;
        else the bound."""
        at = float(self.best[self.place])
        order = np.argsort(sign * z)
        z, root = z[order], np.sqrt(np.maximum(excess[order], 0.0))
        later = sign * (z - at) >= 0
        z, root, top = z[later], root[later], np.sqrt(self.threshold)
        beyond = np.flatnonzero(root > top)
        if not len(beyond):
            return 0.0 if sign < 0 else 1.0
        k = beyond[0]
        share = (top - root[k - 1]) / (root[k] - root[k - 1])
        return float(z[k - 1] + share * (z[k] - z[k - 1]))

    def physical(self, z: Any) -> np.ndarray:
        """Values in the unit of the parameter, (n,), of places on its edge of the cube."""
        points = np.repeat(self.best[None], np.size(z), axis=0)
        points[:, self.place] = z
        return np.asarray(self.problem.space.physical(points))[:, self.place]

    def _guess(self, inside: float, outside: float, at: float) -> float:
        """Between two points, by the secant of the root; kept off both ends."""
        top, low, high = (np.sqrt(max(v, 0.0)) for v in (self.threshold, self.excess[inside], self.excess[outside]))
        share = np.clip((top - low) / max(high - low, 1e-300), 0.02, 0.98)
        nudge = 0.5 * CLOSE * abs(outside - at) / abs(outside - inside)
        return inside + float(np.clip(share + (nudge if share < 0.5 else -nudge), 0.02, 0.98)) * (outside - inside)

    def _grown(self, here: float) -> float:
        free = np.isin(np.arange(len(self.best)), self.own)
        free[self.place] = False
        # from the neighbour and from the answer: a flat valley has many shallow ends
        tried = []
        for start in {
            id(v): v for v in (self.solved[min(self.solved, key=lambda v: abs(v - here))], self.best)
        }.values():
            moved = start.copy()
            moved[self.place] = here
            tried.append(refit(self.problem, moved, free, starts=self.starts))
        point, squares = min(tried, key=lambda a: a[1])
        self.solved[here], self.excess[here] = point, (squares - self.least) / self.variance
        if squares < self.least:
            self.best, self.least = point, squares
        return self.excess[here]


def _spread(problem: Problem, z: np.ndarray, place: int, starts: FreeStarts | None) -> tuple[float, float, float]:
    """Variance of the residuals, the variance of one coordinate as the covariance has it (`sandwich`, `own_student`)
    over the plain one, and the degrees of freedom of Student's t."""
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    if starts is not None:
        jacobian = starts.left(jacobian)[: len(residuals)]
    free = (z > EDGE) & (z < 1 - EDGE)
    free[place] = True
    place_in, jacobian = int(np.sum(free[:place])), jacobian[:, free]
    blocks = residual_blocks(problem)
    least = max(known_variance(blocks, len(residuals), int(free.sum())), np.finfo(float).tiny)
    variance = max(float(residuals @ residuals) / max(1, len(residuals) - int(free.sum())), least)
    hessian = normal_matrix(jacobian, blocks) / variance
    curved = hessian if problem.smoothing is None else hessian + problem.smoothing.matrix[np.ix_(free, free)] / variance
    whole = inverse_beside(curved, box_prior(curved))
    bread = whole[place_in]
    plain = float(bread @ hessian @ bread)
    in_time = robust_errors(problem, residuals, blocks)
    samples, _, degrees = degrees_left(residuals, blocks, len(whole), in_time)
    left = max(1, len(residuals) - len(whole))
    robust = sandwich(jacobian, residuals, blocks, whole, np.zeros_like(whole), variance, left, in_time)
    longer = own_student(jacobian, residuals, blocks, whole, variance, samples - len(whole))[place_in]
    return variance, longer**2 * float(robust[place_in, place_in]) / max(plain, np.finfo(float).tiny), degrees
