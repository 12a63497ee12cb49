"""Coordinate exchange: the levels of an input in blocks of equal length, one at a time, blocks halved in between."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)
FEWEST = 8  # blocks to begin with
GAIN = 1e-4  # of the cost, that counts as better


@dataclass
class Exchange:
    """The best levels (blocks, inputs) in [0, 1] that were found, and how many inputs were tried.

    (Meyer and Nachtsheim, Technometrics 37 (1995) 60.)
    """

    cost: Callable[[np.ndarray], float]
    budget: int
    tell: Callable[[int, float], None]
    tried: int = 0

    def of(self, levels: np.ndarray) -> float:
        """Cost of levels (blocks, inputs)."""
        self.tried += 1
        found = self.cost(levels)
        self.tell(self.tried, found)
        return found

    @property
    def over(self) -> bool:
        return self.tried >= self.budget

    def improved(
        self, levels: np.ndarray, cost: float, rng: np.random.Generator, grid: tuple[float, ...] = LEVELS
    ) -> tuple[np.ndarray, float]:
        """Levels at which no exchange of one of them for another of the grid is better, unless the budget ends
        first."""
        levels = levels.copy()
        while not self.over:
            before = cost
            for place in rng.permutation(levels.size):
                block, k = divmod(int(place), levels.shape[1])
                for level in grid:
                    if self.over or level == levels[block, k]:
                        continue
                    trial = levels.copy()
                    trial[block, k] = level
                    found = self.of(trial)
                    if found < cost - GAIN:
                        levels, cost = trial, found
            if not cost < before - GAIN:
                break
        return levels, cost

    def search(
        self, starts: Callable[[int], list[np.ndarray]], most: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, float]:
        """The best levels; `starts` gives those to begin from for a number of blocks, at most `most`."""
        blocks = min(FEWEST, most)
        best: tuple[np.ndarray, float] | None = None
        while True:
            begun = [(s, self.of(s)) for s in starts(blocks)]
            if best is not None:
                finer = _resampled(best[0], blocks)
                begun.append((finer, self.of(finer)))
            begun.sort(key=lambda pair: pair[1])
            found = [self.improved(levels, cost, rng) for levels, cost in begun[:2]]
            best = min([*found, *([best] if best is not None else [])], key=lambda pair: pair[1])
            if self.over or blocks >= most:
                return best
            blocks = min(2 * blocks, most)


def _resampled(levels: np.ndarray, blocks: int) -> np.ndarray:
    return levels[np.arange(blocks) * len(levels) // blocks]
