"""Which runs reach the reported answer on the final problem, and whether answers of one cost are one model."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.errors import Status
from plantfit.findings.record import Number
from plantfit.findings.runs import Agreement, DistinctAnswer, SameModel
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.study.comparing.basins import Basin, optima
from plantfit.study.comparing.symmetry import NEAR, Symmetry, same_by_symmetry
from plantfit.trust.finish.final_problem import CUT, LEFT, rounding

SAME = 1e-6  # relative difference of costs that counts as the same
OUTSIDE = 1e-9  # of a value: what rounding may carry an answer outside of an interval
COMPARED = 12  # distinct answers that are looked at for exchanges and signs


def agreement(problem: Problem, runs: Sequence[RunResult]) -> Agreement:
    """The section "agreement" of the findings record.

    A run reaches the reported answer when its own search came to its end at the lowest cost, to a millionth or to rounding. Of
    these `answers` tells the distinct ones, and `symmetries` which exchanges and signs make two answers the same, also where all runs
    report one of them and only their local searches met the others.
    """
    costs = np.array([r.cost for r in runs])
    best = float(np.min(costs))
    within = SAME * best + rounding(problem)
    own = [k for k, r in enumerate(runs) if np.isfinite(r.cost) and r.extra.get("ended") not in (CUT, LEFT)]
    reached = [k for k in own if costs[k] <= best + within]
    names = problem.space.names
    x = np.array([runs[k].x for k in reached]).reshape(len(reached), len(names))
    groups, found, plain = distinct(problem, costs[reached], x, within)
    found = _with_others(problem, found, x, [z for k in reached for z in runs[k].extra.get("elsewhere", ())])
    values = np.asarray(problem.space.physical(x[plain])) if len(plain) else np.zeros((0, len(names)))
    return Agreement(
        runs=len(runs),
        agree=len(reached),
        cost=best,
        ranges={n: [float(v.min()), float(v.max())] for n, v in zip(names, values.T, strict=True)} if len(plain) else {},
        spent=sum(r.status is Status.budget for r in runs),
        spent_and_searched=sum(r.status is Status.budget and r.extra.get("ended") != LEFT for r in runs),
        spent_and_agree=sum(runs[k].status is Status.budget for k in reached),
        cut=sum(r.extra.get("ended") == CUT for r in runs),
        left=sum(r.extra.get("ended") == LEFT for r in runs),
        ended=runs[int(np.argmin(costs))].extra.get("ended", ""),
        answers=[DistinctAnswer(runs=len(g.members), parameters=named(problem, g.x)) for g in groups],
        symmetries=[
            SameModel(sentence=s.sentence, source={n: names[k] for n, k in zip(names, s.source, strict=True)}, sign=list(s.sign))
            for s in found
        ],
    )


def distinct(problem: Problem, costs: np.ndarray, x: np.ndarray, within: float) -> tuple[list[Basin], list[Symmetry], list[int]]:
    """Groups of answers x (n, d) of one cost that are no one model, the best first, and the maps that joined others.

    Last the answers (k,) that no map leads to another group: only these tell how far a parameter is open.
    """
    groups = sorted(optima(costs, x, within), key=lambda g: g.cost)
    kept: list[list[Basin]] = []
    maps: dict[str, Symmetry] = {}
    for k, group in enumerate(groups):
        for own in kept if k < COMPARED else []:
            found = same_by_symmetry(problem, own[0].x, group.x)
            if found is not None:
                own.append(group)
                maps.setdefault(found.sentence, found)
                break
        else:
            kept.append([group])
    return [_joined(own) for own in kept], list(maps.values()), [k for own in kept for k in own[0].members]


def _with_others(problem: Problem, found: Sequence[Symmetry], x: np.ndarray, elsewhere: Sequence[Sequence[float]]) -> list[Symmetry]:
    """The maps `found`, and those that take the answer to other points (d,) at which searches within a run found its cost."""
    maps, looked = {s.sentence: s for s in found}, [*x[1:]]
    for z in map(np.asarray, elsewhere):
        if len(looked) < COMPARED and all(np.max(np.abs(z - other)) > NEAR for other in (*x[:1], *looked)):
            looked.append(z)
            if (symmetry := same_by_symmetry(problem, x[0], z)) is not None:
                maps.setdefault(symmetry.sentence, symmetry)
    return list(maps.values())


def opened(rows: list[dict[str, Any]], ranges: Mapping[str, Sequence[float]]) -> list[dict[str, Any]]:
    """Rows of parameters that runs of the same cost contradict: an answer as good outside of the 95 % interval opens it.

    `ranges` are those of `agreement`. Such a parameter has no standard error, and `equal_answers` says how far it was found.
    """
    return [_opened(row, *ranges[row["name"]]) if row["name"] in ranges and row["low"] is not None else row for row in rows]


def _opened(row: dict[str, Any], low: float, high: float) -> dict[str, Any]:
    margin = OUTSIDE * max(abs(low), abs(high))
    if row["low"] - margin <= low and high <= row["high"] + margin:
        return row
    ends = {"low": min(low, row["low"]), "high": max(high, row["high"]), "standard_error": None}
    return {**row, **ends, "status": "flat", "equal_answers": [low, high]}


def _joined(own: Sequence[Basin]) -> Basin:
    members = tuple(k for g in own for k in g.members)
    return Basin(own[0].cost, members, sum(g.share for g in own), own[0].x, np.max([g.spread for g in own], axis=0))


def named(problem: Problem, z: Any) -> dict[str, Number]:
    """The parameters by name at a cube point (d,)."""
    return dict(zip(problem.space.names, np.asarray(problem.space.physical(np.asarray(z))).tolist(), strict=True))
