"""Nelder-Mead simplex search from many starts: the baseline without derivatives."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy

from plantfit.errors import Status
from plantfit.optimize.contract import Needs, Objective
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.one_search import Found
from plantfit.optimize.local.starts import generator, warm_then_uniform
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import integer, number

from jax import Array

PRECISION = 1e-10


@dataclass(frozen=True)
class NelderMead:
    """Downhill simplex with coefficients that adapt to the dimension, clipped to the box, from the warm starts, then
    from uniform points, until the budget is spent (Nelder and Mead 1965, Computer Journal 7:308; Gao and Han 2012,
    Computational Optimization and Applications 51:259; scipy's implementation).

    A simplex that collapsed is spread once more around its best point, until that gains nothing: near a bound and in
    curved valleys it stops short of the optimum.
    """

    needs: ClassVar[Needs] = Needs()
    size: float = number(0.1, 1e-6, 1.0, "edge of the first simplex, as a share of each range")
    max_steps: int = integer(1_000_000, 1, 1_000_000, "most evaluations of one simplex")

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        rng = generator(key)
        basins = Basins(counter.extra)
        for start in warm_then_uniform(objective.start, objective.dimension, rng):
            basins.add(self._search(counter, start))
        return Status.budget

    def _search(self, counter: Counter, start: np.ndarray) -> Found:
        first = float(counter.costs(start)[0])
        if not np.isfinite(first):
            return Found(start, np.inf, started=False)
        enough = PRECISION * abs(first)
        found = self._descend(counter, Found(start, first), enough)
        while (again := self._descend(counter, found, enough)).cost < found.cost - enough:
            found = again
        return min(found, again, key=lambda f: f.cost)

    def _descend(self, counter: Counter, start: Found, enough: float) -> Found:
        """One simplex, until its corners agree to `enough` in cost and to PRECISION of the cube."""
        known = {start.x.tobytes(): start.cost}

        def cost(x: np.ndarray) -> float:
            kept = known.pop(x.tobytes(), None)
            return float(counter.costs(x)[0]) if kept is None else kept

        options: Any = {
            "adaptive": True,
            "initial_simplex": self._simplex(start.x),
            "xatol": PRECISION,
            "fatol": enough,
        }
        options |= {"maxfev": self.max_steps, "maxiter": self.max_steps}
        answer = scipy.optimize.minimize(
            cost, start.x, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(start.x), options=options
        )
        return Found(np.asarray(answer.x), float(answer.fun))

    def _simplex(self, start: np.ndarray) -> np.ndarray:
        """The start and a step along each coordinate, inwards where the cube is near."""
        steps = np.where(start + self.size <= 1.0, self.size, -self.size)
        return np.clip(np.vstack([start, start + np.diag(steps)]), 0.0, 1.0)
