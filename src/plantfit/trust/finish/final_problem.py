"""From the runs of a search to the final problem, and every run brought to its end on it."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, Status
from plantfit.optimize.contract import RunResult
from plantfit.problem.accuracy.steps import EXACT, finer_at, refined_at
from plantfit.problem.accuracy.verification import checked_cost, least_exact
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.missed import missed_answer
from plantfit.simulate.simulator import Drive
from plantfit.study.comparing.basins import basins
from plantfit.trust.finish.descent import STEPS, Descent, descent, polished
from plantfit.trust.finish.smoothing_strength import choose_strengths
from plantfit.trust.finish.start_corrections import with_start_corrections
from plantfit.trust.finish.weights import weighed

SEARCHES = 100  # runs that a local search goes on from, at most
SHARE = 0.1  # evaluations of these searches, as a share of what the runs spent; 200 Jacobians are always allowed
LEADS = 5  # answers that the final problem is made at, one after another, at most
SAME_POINT = 1e-6  # of the cube: runs that ended this near each other share one search
ROUNDED = 1e-12  # residuals that are rounding, as a share of the outputs
BETTER = 1e-6  # relative decrease of the cost that makes another answer the better one
BEYOND = 0.9  # of the cost of an answer, below which multiple shooting has found another one

CHECKED = 150_000  # evaluations of the tight solver at an answer, all recordings together: some 4 s
MOST_CHECKED = 4  # recordings, those with the largest step errors
ROUNDS = 3  # times that steps are chosen at an answer and a search goes on with them
FINER = 6  # times that steps are made finer at one answer because the tight solver asks for it, at most

SEARCHED, SHARED, CUT, LEFT = "searched", "same point", "cut", "left"  # how a run came to the final problem
REFUSED = "refused"  # its answer exists in the integrator only
SHOT = "segments"  # found by multiple shooting
SEARCHERS = ("auto", "least_squares")  # local searches, whose answer multiple shooting may better


def finish(problem: Problem, results: Sequence[RunResult]) -> tuple[Problem, list[RunResult]]:
    """The final problem, and the runs with the points and costs that a local search from each one's own end reaches
    there.

    Scales that nobody gave, steps and strengths of smoothing are chosen at the best answer. Every other run then goes
    on from its own point: runs at one point share a search, at most 100 are searched, first one of each basin. Where
    another run ends lower on the final problem, that answer becomes the best one and the final problem is made anew
    there. `extra["ended"]` of a run says what was done: "searched", "same point" as another run, "cut" before its end,
    "left" where it stood, or "segments" (below); `extra["searched"]` has the point (d,) that the search had ended at.

    An answer that takes the lead is simulated by an independent solver (`checked_cost`). Is the cost off by more than 1
    %, the search goes on with finer steps; can the solver not follow, the answer is "refused" (`extra["refused"]` says
    where), has an infinite cost, and the next basin takes the lead. Are all refused that were looked at, the last one
    stays with its cost.

    Where the answer of local searches does not follow its record, multiple shooting is tried (`missed_answer`). Has it
    found a better one, that becomes the end of the best run: its `extra["segments"]` has the number of segments,
    `extra["missed"]` how many times as large the RMSE was.

    Histories keep the costs that they were made with. Raises SearchError when no run has a finite cost.
    """
    order = _order(results)
    if not order:
        raise SearchError(
            "No candidate of any run could be simulated: the outputs were not finite anywhere in the box. Check the "
            "equations at the middle of the bounds with `plantfit check`, narrow the bounds, or fill missing inputs."
        )
    allowed = max(SHARE * sum(r.evaluations for r in results), STEPS * problem.jacobian_charge)
    twins = _twins(results, order)
    firsts = [k for k in order if twins[k] == k]
    refused: dict[int, str] = {}
    led: list[int] = []
    final: _Final | None = None
    lead: int | None = order[0]
    while lead is not None:
        led.append(lead)
        begun = final.ends[lead].z if final and lead in final.ends else None
        ended = begun is None and results[lead].status is Status.converged
        made, own, said, stopped = _confirmed(*_settled(problem, results[lead].x if begun is None else begun, ended))
        if stopped:
            refused.update(dict.fromkeys((twins[k] for k in _basin(results, lead)), stopped))
            lead = _behind_refused([k for k in firsts if k not in refused], final, led)
            if lead is None and final is None:  # no answer that was looked at can be followed: the verdict says so
                final = _Final(made, {led[-1]: own}, "")
        else:
            points = {
                k: final.ends[k].z if final and k in final.ends else results[k].x for k in firsts if k not in refused
            }
            final = _Final(made, _brought(made, points, {lead: own}, allowed), said)
            lead = _better(final, own, led)
    assert final is not None
    shot = _shot(problem, final, refused, allowed) if all(map(_may_miss, results)) else None
    final = shot.final if shot else final
    ends = {k: end for k, end in final.ends.items() if k not in refused} or final.ends
    left = [k for k in order if twins[k] not in ends and twins[k] not in refused]
    costs = (
        dict(zip(left, np.asarray(final.problem.costs(np.array([results[k].x for k in left]))), strict=True))
        if left
        else {}
    )
    found = [_result(k, r, twins.get(k), ends, costs, refused) for k, r in enumerate(results)]
    best = min(range(len(found)), key=lambda k: found[k].cost)
    told: dict[str, Any] = {"steps": final.told} if final.told else {}
    if shot and twins.get(best) == shot.run:
        told |= {"segments": shot.segments, "missed": shot.missed}
        told |= {"ended": SHOT} if found[best].extra["ended"] != CUT else {}
    found[best] = dataclasses.replace(found[best], extra={**found[best].extra, **told}) if told else found[best]
    return final.problem, found


def _may_miss(r: RunResult) -> bool:
    """Whether a run is of local searches over whole records, and no linear problem that one step solves."""
    return r.method in SEARCHERS and not r.extra.get("linear")


@dataclasses.dataclass(frozen=True)
class _Final:
    """A final problem, how searches by run ended on it, and what is to be told of its steps."""

    problem: Problem
    ends: dict[int, Descent]
    told: str


@dataclasses.dataclass(frozen=True)
class _Shot:
    """The final problem at an answer found by multiple shooting, with so many segments, as the end of `run`; the RMSE
    was `missed` times as large before."""

    final: _Final
    run: int
    segments: int
    missed: float


def _shot(problem: Problem, final: _Final, refused: Mapping[int, str], allowed: float) -> _Shot | None:
    """A better answer by multiple shooting where the best one does not follow its record; None where none was found, or
    the independent solver cannot follow it."""
    ends = {k: end for k, end in final.ends.items() if k not in refused}
    if not ends:
        return None
    best = min(ends, key=lambda k: ends[k].cost)
    before = ends[best]
    if (found := missed_answer(final.problem, before.z)) is None:
        return None
    end = descent(final.problem, found[0])
    if not end.ended or end.cost >= BEYOND * before.cost:
        return None
    made, own, said, stopped = _confirmed(*_settled(problem, end.z, False))
    if stopped:
        return None
    brought = _brought(made, {k: e.z for k, e in ends.items()}, {best: own}, allowed)
    missed = float(np.sqrt(before.cost / max(end.cost, rounding(final.problem))))
    return _Shot(_Final(made, brought, said), best, found[1], missed)


def _better(final: _Final, own: Descent, led: Sequence[int]) -> int | None:
    """The run that ended lower on the final problem than the answer it was made at, if it may take the lead."""
    best = min(final.ends, key=lambda k: final.ends[k].cost)
    lower = final.ends[best].cost < (1 - BETTER) * own.cost - rounding(final.problem)
    return best if lower and best not in led and len(led) < LEADS else None


def _behind_refused(rest: Sequence[int], final: _Final | None, led: Sequence[int]) -> int | None:
    """The run of `rest` that takes the lead after one that was refused: the next one in order of what they reached."""
    if final is not None:
        rest = sorted((k for k in rest if k in final.ends), key=lambda k: final.ends[k].cost)
    return rest[0] if rest and rest[0] not in led and len(led) < LEADS else None


def _basin(results: Sequence[RunResult], lead: int) -> tuple[int, ...]:
    """The runs of the same basin as this one: their answer is the same."""
    groups = basins(np.array([r.cost for r in results]), np.array([r.x for r in results]))
    return next(g.members for g in groups if lead in g.members)


def _confirmed(problem: Problem, own: Descent) -> tuple[Problem, Descent, str, str | None]:
    """The problem with steps as fine as an independent solver asks for, and the search gone on there; what is to be
    said; why refused.

    The cost of the tight solution has to be that which is reported to 1 % (`CheckedCost.confirmed`), over the
    recordings whose steps are least exact. Steps that the user chose stay.
    """
    if not problem.predictor.has_steps or not any(isinstance(d, Drive) for d in problem.data["drive"].values()):
        return problem, own, "", None
    first, share = None, EXACT
    worst = least_exact(problem, own.z)[:MOST_CHECKED]
    check = partial(checked_cost, evaluations=CHECKED // len(worst), recordings=worst)
    for _ in range(FINER):
        told = check(problem, own.z)
        if told.stopped:
            return problem, own, "", told.refused
        if told.confirmed or not np.isfinite(told.cost_checked):
            break
        first = told.off if first is None else first
        finer = finer_at(problem, own.z, share)
        if finer is None:
            break
        share /= 3.0
        problem, own = _weighed(finer, descent(finer, own.z))
    else:
        told = check(problem, own.z)
        if told.stopped:
            return problem, own, "", told.refused
    if first is None:
        return problem, own, "", None
    text = f"At the answer the cost of an independent solver was {_percent(first)} off, so that the fit "
    if told.confirmed:
        return problem, own, f"{text}went on with finer steps; now it is {_percent(told.off)} off.", None
    kind = (
        "would need finer steps than were chosen"
        if problem.substeps_chosen
        else "went on with finer steps as far as they are made"
    )
    return problem, own, f"{text}{kind}; it is still {_percent(told.off)} off, more than 1 %.", None


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def rounding(problem: Problem) -> float:
    """A cost that means nothing: residuals that are rounding of the measured outputs."""
    measured = problem.data["measured"].values()
    scaled = np.concatenate([np.asarray(y) / problem.scales[o] for own in measured for o, y in own.items()])
    return ROUNDED**2 * float(np.mean(scaled**2))


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
    """The problem with its scales, steps and strengths of smoothing chosen at the answer near z (d,), and a search to
    that answer's end.

    A search that `ended` there already gets its last digits only.
    """
    problem, last = _weighed(problem, polished(problem, z) if ended else descent(problem, z))
    begun = with_start_corrections(problem, last)
    problem, last = (problem, last) if begun[0] is problem else _weighed(*begun)
    for _ in range(ROUNDS):
        finer = refined_at(problem, last.z)
        if finer is problem:
            break
        problem, last = finer, descent(finer, last.z)
        if problem.mesh or len(problem.data["drive"]) == 1:
            break  # of several recordings with equal steps one may want finer ones where the search has gone since
    if problem.smoothing is not None and problem.smoothing.asked:
        chosen = choose_strengths(problem, last.z)
        problem, last = chosen.problem, descent(chosen.problem, chosen.z)
    return problem, last


def _weighed(problem: Problem, last: Descent) -> tuple[Problem, Descent]:
    """The problem with scales that its residuals show, and the end of the search there; `last` is that with the
    scales it has."""
    searched = problem

    def search(changed: Problem, at: np.ndarray) -> np.ndarray:
        nonlocal searched, last
        searched, last = changed, descent(changed, at)
        return last.z

    problem, z = weighed(problem, last.z, search)
    return problem, last if problem is searched else descent(problem, z)


def _brought(
    problem: Problem, points: dict[int, np.ndarray], known: dict[int, Descent], allowed: float
) -> dict[int, Descent]:
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


def _result(
    k: int,
    r: RunResult,
    twin: int | None,
    ends: dict[int, Descent],
    costs: dict[int, float],
    refused: Mapping[int, str],
) -> RunResult:
    """A run with its end on the final problem; its history stays."""
    if twin is None:
        return r  # no finite cost
    if twin in refused:
        cost = ends[twin].cost if twin in ends else np.inf  # finite only where nothing else is left to report
        x = ends[twin].z if twin in ends else r.x
        return dataclasses.replace(r, x=x, cost=cost, extra={**r.extra, "ended": REFUSED, "refused": refused[twin]})
    if twin not in ends:
        return dataclasses.replace(r, cost=float(costs[k]), extra={**r.extra, "ended": LEFT})
    end = ends[twin]
    how = CUT if not end.ended else SEARCHED if twin == k else SHARED
    return dataclasses.replace(
        r, x=end.z, cost=end.cost, extra={**r.extra, "ended": how, "searched": np.asarray(r.x).tolist()}
    )
