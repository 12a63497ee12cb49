"""Least squares whose residuals fall into blocks with coordinates of their own: every block has its own trust region.

Fitting all blocks in one trust region lets the hardest one shorten the steps of all. Here each keeps
its own damping and begins anew on its own, and one evaluation of all residuals still serves all blocks.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy

from plantfit.errors import Status
from plantfit.optimize.loop.counter import Counter

ENOUGH = 1e-4  # of the predicted decrease
COARSE, FINE = 1e-5, 1e-8  # relative decrease that ends a search, and the last one
SAME = 0.01  # relative difference of costs that counts as the same answer
HOPELESS = 1e16  # damping that ends a search
DAMPING = 1e-2
LONG = (
    100  # evaluations of a search after which another start is tried first; twice as many each time this happens again
)
LARGEST = 1e150  # whose square is a number
FLAT = 1e-3  # smallest scale of a coordinate, as a share of the largest


def usable(residuals: np.ndarray, jacobian: np.ndarray) -> bool:
    """Whether a step can be made of residuals (k,) and derivatives (k, q): their squares have a sum."""
    return all(bool(np.all(np.abs(a) < LARGEST)) for a in (residuals, jacobian))  # not so of NaN


@dataclass
class Block:
    """The search of one block: its point (q,), residuals (k,), derivatives (k, q); and the answers found before."""

    own: np.ndarray
    x: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    tolerance: float = COARSE
    damping: float = DAMPING
    growth: float = 2.0
    scale: np.ndarray = field(default_factory=lambda: np.zeros(0))
    length: int = 0  # evaluations of this search
    patience: int = LONG
    done: bool = False
    fresh: bool = False  # x is a start that has not been evaluated yet
    found: list[tuple[float, np.ndarray]] = field(default_factory=list)
    ended: list[float] = field(default_factory=list)  # costs of the searches that came to their own end

    @property
    def cost(self) -> float:
        return float(self.residuals @ self.residuals)

    def step(self) -> tuple[np.ndarray, float]:
        """A damped Gauss-Newton step (q,) inside the box, and the decrease of the cost that the linear model promises.

        Scaling by the largest column norms so far: More 1978, Lecture Notes in Mathematics 630:105, sec. 6.
        """
        norms = np.linalg.norm(self.jacobian, axis=0)
        self.scale = np.maximum(norms, self.scale) if len(self.scale) else norms
        scale = np.maximum(self.scale, max(FLAT * float(np.max(self.scale)), 1e-300))
        rows = np.vstack([self.jacobian, np.sqrt(self.damping) * np.diag(scale)])
        right = np.r_[-self.residuals, np.zeros(len(scale))]
        low, high = -self.x, 1.0 - self.x
        p = np.linalg.lstsq(rows, right, rcond=None)[0]
        if np.any((p < low) | (p > high)):
            # an interval needs some width, also for a coordinate on its bound
            p = scipy.optimize.lsq_linear(rows, right, (low - 1e-15, high + 1e-15), method="bvls").x
        p = np.clip(p, low, high)
        linear = self.residuals + self.jacobian @ p
        return p, self.cost - float(linear @ linear)

    def update(self, p: np.ndarray, promised: float, residuals: np.ndarray, jacobian: np.ndarray) -> None:
        """Accept or refuse a step and choose the next damping (Nielsen 1999, IMM-REP-1999-05, eq. 2.5)."""
        finite = usable(residuals, jacobian)
        ratio = (self.cost - float(residuals @ residuals)) / promised if finite and promised > 0 else -1.0
        ends = promised <= self.tolerance * self.cost
        if ratio > ENOUGH:
            gained = self.cost - float(residuals @ residuals)
            self.x, self.residuals, self.jacobian = np.clip(self.x + p, 0.0, 1.0), residuals, jacobian
            self.done = ends or gained <= self.tolerance * self.cost
            self.damping *= max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            self.growth = 2.0
        else:
            self.damping *= self.growth
            self.growth *= 2.0
            self.done = ends or self.damping > HOPELESS

    def begin(self, x: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray) -> None:
        """Take up a start, or give it up at once when it cannot be simulated."""
        self.x, self.residuals, self.jacobian, self.fresh = x, residuals, jacobian, False
        self.damping, self.growth, self.scale, self.length = DAMPING, 2.0, np.zeros(0), 0
        self.done = not usable(residuals, jacobian)

    def next(self, rng: np.random.Generator, agree: int) -> None:
        """After a search: a new start, until the best answer was found `agree` times; then the best to its last
        digits."""
        if self.tolerance == FINE:
            return
        self.patience = LONG if self.done else 2 * self.patience
        if np.isfinite(self.cost):
            self.found.append((self.cost, self.x))
            if self.done:
                self.ended.append(self.cost)
        best = min((c for c, _ in self.found), default=np.inf)
        if sum(c <= best * (1.0 + SAME) for c, _ in self.found) >= agree:
            self.tolerance, self.fresh, self.x = FINE, True, min(self.found, key=lambda a: a[0])[1]
        else:
            self.fresh, self.x = True, rng.random(len(self.own))

    @property
    def crawls(self) -> bool:
        """Whether this search has become long: some crawl on for ten times the evaluations of the others and end
        nowhere."""
        return self.length >= self.patience and self.tolerance != FINE

    @property
    def finished(self) -> bool:
        """Whether the best answer was led to its last digits."""
        return self.done and not self.fresh and self.tolerance == FINE

    @property
    def answer(self) -> tuple[float, np.ndarray]:
        """The best cost and point so far."""
        here = [(self.cost, self.x)] if not self.fresh and np.isfinite(self.cost) else []
        return min([*self.found, *here], key=lambda a: a[0], default=(np.inf, self.x))


def separable_least_squares(counter: Counter, start: np.ndarray, *, agree: int, max_steps: int) -> Status:
    """The best answers of all blocks; the first search begins at `start`, later ones at random points.

    A block is searched until its best answer was found `agree` times, to within one percent of the cost, and that
    answer is then led to its last digits: the status is converged when this was done for every block. Of the searches
    only those that came to their own end are counted as hits. Further starts are drawn from a generator seeded with
    `start`.
    """
    groups = counter.objective.separable
    assert groups is not None
    x = np.clip(np.asarray(start, dtype=float), 0.0, 1.0)
    rng = np.random.default_rng(np.frombuffer(x.tobytes(), dtype=np.uint32))
    nothing = np.zeros(0)
    blocks = [Block(own, x[own], nothing, nothing, fresh=True) for own in groups]
    charge = counter.objective.jacobian_charge
    for _ in range(max_steps):
        if counter.remaining < 2 * charge:  # the last one is for all answers together
            break
        _advance(counter, x, blocks)
        for b in blocks:
            if (b.done or b.crawls) and not b.fresh:
                b.next(rng, agree)
        if all(b.done and not b.fresh for b in blocks):
            break
    for b in blocks:
        x[b.own] = b.answer[1]
    counter.blocks(x)
    hits = [sum(c <= b.answer[0] * (1.0 + SAME) for c in b.ended) for b in blocks]
    cut = max(len(b.found) - len(b.ended) for b in blocks)
    counter.extra.update(
        blocks=len(blocks), starts=min(len(b.ended) for b in blocks), basin_hits=min(hits), cut_searches=cut
    )
    return Status.converged if all(b.finished for b in blocks) else Status.budget


def _advance(counter: Counter, x: np.ndarray, blocks: list[Block]) -> None:
    """One evaluation, in which every block tries its next step or its new start."""
    trial = x.copy()
    steps = []
    for b in blocks:
        p, promised = (np.zeros(len(b.own)), 0.0) if b.fresh or b.done else b.step()
        steps.append((p, promised))
        trial[b.own] = np.clip(b.x + p, 0.0, 1.0)
    known = [(b.residuals, b.jacobian) if b.done and not b.fresh else None for b in blocks]
    for b, (p, promised), (r, j) in zip(blocks, steps, counter.blocks(trial, known), strict=True):
        if b.fresh:
            b.begin(trial[b.own], r, j)
        elif not b.done:
            b.length += 1
            b.update(p, promised, r, j)
