"""Hierarchic memetic strategy: a population that explores, and local ones that it starts where it pays."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from plantfit.errors import Status
from plantfit.optimize.algorithms.hierarchic.sprouting import (
    covered,
    far_enough,
    nearest_better,
    same_valley,
    spread_around,
)
from plantfit.optimize.algorithms.hierarchic.tree_population import Deme, Level, climbers, explorers
from plantfit.optimize.contract import Facts, Needs, Objective
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import integer, number

import jax
from jax import Array

WINDOW = 3  # metaepochs that the local stop rule looks at


@dataclass
class Tree:
    """All demes, the root first, then in the order in which they sprouted."""

    levels: list[Level]
    facts: Facts
    key: Array
    demes: list[Deme] = field(default_factory=list)

    def grow(
        self, level: int, seed: np.ndarray | None = None, step: float = 0.0, warm: np.ndarray | None = None
    ) -> Deme:
        """A new deme with a key of its own; `warm` points (k, d) join its first generation."""
        facts = self.facts if warm is None else self.facts._replace(start=np.clip(warm, 0.0, 1.0))
        deme = Deme(level, self.levels[level], facts, jax.random.fold_in(self.key, len(self.demes)), seed, step)
        self.demes.append(deme)
        return deme

    def active(self, level: int) -> list[Deme]:
        return [d for d in self.demes if d.level == level and d.active]

    def stopped(self, level: int) -> list[Deme]:
        return [d for d in self.demes if d.level == level and not d.active]

    @property
    def leader(self) -> Deme:
        return min(self.demes, key=lambda d: d.best_cost)


@dataclass(frozen=True)
class Hms:
    """Hierarchic memetic strategy (Smolka and Schaefer 2014, LNCS 8602:138; Sawicki, Los, Smolka and Schaefer 2022,
    Natural Computing 21:289): a tree of populations that search more finely from the root to the leaves.

    The root is simple evolution with steps that never shrink, the leaves are CMA-ES, between them may stand finer
    evolution. After each metaepoch every population that has a level below may start one child, from a head of a
    nearest-better cluster that is far from the active demes below and outside the basins of the stopped ones.
    Distances are those of the unit cube. The child's first step is the spread of its parent's points around it, at
    most `first_step`. A leaf stops when its mean costs settle, unless it holds the best point of the tree: that one
    goes on to its last digit. A root that stagnated begins anew, and the tree keeps its basins.
    On 6-D Rastrigin, 20 000 evaluations, medians of 21 runs at two places of the optimum: 2.0 and 1.0 with leaves of 18
    candidates that are looked at every 10 generations, 3.0 and 3.0 with 9 candidates and 20 generations.
    With more than 100 parameters the leaves are `dd_cmaes`: on the 310 of a steam chamber, 10 000 evaluations, 4 runs,
    a median of 49 times the noise floor; 119 with `cmaes`, 770 with 10 generations in a metaepoch.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=3)
    population: int | None = integer(
        None, 3, 100_000, "individuals of the root; by default 10 + 2 d, at most a twentieth of the budget"
    )
    mutation: float = number(0.25, 1e-6, 1.0, "steps of the root, as a share of each range")
    leaf_population: int | None = integer(
        None, 4, 100_000, "candidates per generation of a leaf; by default 8 + 6 ln(d)"
    )
    leaf_generations: int | None = integer(
        None, 1, 10_000, "generations of a leaf in one metaepoch; by default d / 4 and at least 10"
    )
    first_step: float = number(0.2, 1e-6, 1.0, "largest first step of a leaf, as a share of each range")
    levels: int = integer(2, 2, 4, "height of the tree")
    children: int = integer(4, 1, 1000, "most active demes of one level below the root")
    share: float = number(0.7, 0.01, 1.0, "share of the best individuals among which seeds are looked for")
    apart: float = number(
        2.0, 0.0, 100.0, "distance to the nearest better individual that makes a seed, and to active demes, in means"
    )
    tolerance: float = number(
        1e-3, 0.0, 1.0, "a leaf stops when its mean costs vary less than this share of its interquartile range"
    )
    valley_points: int = integer(
        0, 0, 100, "points evaluated between a seed and a stopped leaf to see whether a ridge parts them"
    )

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:  # pyrefly: ignore[unexpected-never]
        tree = Tree(self._levels(objective.dimension), Facts(objective.dimension, budget), key)
        tree.grow(0, warm=objective.start)
        counter.extra.update(leaves=0, root_share=1.0)
        while True:
            self.metaepoch(tree, counter)
            self._book(tree, counter)

    def metaepoch(self, tree: Tree, counter: Counter) -> None:
        """Every active deme searches, the deepest first; those that settled stop; the others may sprout."""
        for level in reversed(range(self.levels)):
            for deme in tree.active(level):
                deme.metaepoch(counter)
        if not tree.active(0):
            tree.grow(0)
        self._stop_settled(tree)
        self._sprout(tree, counter)

    def _levels(self, dimension: int) -> list[Level]:
        """Steps become finer by a fifth from level to level."""
        between = [explorers(self.population, self.mutation / 5**k) for k in range(self.levels - 1)]
        population = self.leaf_population or 2 * (4 + math.floor(3 * math.log(dimension)))
        return [*between, climbers(dimension, population, self.leaf_generations or max(10, dimension // 4))]

    def _stop_settled(self, tree: Tree) -> None:
        leader = tree.leader
        for level in range(1, self.levels):
            for deme in tree.active(level):
                if deme is not leader and deme.settled(WINDOW, self.tolerance):
                    deme.active = False

    def _sprout(self, tree: Tree, counter: Counter) -> None:
        for level in range(self.levels - 1):
            for parent in tree.active(level):
                if len(tree.active(level + 1)) >= self.children:
                    break
                x, f = parent.individuals
                heads, mean = nearest_better(x, f, self.share, self.apart)
                seed = next(
                    (x[i] for i in heads if self._free(tree, level + 1, x[i], float(f[i]), self.apart * mean, counter)),
                    None,
                )
                if seed is not None:
                    step = min(spread_around(seed, parent.points, 25 * len(seed)) or self.first_step, self.first_step)
                    tree.grow(level + 1, seed, step)

    def _free(self, tree: Tree, level: int, seed: np.ndarray, cost: float, radius: float, counter: Counter) -> bool:
        """Whether a seed lies away from all demes of its level, the active and the stopped."""
        if not far_enough(seed, (d.centre for d in tree.active(level)), radius):
            return False
        stopped = tree.stopped(level)
        if any(covered(seed, d.centre, d.covariance) for d in stopped):
            return False
        if not self.valley_points or not stopped:
            return True
        nearest = min(stopped, key=lambda d: float(np.linalg.norm(d.nested.best_x - seed)))
        return not same_valley(counter.costs, seed, cost, nearest.nested.best_x, nearest.best_cost, self.valley_points)

    def _book(self, tree: Tree, counter: Counter) -> None:
        roots = sum(d.nested.evaluations for d in tree.demes if d.level == 0)
        leaves = sum(d.level == self.levels - 1 for d in tree.demes)
        counter.extra.update(leaves=leaves, root_share=roots / max(counter.spent, 1.0))
