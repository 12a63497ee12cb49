"""DISH as the public package DISH_python behaves, and with its faults mended: a plain numpy reference for `dish`.

Written from a description of the faults, not from that code. With `faults=True`:
(1) the memory is updated to mean + old / 2, so M_F and M_CR approach 2 and F and CR saturate at 1;
(2) p is not multiplied by the population, so pbest is always one of the best two;
(3) the limits on CR are upper bounds; (4) M_CR begins at 0.5;
(5) the forced coordinate is drawn from d + 1 values, so that sometimes none is;
(6) a full archive keeps its fittest.
With `faults=False` these six are mended. (7) holds in both: a tie counts as a success. An eighth, distances in the
units of the box, cannot show here: the search is over the unit cube.
"""

import math
from collections.abc import Callable

import numpy as np

SLOTS = 5
FIXED = 0.9
LEAST = 4
LOW, HIGH = 0.0, 1.0

Generator = np.random.Generator


def dish_python(
    f: Callable[[np.ndarray], float], dimension: int, budget: int, seed: int, faults: bool = True
) -> tuple[np.ndarray, float, np.ndarray]:
    """Minimise f, of points (dimension,) in the unit cube, with at most `budget` evaluations.

    Returns (x, cost, history): the best point (dimension,), its cost, and the best cost (evaluations,) after each
    evaluation.
    """
    run = _Run(f, dimension, budget, np.random.default_rng(seed), faults)
    while run.spent < budget:
        run.generation()
    costs = np.array(run.costs)
    return run.best_x, run.best_cost, np.minimum.accumulate(costs)


class _Run:
    """One search; members stay sorted by cost."""

    def __init__(self, f: Callable[[np.ndarray], float], d: int, budget: int, rng: Generator, faults: bool):
        self.f, self.d, self.budget, self.rng, self.faults = f, d, budget, rng, faults
        self.costs: list[float] = []
        self.best_x, self.best_cost = np.zeros(d), np.inf
        self.first = max(LEAST, min(round(25 * math.log(d) * math.sqrt(d)), budget))
        self.x = rng.uniform(LOW, HIGH, (self.first, d))
        self.y = np.array([self._evaluate(x) for x in self.x])
        self._sort()
        self.archive, self.archive_y = np.zeros((0, d)), np.zeros(0)
        self.factor = np.full(SLOTS, 0.5)
        self.rate = np.full(SLOTS, 0.5 if faults else 0.8)  # (4)
        self.factor[-1] = self.rate[-1] = FIXED
        self.slot = 0

    @property
    def spent(self) -> int:
        return len(self.costs)

    @property
    def t(self) -> float:
        return self.spent / self.budget

    def _evaluate(self, x: np.ndarray) -> float:
        cost = float(self.f(x))
        cost = cost if math.isfinite(cost) else math.inf
        self.costs.append(cost)
        if cost < self.best_cost:
            self.best_x, self.best_cost = x.copy(), cost
        return cost

    def _sort(self) -> None:
        order = np.argsort(self.y, kind="stable")
        self.x, self.y = self.x[order], self.y[order]

    def generation(self) -> None:
        t, n = self.t, len(self.x)
        x, y, beaten, beaten_y = self.x.copy(), self.y.copy(), [], []
        kept: list[tuple[float, float, float]] = []  # F, CR, distance of the successes
        for i in range(min(n, self.budget - self.spent)):
            factor, rate = self._controls(t)
            trial = self._trial(i, factor, rate, t)
            cost = self._evaluate(trial)
            if cost > self.y[i]:
                continue
            x[i], y[i] = trial, cost
            kept.append((factor, rate, float(np.linalg.norm(trial - self.x[i]))))  # (7)
            beaten.append(self.x[i])
            beaten_y.append(self.y[i])
        self._store(beaten, beaten_y)
        if kept:
            self._learn(np.array(kept))
        self.x, self.y = x, y
        self._sort()
        size = max(LEAST, round(self.first - (self.first - LEAST) * self.t))
        self.x, self.y = self.x[:size], self.y[:size]
        self._trim(size)

    def _controls(self, t: float) -> tuple[float, float]:
        slot = self.rng.integers(SLOTS)
        rate = float(np.clip(self.rng.normal(self.rate[slot], 0.1), 0.0, 1.0))
        bound = 0.7 if t < 0.25 else 0.6 if t < 0.5 else None
        if bound is not None:
            rate = min(rate, bound) if self.faults else max(rate, bound)  # (3)
        factor = 0.0
        while factor <= 0:
            factor = self.factor[slot] + 0.1 * self.rng.standard_cauchy()
        factor = min(float(factor), 1.0)
        return min(factor, 0.7) if t < 0.6 else factor, rate

    def _trial(self, i: int, factor: float, rate: float, t: float) -> np.ndarray:
        n, rng = len(self.x), self.rng
        share = 0.125 + 0.125 * t
        top = 2 if self.faults else max(2, round(share * n))  # (2)
        pull = factor * (0.7 if t < 0.2 else 0.8 if t < 0.4 else 1.2)
        pool = np.concatenate([self.x, self.archive])
        r1 = rng.integers(n - 1)
        r1 += r1 >= i
        r2 = rng.integers(len(pool) - 2)
        for barrier in sorted((i, r1)):
            r2 += r2 >= barrier
        x = self.x[i]
        v = x + pull * (self.x[rng.integers(top)] - x) + factor * (self.x[r1] - pool[r2])
        v = np.where(v < LOW, (LOW + x) / 2, np.where(v > HIGH, (HIGH + x) / 2, v))
        crossed = rng.random(self.d) < rate
        forced = rng.integers(self.d + 1 if self.faults else self.d)  # (5)
        if forced < self.d:
            crossed[forced] = True
        return np.where(crossed, v, x)

    def _store(self, beaten: list[np.ndarray], beaten_y: list[float]) -> None:
        if beaten:
            self.archive = np.concatenate([self.archive, beaten])
            self.archive_y = np.concatenate([self.archive_y, beaten_y])
        self._trim(len(self.x))

    def _trim(self, size: int) -> None:
        if len(self.archive) > size:
            # (6)
            order = (
                np.argsort(self.archive_y, kind="stable") if self.faults else self.rng.permutation(len(self.archive))
            )
            self.archive, self.archive_y = self.archive[order[:size]], self.archive_y[order[:size]]

    def _learn(self, kept: np.ndarray) -> None:
        factor, rate, weights = kept.T
        weights = weights / weights.sum() if weights.sum() > 0 else np.full(len(weights), 1 / len(weights))
        for memory, values in ((self.factor, factor), (self.rate, rate)):
            total = float(weights @ values)
            mean = float(weights @ values**2) / total if total > 0 else 0.0
            old = memory[self.slot]
            memory[self.slot] = mean + old / 2 if self.faults else (mean + old) / 2  # (1)
        self.slot = (self.slot + 1) % (SLOTS - 1)
