"""What is compared: all runs on one problem, and the few numbers that every part of a comparison needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plantfit.findings.results.methods_compared import CostScale
from plantfit.study.comparing.pairwise import levels
from plantfit.study.store.records import RunRecord

TIE = 1e-6  # relative difference below which two costs count as equal
ROUNDING = 1e-16  # of the gap from reference to best: absolute difference that means nothing


@dataclass(frozen=True)
class ProblemRuns:
    """All runs on one problem, whatever studies they come from.

    `floor` is the cost that noise alone leaves, `optimum` the lowest cost there can be, both None if not known.
    `budgets` are the evaluations that a run of each method was given.
    """

    name: str
    runs: tuple[RunRecord, ...]
    coordinates: tuple[str, ...] = ()
    budgets: Mapping[str, float] | None = None
    floor: float | None = None
    optimum: float | None = None
    studies: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()


def by_method(runs: Sequence[RunRecord]) -> dict[str, list[RunRecord]]:
    """Runs of each method, in order of appearance."""
    found: dict[str, list[RunRecord]] = {}
    for r in runs:
        found.setdefault(r.method, []).append(r)
    return found


def costs_of(runs: Sequence[RunRecord]) -> np.ndarray:
    return np.array([r.cost for r in runs], dtype=float)


def tied(costs: Mapping[str, np.ndarray], scale: CostScale | None) -> dict[str, np.ndarray]:
    """Costs as levels, equal where they differ by rounding only."""
    return levels(costs, TIE, ROUNDING * (scale.reference - scale.best) if scale else 0.0)


def median_of(costs: np.ndarray) -> float:
    """Median with failures as infinite costs."""
    with np.errstate(invalid="ignore"):
        return float(np.median(np.where(np.isnan(costs), np.inf, costs))) if len(costs) else float("nan")
