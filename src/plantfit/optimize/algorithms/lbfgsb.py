"""Multi-start L-BFGS-B."""

from dataclasses import dataclass
from typing import ClassVar

from plantfit.errors import Status
from plantfit.optimize.contract import Needs, Objective
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.one_search import lbfgsb
from plantfit.optimize.local.starts import generator, warm_then_uniform
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import integer

from jax import Array


@dataclass(frozen=True)
class Lbfgsb:
    """L-BFGS-B with the exact gradient from the warm starts, then from uniform points, until the budget
    is spent (Byrd, Lu, Nocedal and Zhu 1995, SIAM J. Sci. Comput. 16:1190; scipy's implementation)."""

    needs: ClassVar[Needs] = Needs(gradient=True)
    memory: int = integer(20, 1, 1000, "pairs of steps and gradient changes kept")
    max_steps: int = integer(1000, 1, 1_000_000, "most steps of one local search")

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        basins = Basins(counter.extra)
        for start in warm_then_uniform(objective.start, objective.dimension, generator(key)):
            basins.add(lbfgsb(counter, start, self.max_steps, self.memory))
        return Status.budget
