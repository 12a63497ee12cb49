"""Costs worth reaching: what the user asks for, the noise floor, and steps between random search and the best known
cost."""

from collections.abc import Iterable, Sequence

import numpy as np

from plantfit.findings.results.methods_compared import CostScale, CostTarget
from plantfit.study.store.records import RunRecord

DECADES = 8  # the finest target is 10^-8 of the way from random search to the best cost
PER_DECADE = 5
RESOLUTION = 1e-12  # relative difference below which a cost cannot be told from the best
RANDOM = "random"  # name of the baseline method


def scale_of(runs: Iterable[RunRecord], optimum: float | None = None) -> CostScale | None:
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
    return (
        CostScale(best=best, reference=reference, source=source, known=optimum is not None)
        if reference > best
        else None
    )


def targets(scale: CostScale | None, *, asked: Sequence[float] = (), floor: float | None = None) -> list[CostTarget]:
    """What a table of targets shows: those asked for, the noise floor, then 10^-1, 10^-2, ... as far as costs can be
    told apart."""
    found = [CostTarget(label="asked for", cost=float(t)) for t in asked]
    if floor is not None:
        found.append(CostTarget(label="noise floor", cost=floor))
    return found + [
        CostTarget(label=f"10^-{k}", cost=scale.at(k)) for k in range(1, DECADES + 1) if scale and told_apart(scale, k)
    ]


def profile_targets(scale: CostScale | None) -> np.ndarray:
    """Costs (t,) from the reference down to 10^-8 of the gap in fifths of a decade, for distribution functions."""
    if scale is None:
        return np.empty(0)
    steps = np.arange(DECADES * PER_DECADE + 1) / PER_DECADE
    return np.array([scale.at(k) for k in steps if told_apart(scale, k)])


def told_apart(scale: CostScale, decades: float) -> bool:
    """Whether the target lies above the best cost by more than rounding."""
    return scale.at(decades) - scale.best > RESOLUTION * abs(scale.best)


def _first_cost(run: RunRecord) -> float:
    """Best cost at the first record of a run that has a finite one."""
    costs = np.asarray(run.history_cost, dtype=float)
    finite = costs[np.isfinite(costs)]
    return float(finite[0]) if len(finite) else float("nan")
