"""Costs worth reaching: what the user asks for, the noise floor, and steps between random search and the best known cost."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from plantfit.study.store.records import RunRecord

DECADES = 8  # the finest target is 10^-8 of the way from random search to the best cost
PER_DECADE = 5
RESOLUTION = 1e-12  # relative difference below which a cost cannot be told from the best
RANDOM = "random"  # name of the baseline method


@dataclass(frozen=True)
class Target:
    """A cost to reach, and where it comes from: "asked for", "noise floor" or "10^-2"."""

    label: str
    cost: float


@dataclass(frozen=True)
class Scale:
    """What costs are measured against: `best` (the known optimum, else the lowest cost found) and `reference`.

    `reference` is the median final cost of random search; `source` says so, or that the median best cost after a
    run's first evaluations stands in for it because random search is not among the methods.
    """

    best: float
    reference: float
    source: str
    known: bool

    def at(self, decades: float) -> float:
        """The cost best + 10^-decades (reference - best)."""
        return self.best + 10.0**-decades * (self.reference - self.best)


def scale_of(runs: Iterable[RunRecord], optimum: float | None = None) -> Scale | None:
    """The scale of a problem from all runs on it; None without a finite cost or when nothing was gained."""
    runs = list(runs)
    finite = [r.cost for r in runs if np.isfinite(r.cost)]
    random = [r.cost for r in runs if r.method == RANDOM and np.isfinite(r.cost)]
    began = [first for r in runs if np.isfinite(first := _first_cost(r))]
    if not finite:
        return None
    best = min(finite) if optimum is None else optimum
    reference = float(np.median(random or began)) if random or began else float(np.median(finite))
    source = "median of random search" if random else "median at the start of the runs"
    return Scale(best, reference, source, optimum is not None) if reference > best else None


def targets(scale: Scale | None, *, asked: Sequence[float] = (), floor: float | None = None) -> list[Target]:
    """What a table of targets shows: those asked for, the noise floor, then 10^-1, 10^-2, ... as far as costs can be told apart."""
    found = [Target("asked for", float(t)) for t in asked]
    if floor is not None:
        found.append(Target("noise floor", floor))
    return found + [Target(f"10^-{k}", scale.at(k)) for k in range(1, DECADES + 1) if scale and told_apart(scale, k)]


def profile_targets(scale: Scale | None) -> np.ndarray:
    """Costs (t,) from the reference down to 10^-8 of the gap in fifths of a decade, for distribution functions."""
    if scale is None:
        return np.empty(0)
    steps = np.arange(DECADES * PER_DECADE + 1) / PER_DECADE
    return np.array([scale.at(k) for k in steps if told_apart(scale, k)])


def told_apart(scale: Scale, decades: float) -> bool:
    """Whether the target lies above the best cost by more than rounding."""
    return scale.at(decades) - scale.best > RESOLUTION * abs(scale.best)


def _first_cost(run: RunRecord) -> float:
    """Best cost at the first record of a run that has a finite one."""
    costs = np.asarray(run.history_cost, dtype=float)
    finite = costs[np.isfinite(costs)]
    return float(finite[0]) if len(finite) else float("nan")
