"""Sobol points: the baseline that covers the cube evenly."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, Status
from plantfit.optimize.contract import Needs, Objective
from plantfit.optimize.local.starts import generator
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import integer
from plantfit.sobol import MOST_DIMENSIONS, Sobol

from jax import Array


@dataclass(frozen=True)
class SobolSearch:
    """The warm starts, then the points of one scrambled Sobol sequence until the budget is spent (Sobol 1967, USSR
    Computational Mathematics and Mathematical Physics 7:86; scrambling of Matousek 1998, Journal of Complexity
    14:527; direction numbers of Joe and Kuo 2008, in scipy)."""

    needs: ClassVar[Needs] = Needs(baseline=True)
    batch: int = integer(256, 1, 100_000, "points that are evaluated at once")

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        d = objective.dimension
        if d > MOST_DIMENSIONS:
            raise SearchError(f"Sobol points exist up to {MOST_DIMENSIONS} dimensions, not {d}; choose 'random'.")
        warm = (
            np.zeros((0, d)) if objective.start is None else np.clip(np.asarray(objective.start, dtype=float), 0.0, 1.0)
        )
        warm = warm[:budget]
        if len(warm):
            counter.costs(warm)
        sequence = Sobol(d, generator(key))
        left = budget - len(warm)
        while left > 0:
            n = min(self.batch, left)
            counter.costs(sequence.random(n))
            left -= n
        return Status.budget
