"""Which runs reach the reported answer on the final problem, and whether answers of one cost are one model."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.errors import Status
from plantfit.findings.record import Number
from plantfit.findings.runs import Agreement, DistinctAnswer, SameModel
from plantfit.optimize.contract import RunResult
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.study.comparing.basins import APART, Basin, optima
from plantfit.study.comparing.symmetry import NEAR, Symmetry, same_by_symmetry
from plantfit.trust.finish.descent import gauss_newton
from plantfit.trust.finish.final_problem import CUT, LEFT, SHOT, rounding
from plantfit.trust.intervals.ranges import plain_space

SAME = 1e-6  # relative difference of costs that counts as the same
OUTSIDE = 1e-9  # of a value: what rounding may carry an answer outside of an interval
COMPARED = 12  # distinct answers that are looked at for exchanges and signs
TWINS, REFINED = 4, 10  # ends of searches within a run that are searched on at most, and Gauss-Newton steps of each
LARGEST = 2_000_000  # entries of the Jacobian of a problem, beyond which they are not: each takes seconds
ALIKE = 1.0  # twice the difference of log-likelihoods up to which two answers fit equally well
SEPARATE = 8.0  # standard errors between two answers, by the wider one's, from which on no valley joins them


def agreement(problem: Problem, runs: Sequence[RunResult]) -> Agreement:
    """The section "agreement" of the findings record.

    A run reaches the reported answer when its own search came to its end at the lowest cost, to a millionth or to
    rounding. Of these `answers` tells the distinct ones, and `symmetries` which exchanges and signs make two answers
    the same, both also where all runs report one of them and only their local searches met the others.
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
        ranges={n: [float(v.min()), float(v.max())] for n, v in zip(names, values.T, strict=True)}
        if len(plain)
        else {},
        spent=sum(r.status is Status.budget for r in runs),
        spent_and_searched=sum(r.status is Status.budget and r.extra.get("ended") != LEFT for r in runs),
        spent_and_agree=sum(runs[k].status is Status.budget and runs[k].extra.get("ended") != SHOT for k in reached),
        cut=sum(r.extra.get("ended") == CUT for r in runs),
        left=sum(r.extra.get("ended") == LEFT for r in runs),
        ended=runs[int(np.argmin(costs))].extra.get("ended", ""),
        answers=[
            *(DistinctAnswer(runs=len(g.members), parameters=named(problem, g.x)) for g in groups),
            *(
                DistinctAnswer(runs=0, parameters=named(problem, z))
                for z in _twins(problem, [runs[k] for k in reached], groups)
            ),
        ],
        symmetries=[
            SameModel(
                sentence=s.sentence,
                source={n: names[k] for n, k in zip(names, s.source, strict=True)},
                sign=list(s.sign),
                whole=list(s.whole),
            )
            for s in found
        ],
    )


def distinct(
    problem: Problem, costs: np.ndarray, x: np.ndarray, within: float
) -> tuple[list[Basin], list[Symmetry], list[int]]:
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


def _with_others(
    problem: Problem, found: Sequence[Symmetry], x: np.ndarray, elsewhere: Sequence[Sequence[float]]
) -> list[Symmetry]:
    """The maps `found`, and those that take the answer to other points (d,) at which searches within a run found its
    cost."""
    maps, looked = {s.sentence: s for s in found}, [*x[1:]]
    for z in map(np.asarray, elsewhere):
        if len(looked) < COMPARED and all(np.max(np.abs(z - other)) > NEAR for other in (*x[:1], *looked)):
            looked.append(z)
            if (symmetry := same_by_symmetry(problem, x[0], z)) is not None:
                maps.setdefault(symmetry.sentence, symmetry)
    return list(maps.values())


def _twins(problem: Problem, reached: Sequence[RunResult], groups: Sequence[Basin]) -> list[np.ndarray]:
    """Optima (d,) that only local searches within the runs met, and that fit as well as the answer of the first of the
    `groups`.

    A valley is not told: along it standard errors are as wide as the way from one end to the other. Nor is what an
    exchange or a sign makes the same model. A search knows its optima with the steps and weights that it had, so each
    is searched on here.
    """
    met = [np.asarray(z, dtype=float) for key in ("elsewhere", "nearly") for r in reached for z in r.extra.get(key, ())]
    if not groups or not met or not plain_space(problem) or problem.separable is not None:
        return []
    if sum(problem.parts.counts.values()) * problem.space.dimension > LARGEST:
        return []
    answer, looked = groups[0].x, 0
    square, error = _known(problem, answer)
    found: list[np.ndarray] = []
    for end in met:
        if looked == TWINS or not np.any(np.abs(end - answer) > SEPARATE * error):
            continue
        looked += 1
        z = gauss_newton(problem, end, REFINED)
        if any(np.max(np.abs(z - other)) <= APART for other in (*(g.x for g in groups), *found)):
            continue
        own, beside = _known(problem, z)
        alike = abs(np.log(max(own[0], 1e-300) / max(square[0], 1e-300))) * own[1] <= ALIKE
        apart = np.any(np.abs(z - answer) > SEPARATE * np.maximum(error, beside))
        if alike and apart and not any(same_by_symmetry(problem, g.x, z) for g in groups):
            found.append(z)
    return found


def _known(problem: Problem, z: np.ndarray) -> tuple[tuple[float, int], np.ndarray]:
    """The sum of squares and the number of residuals at a cube point (d,), and standard errors (d,) there, infinite
    where nothing tells."""
    residuals, jacobian = residuals_and_jacobian(problem, z)
    square, count = float(residuals @ residuals), len(residuals)
    size = np.linalg.norm(jacobian, axis=0)
    if not (np.isfinite(square) and np.all(np.isfinite(jacobian)) and np.all(size > 0) and count > len(z)):
        return (square, count), np.full(len(z), np.inf)
    _, s, right = np.linalg.svd(jacobian / size, full_matrices=False)
    if s[-1] <= 1e-7 * s[0]:
        return (square, count), np.full(len(z), np.inf)
    return (square, count), np.linalg.norm(right.T / s, axis=1) / size * np.sqrt(square / (count - len(z)))


def opened(rows: list[dict[str, Any]], ranges: Mapping[str, Sequence[float]]) -> list[dict[str, Any]]:
    """Rows of parameters that runs of the same cost contradict: an answer as good outside of the 95 % interval opens
    it.

    `ranges` are those of `agreement`. Such a parameter has no standard error, and `equal_answers` says how far it was
    found.
    """
    return [
        _opened(row, *ranges[row["name"]]) if row["name"] in ranges and row["low"] is not None else row for row in rows
    ]


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
