"""The best runs' parameters, and whether runs of the same cost agree on them."""

from collections.abc import Mapping, Sequence

import numpy as np

from plantfit.findings.results.methods_compared import BestRuns, CostScale, PlacedRun, SameCostAnswer, SameCostAnswers
from plantfit.study.comparing.basins import Basin, optima
from plantfit.study.comparing.problem_runs import TIE, ProblemRuns, by_method, costs_of
from plantfit.study.store.records import RunRecord

SAME_COST = (
    1e-3  # of the gap from reference to best: answers this near the best are compared as optima of the same cost
)
KEPT_RUNS = 200  # best runs whose parameters are kept
KEPT_NAMES = 24  # parameters kept, those that differ most
KEPT_OPTIMA = 12


def best_runs(problem: ProblemRuns, groups: Mapping[str, list[RunRecord]]) -> BestRuns:
    """The best runs of each method with their place between the bounds, 0 to 1, and the parameters' values."""
    most = max(1, KEPT_RUNS // max(len(groups), 1))
    best = [
        r
        for own in groups.values()
        for r in sorted((r for r in own if np.isfinite(r.cost)), key=lambda r: r.cost)[:most]
    ]
    names = _names(problem)
    if len(best) < 2 or not names:
        return BestRuns(names=[], runs=[], left_out=0)
    places = np.array([r.x for r in best])
    kept = _telling(places)
    rows = [
        PlacedRun(
            method=r.method,
            run=r.run,
            cost=r.cost,
            place=[float(r.x[k]) for k in kept],
            value=[r.parameters.get(names[k]) for k in kept],
        )
        for r in best
    ]
    return BestRuns(names=[names[k] for k in kept], runs=rows, left_out=len(names) - len(kept))


def distinct_answers(problem: ProblemRuns, scale: CostScale | None) -> SameCostAnswers:
    """Distinct answers of the lowest cost."""
    runs, names = problem.runs, _names(problem)
    costs = costs_of(runs)
    finite = costs[np.isfinite(costs)]
    if not len(finite) or not names:
        return SameCostAnswers(within=0.0, groups=[], count=0, names=[])
    within = max(TIE * abs(float(finite.min())), SAME_COST * (scale.reference - float(finite.min())) if scale else 0.0)
    found = optima(costs, np.array([r.x for r in runs]), within)
    kept = _telling(np.array([b.x for b in found] + [b.x + b.spread for b in found]))
    groups = [_answer(b, runs, [names[k] for k in kept], kept) for b in found[:KEPT_OPTIMA]]
    widest = int(np.argmax(found[0].spread))
    return SameCostAnswers(
        within=within,
        groups=groups,
        count=len(found),
        names=[names[k] for k in kept],
        shares=[b.share for b in found],
        widest=(names[widest], float(found[0].spread[widest])),
    )


def _answer(group: Basin, runs: Sequence[RunRecord], names: Sequence[str], kept: Sequence[int]) -> SameCostAnswer:
    members = [runs[k] for k in group.members]
    return SameCostAnswer(
        cost=group.cost,
        runs=len(members),
        share=group.share,
        methods={m: len(own) for m, own in by_method(members).items()},
        place=[float(group.x[k]) for k in kept],
        spread=[float(group.spread[k]) for k in kept],
        value=[members[0].parameters.get(n) for n in names],
    )


def _names(problem: ProblemRuns) -> list[str]:
    size = len(problem.runs[0].x) if problem.runs else 0
    return list(problem.coordinates) if len(problem.coordinates) == size else [f"x{k + 1}" for k in range(size)]


def _telling(places: np.ndarray) -> list[int]:
    """The coordinates that differ most between rows (n, d), in their order."""
    spread = np.ptp(places, axis=0)
    return sorted(np.argsort(-spread, kind="stable")[:KEPT_NAMES].tolist())
