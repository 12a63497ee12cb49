"""Every recording of an answer fitted alone from there, by the functions that are compiled for all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.local.separable import Block as Search
from plantfit.problem.evaluate.points import at_several
from plantfit.problem.problem import Problem
from plantfit.space import Space
from plantfit.trust.heterogeneity.alone import Estimates
from plantfit.trust.intervals.covariance import Begins, Block
from plantfit.trust.intervals.first_values import free_of
from plantfit.trust.intervals.linearised import EDGE, Local, named_blocks
from plantfit.trust.intervals.parameter_rows import NOT_VISITED, parameter_rows
from plantfit.trust.intervals.ranges import linear_problem

STEPS = 20  # of one refit; most end after four
TOLERANCE, CLOSE = 1e-6, 1e-3  # relative decrease of the cost that ends a refit, and that times the samples
DAMPING = 1e-4  # relative to the largest derivative: the answer of all is near


def own_rows(problem: Problem) -> dict[str, tuple[slice, list[Block]]]:
    """By fitted recording its rows among the residuals of the problem, and their blocks counted from the first of
    them."""
    found: dict[str, tuple[slice, list[Block]]] = {}
    for name, _, block in named_blocks(problem):
        begin = found[name][0].start if name in found else block.rows.start
        here = slice(block.rows.start - begin, block.rows.stop - begin)
        found[name] = (
            slice(begin, block.rows.stop),
            [*(found[name][1] if name in found else ()), replace(block, rows=here)],
        )
    return found


def work(problem: Problem, count: int) -> float:
    """Evaluations that a round of steps of so many recordings is charged."""
    return count * problem.jacobian_charge


def refitted(
    problem: Problem, z: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray, begins: Begins, allowed: float
) -> tuple[dict[str, Estimates], float]:
    """By recording what it says alone, and the evaluations that were spent, about `allowed` at most; of recordings that
    come to their end.

    Residuals (m,) with derivatives (m, d) at the answer z (d,); `begins` as in `covariance`: starts that the fit of all
    has estimated are free in each. One local search each, bounded by the box, all of them in step: no point depends on
    how many others there are.
    """
    rows = own_rows(problem)
    places = {n: problem.space.local(n) for n in rows}
    starts = {n: free_of(begins.of(at), residuals[at]) for n, (at, _) in rows.items()}

    def of(n: str, r: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, j, own = r[rows[n][0]], j[rows[n][0]][:, places[n]], starts[n]
        return (r, j) if own is None else (own.left(r), own.left(j))

    searches = {}
    for n, (at, _) in rows.items():
        own, close = places[n], min(TOLERANCE, CLOSE / (at.stop - at.start))
        searches[n] = Search(own, np.asarray(z, dtype=float)[own], *of(n, residuals, jacobian), close, DAMPING)
    spent = 0.0
    for _ in range(STEPS):
        moving = {n: s for n, s in searches.items() if not s.done}
        if not moving or spent + work(problem, len(moving)) > allowed:
            break
        steps = {n: s.step() for n, s in moving.items()}
        trials = np.repeat(np.asarray(z, dtype=float)[None, :], len(moving), axis=0)
        for trial, (n, s) in zip(trials, moving.items(), strict=True):
            trial[places[n]] = np.clip(s.x + steps[n][0], 0.0, 1.0)
        for (n, s), (r, j) in zip(moving.items(), at_several(problem.unsmoothed, trials), strict=True):
            s.update(*steps[n], *of(n, r, j))
        spent += work(problem, len(moving))
    ended = {n: s for n, s in searches.items() if s.done}
    return {n: _estimates(problem, n, z, s, rows[n][1], begins.of(rows[n][0])) for n, s in ended.items()}, spent


def _estimates(
    problem: Problem, name: str, z: np.ndarray, search: Search, blocks: Sequence[Block], begins: Begins
) -> Estimates:
    whole, own = np.array(z, dtype=float), search.own
    whole[own] = search.x
    samples = max(b.rows.stop for b in blocks)  # rows below are of starts
    residuals, jacobian = search.residuals[:samples], np.zeros((samples, len(whole)))
    jacobian[:, own] = search.jacobian[:samples]
    linear = linear_problem(problem, whole, residuals, jacobian, list(blocks), problem.robust, own, begins)
    covariance = linear.spread * linear.size[:, None] * linear.size[None, :]
    touched = np.any(search.jacobian != 0.0, axis=0)
    bound = tuple("lower" if x <= EDGE else "upper" if x >= 1.0 - EDGE else None for x in search.x)
    local = Local(
        linear.values, covariance, np.sqrt(np.diag(covariance)), bound, (), np.ones(len(own)), touched, linear
    )
    space = Space(problem.space.parameters, (name,))
    unseen = [n for n, known in zip(space.names, touched, strict=True) if not known]
    rows = {r["name"]: r for r in parameter_rows(space, local, unseen) if r["status"] != "fixed"}
    fits = {name: rmse(problem, name, residuals)}
    return Estimates(space.names, rows, covariance, samples, linear.samples, linear.sound, fits)


def of_all(problem: Problem, local: Local, rows: Sequence[Mapping[str, Any]], residuals: np.ndarray) -> Estimates:
    """What the answer of all recordings says, from its findings."""
    assert local.linear is not None
    own = {r["name"]: dict(r) for r in rows if r["status"] != "fixed"}
    fits = {n: rmse(problem, n, residuals[at]) for n, (at, _) in own_rows(problem).items()}
    free = sum(r["status"] != NOT_VISITED for r in own.values())
    sound = local.linear.sound and len(residuals) > free
    return Estimates(problem.space.names, own, local.covariance, len(residuals), local.linear.samples, sound, fits)


def rmse(problem: Problem, name: str, residuals: np.ndarray) -> float:
    """Of the scaled residuals (k,) of a recording: in the unit of one output, of several in their scales."""
    weight = 1.0 if problem.weights is None else problem.weights[name]
    scale = float(problem.scales[problem.outputs[0]]) if len(problem.outputs) == 1 else 1.0
    return float(np.sqrt(np.mean(residuals**2) / weight)) * scale
