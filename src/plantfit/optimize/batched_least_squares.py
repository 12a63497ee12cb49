"""Bounded least squares from many starts side by side: one call evaluates the next step of all of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plantfit.optimize.basins import Basins
from plantfit.optimize.counter import Counter
from plantfit.optimize.local import Found

ENOUGH = 1e-4  # share of the predicted decrease that makes a step good
TOLERANCE = 1e-12  # relative decrease of the cost, or step, that ends a search
HOPELESS = 1e16  # damping that ends a search
DAMPING, EASIEST = 1e-3, 1e-14
WIDTH = 8  # searches side by side unless told otherwise: beyond it a step gains little and a small budget is spread thin
REACH = 30  # a search begins beside others only when each may take so many steps
FLAT = 1e-10  # smallest scale of a coordinate, as a share of the largest


@dataclass
class Lanes:
    """The searches under way; leading axis: search. `gradient` is J'r, `matrix` J'J, `cost` r'r, `scale` the column norms so far."""

    x: np.ndarray
    cost: np.ndarray
    gradient: np.ndarray
    matrix: np.ndarray
    scale: np.ndarray
    damping: np.ndarray
    growth: np.ndarray
    steps: np.ndarray
    independent: np.ndarray

    @classmethod
    def begin(cls, x: np.ndarray, independent: np.ndarray, evaluated: tuple[np.ndarray, np.ndarray, np.ndarray]) -> "Lanes":
        cost, gradient, matrix = evaluated
        n = len(x)
        scale = np.sqrt(np.einsum("bii->bi", matrix))
        return cls(x, cost, gradient, matrix, scale, np.full(n, DAMPING), np.full(n, 2.0), np.zeros(n, int), independent)

    def __getitem__(self, rows: np.ndarray) -> "Lanes":
        return Lanes(*(a[rows] for a in vars(self).values()))

    def __len__(self) -> int:
        return len(self.x)

    def join(self, other: "Lanes") -> "Lanes":
        return Lanes(*(np.concatenate(pair) for pair in zip(vars(self).values(), vars(other).values(), strict=True)))

    def propose(self) -> tuple[np.ndarray, np.ndarray]:
        """A damped Gauss-Newton step (b, d) of every lane inside the box, and the decrease (b,) that its model promises.

        Scaled by the largest column norms so far (More 1978, Lecture Notes in Mathematics 630:105, sec. 6). Coordinates
        on a bound that the gradient holds there stay; those that a step would carry outside end on the bound and
        the others are solved for again (projected Newton: Bertsekas 1982, SIAM J. Control Optim. 20:221).
        """
        n, d = self.x.shape
        scale = np.maximum(self.scale, np.maximum(FLAT * self.scale.max(axis=1, keepdims=True), 1e-150))
        scaled = self.matrix / (scale[:, :, None] * scale[:, None, :])
        slope = self.gradient / scale
        system = scaled + self.damping[:, None, None] * np.eye(d)
        low, high = -self.x * scale, (1.0 - self.x) * scale
        fixed = ((self.x <= 0.0) & (slope > 0)) | ((self.x >= 1.0) & (slope < 0))
        p = np.zeros((n, d))
        for _ in range(d + 1):
            held = np.where(fixed, p, 0.0)
            right = np.where(fixed, held, -slope - np.einsum("bij,bj->bi", system, held))
            free = ~(fixed[:, :, None] | fixed[:, None, :])
            p = np.linalg.solve(np.where(free, system, np.eye(d)), right[:, :, None])[:, :, 0]
            outside = ~fixed & ((p < low) | (p > high))
            if not np.any(outside):
                break
            p, fixed = np.clip(p, low, high), fixed | outside
        p = np.clip(p, low, high)
        promised = -np.sum(p * (2 * slope + np.einsum("bij,bj->bi", scaled, p)), axis=1)
        return p / scale, promised

    def take(
        self, step: np.ndarray, promised: np.ndarray, trial: np.ndarray, evaluated: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> np.ndarray:
        """Accept or refuse every step, choose the next dampings (Nielsen 1999, IMM-REP-1999-05, eq. 2.5); which lanes are done (b,)."""
        cost, gradient, matrix = evaluated
        gained = self.cost - cost
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(np.isfinite(cost) & (promised > 0), gained / promised, -1.0)
        good = ratio > ENOUGH
        small = np.linalg.norm(step, axis=1) <= TOLERANCE * (TOLERANCE + np.linalg.norm(self.x, axis=1))
        done = small | (np.abs(promised) <= TOLERANCE * self.cost) | (good & (gained <= TOLERANCE * self.cost))
        self.x = np.where(good[:, None], trial, self.x)
        self.cost = np.where(good, cost, self.cost)
        self.gradient = np.where(good[:, None], gradient, self.gradient)
        self.matrix = np.where(good[:, None, None], matrix, self.matrix)
        self.scale = np.maximum(self.scale, np.sqrt(np.einsum("bii->bi", self.matrix)))
        easier = self.damping * np.maximum(1 / 3, 1 - (2 * np.clip(ratio, 0, 2) - 1) ** 3)
        self.damping = np.maximum(np.where(good, easier, self.damping * self.growth), EASIEST)
        self.growth = np.where(good, 2.0, 2.0 * self.growth)
        self.steps = self.steps + 1
        return done | (self.damping > HOPELESS)


def side_by_side_least_squares(
    counter: Counter,
    starts: Iterator[tuple[np.ndarray, bool]],
    basins: Basins,
    *,
    width: int,
    agree: int,
    max_steps: int,
    searches: int = 0,
) -> None:
    """Searches from `starts` (points, and whether they are independent), `width` at a time; one that ends makes room for the next.

    Returns when `agree` independent searches ended in the best basin, of `searches` or more; raises BudgetSpent when not
    even one evaluation is left. Levenberg-Marquardt with exact Jacobians by normal equations, so that a step of all
    searches is a few matrix products.
    """
    charge = counter.objective.jacobian_charge
    lanes: Lanes | None = None
    while basins.hits < agree or basins.searches < searches:
        under_way = 0 if lanes is None else len(lanes)
        room = min(width, max(1, int(counter.remaining / (REACH * charge)))) - under_way
        if lanes is None or room > 0:
            begun = _begin(counter, starts, basins, max(room, 1), width)
            lanes = begun if lanes is None else lanes.join(begun)
            continue
        affordable = max(1, int(counter.remaining / charge))
        lanes = lanes[np.sort(np.argsort(lanes.cost, kind="stable")[:affordable])]
        step, promised = lanes.propose()
        trial = np.clip(lanes.x + step, 0.0, 1.0)
        done = lanes.take(step, promised, trial, _evaluate(counter, trial, width)) | (lanes.steps >= max_steps)
        for k in np.flatnonzero(done):
            basins.add(Found(lanes.x[k], float(lanes.cost[k])), bool(lanes.independent[k]))
        lanes = lanes[~done]


def _begin(counter: Counter, starts: Iterator[tuple[np.ndarray, bool]], basins: Basins, count: int, width: int) -> Lanes:
    """The next `count` starts, without those that cannot be simulated."""
    points, independent = zip(*(next(starts) for _ in range(count)), strict=True)
    x = np.clip(points, 0.0, 1.0)
    begun = Lanes.begin(x, np.asarray(independent), _evaluate(counter, x, width))
    works = np.isfinite(begun.cost)
    for failed in x[~works]:
        basins.add(Found(failed, np.inf, started=False))
    return begun[works]


def _evaluate(counter: Counter, x: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cost r'r / m (b,), J'r / m (b, d) and J'J / m (b, d, d); a failed point has cost +inf."""
    r, jacobian = counter.residuals_and_jacobians(x, width)
    cost = np.mean(r**2, axis=1)
    transposed = np.swapaxes(jacobian, 1, 2) / r.shape[1]
    matrix, gradient = transposed @ jacobian, (transposed @ r[:, :, None])[:, :, 0]
    return np.where(np.isnan(cost), np.inf, cost), gradient, matrix
