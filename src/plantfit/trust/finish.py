"""From the runs of a search to the final problem, and every run brought to its end on it."""

import dataclasses
from collections.abc import Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, Status
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.problem.steps import refined_at
from plantfit.study.basins import basins
from plantfit.trust.descent import STEPS, Descent, descent, polished
from plantfit.trust.smoothing_strength import choose_strengths
from plantfit.trust.weights import weighed

SEARCHES = 100  # runs that a local search goes on from, at most
SHARE = 0.1  # evaluations of these searches, as a share of what the runs spent; 200 Jacobians are always allowed
LEADS = 5  # answers that the final problem is made at, one after another, at most
SAME_POINT = 1e-6  # of the cube: runs that ended this near each other share one search
EXACT = 1e-12  # residuals that are rounding, as a share of the outputs
BETTER = 1e-6  # relative decrease of the cost that makes another answer the better one

SEARCHED, SHARED, CUT, LEFT = "searched", "same point", "cut", "left"  # how a run came to the final problem


def finish(problem: Problem, results: Sequence[RunResult]) -> tuple[Problem, list[RunResult]]:
    """The final problem, and the runs with the points and costs that a local search from each one's own end reaches there.

    Scales that nobody gave, steps and strengths of smoothing are chosen at the best answer. Every other run then goes on from its
    own point: runs at one point share a search, at most 100 are searched, first one of each basin. Where another run ends lower
    on the final problem, that answer becomes the best one and the final problem is made anew there. `extra["ended"]` of a run
    says what was done: "searched", "same point" as another run, "cut" before its end, or "left" where it stood; `extra["searched"]`
    has the point (d,) that the search had ended at. Histories keep the costs that they were made with. Raises SearchError when no
    run has a finite cost.
    """
    order = _order(results)
    if not order:
        raise SearchError(
            "No candidate of any run could be simulated: the outputs were not finite anywhere in the box. "
            "Check the equations at the middle of the bounds with `plantfit check`, narrow the bounds, or fill missing inputs."
        )
    allowed = max(SHARE * sum(r.evaluations for r in results), STEPS * problem.jacobian_charge)
    twins, ends, lead, led = _twins(results, order), {}, order[0], []
    while True:
        led.append(lead)
        ended = lead not in ends and results[lead].status is Status.converged
        final, own = _settled(problem, ends[lead].z if lead in ends else results[lead].x, ended)
        ends = _brought(final, {k: ends[k].z if k in ends else results[k].x for k in order if twins[k] == k}, {lead: own}, allowed)
        best = min(ends, key=lambda k: ends[k].cost)
        if best in led or len(led) == LEADS or ends[best].cost >= (1 - BETTER) * own.cost - rounding(final):
            break
        lead = best
    left = [k for k in order if twins[k] not in ends]
    costs = dict(zip(left, np.asarray(final.costs(np.array([results[k].x for k in left]))), strict=True)) if left else {}
    return final, [_result(k, r, twins.get(k), ends, costs) for k, r in enumerate(results)]


def rounding(problem: Problem) -> float:
    """A cost that means nothing: residuals that are rounding of the measured outputs."""
    measured = problem.data["measured"].values()
    scaled = np.concatenate([np.asarray(y) / problem.scales[o] for own in measured for o, y in own.items()])
    return EXACT**2 * float(np.mean(scaled**2))


def _order(results: Sequence[RunResult]) -> list[int]:
    """Runs with a finite cost: the best of each basin, lowest first, then the others."""
    costs = np.array([r.cost for r in results])
    groups = basins(costs, np.array([r.x for r in results]))
    return [g.members[0] for g in groups] + sorted((k for g in groups for k in g.members[1:]), key=lambda k: costs[k])


def _twins(results: Sequence[RunResult], order: Sequence[int]) -> dict[int, int]:
    """For every run of `order` the first one in it that ended at the same point."""
    twins, first = {}, np.zeros((0, len(results[order[0]].x)))
    owners: list[int] = []
    for k in order:
        near = np.flatnonzero(np.max(np.abs(first - results[k].x), axis=1, initial=0.0) <= SAME_POINT)
        twins[k] = owners[near[0]] if len(near) else k
        if not len(near):
            first, owners = np.vstack([first, results[k].x]), [*owners, k]
    return twins


def _settled(problem: Problem, z: np.ndarray, ended: bool) -> tuple[Problem, Descent]:
    """The problem with its scales, steps and strengths of smoothing chosen at the answer near z (d,), and a search to that answer's end.

    A search that `ended` there already gets its last digits only.
    """
    searched, last = problem, polished(problem, z) if ended else descent(problem, z)

    def search(changed: Problem, at: np.ndarray) -> np.ndarray:
        nonlocal searched, last
        searched, last = changed, descent(changed, at)
        return last.z

    problem, z = weighed(problem, last.z, search)
    finer = refined_at(problem, z)
    if finer is not problem:
        problem, z = finer, search(finer, z)
    if problem.smoothing is not None and problem.smoothing.asked:
        chosen = choose_strengths(problem, z)
        problem, z = chosen.problem, chosen.z
    if problem is not searched:
        search(problem, z)
    return problem, last


def _brought(problem: Problem, points: dict[int, np.ndarray], known: dict[int, Descent], allowed: float) -> dict[int, Descent]:
    """Searches to their end from `points` (d,), as far as `allowed` evaluations go; those `known` are not repeated."""
    ends = dict(known)
    for k, z in points.items():
        if k in ends:
            continue
        if allowed < 2 * problem.jacobian_charge or len(ends) > SEARCHES:
            break
        ends[k] = descent(problem, z, min(allowed, STEPS * problem.jacobian_charge))
        allowed -= ends[k].evaluations
    return ends


def _result(k: int, r: RunResult, twin: int | None, ends: dict[int, Descent], costs: dict[int, float]) -> RunResult:
    """A run with its end on the final problem; its history stays."""
    if twin is None:
        return r  # no finite cost
    if twin not in ends:
        return dataclasses.replace(r, cost=float(costs[k]), extra={**r.extra, "ended": LEFT})
    end = ends[twin]
    how = CUT if not end.ended else SEARCHED if twin == k else SHARED
    return dataclasses.replace(r, x=end.z, cost=end.cost, extra={**r.extra, "ended": how, "searched": np.asarray(r.x).tolist()})
