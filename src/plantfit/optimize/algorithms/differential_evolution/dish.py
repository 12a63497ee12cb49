"""DISH: jSO that weighs its successes by how far they moved."""

from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.differential_evolution.jso import Jso
from plantfit.optimize.settings import number

from jax import Array


@dataclass(frozen=True)
class Dish(Jso):
    """Distance based parameter adaptation for success-history based differential evolution (Viktorin, Senkerik,
    Pluhacek, Kadavy and Zamuda 2019, Swarm and Evolutionary Computation 50:100462).

    The weight of a success is ||u - x||, here in the unit cube so that units do not matter, in place of the gain in
    cost; p grows from `greed` to `last_greed`, M_F begins at 0.5 and the fixed slot is never written.
    """

    first_factor: ClassVar[float] = 0.5
    greed: float = number(0.125, 0.0, 1.0, "share of the population that counts as best in the mutation, at the start")
    last_greed: float = number(0.25, 0.0, 1.0, "the same share at the end of the budget")

    def slots(self) -> int:
        return self.history - 1

    def weights(self, gain: Array, distance: Array) -> Array:
        return distance
