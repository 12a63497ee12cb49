"""Population methods: runs side by side, generations in compiled blocks, randomness by counter.

The key of run r is fold_in(key(seed), r); `generations.py` has what follows from it.
"""

import dataclasses
import json
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, Status
from plantfit.optimize.contract import CostOfData, Facts, Population, RunResult
from plantfit.optimize.loop.apart import program_apart, worth_it
from plantfit.optimize.loop.checkpoint import NO_HISTORY, Checkpoint
from plantfit.optimize.loop.generations import BLOCK, PADDING, RUNNING, Carry, Program, program, state_bytes
from plantfit.optimize.loop.progress import estimate
from plantfit.optimize.loop.request import Plan
from plantfit.runtime import jit

import jax
import jax.numpy as jnp

SIDE_BY_SIDE = 1024  # most candidates evaluated at once
# most bytes of states side by side: more fall out of the cache and a generation takes up to 1.7 times as long
STATES = 10 << 20
REPORT_SECONDS = 0.5

# in the order of `generations`
ENDINGS = (Status.running, Status.converged, Status.stagnated, Status.target, Status.budget)


def run_population(plan: Plan, method: Population, extra: dict[str, Any]) -> list[RunResult]:
    """All runs of the plan, in groups of equal width that run one after another."""
    objective = plan.objective
    facts = Facts(objective.dimension, plan.budget, objective.lower, objective.upper, objective.start)
    rows = method.rows(facts)
    if rows < method.needs.minimum_population:
        raise SearchError(
            f"Method {plan.name!r} needs a population of at least {method.needs.minimum_population}, not {rows}."
        )
    if plan.budget < rows:
        raise SearchError(
            f"A budget of {plan.budget} does not cover one generation of method {plan.name!r}; "
            f"give at least {rows} evaluations or a smaller population."
        )
    most = max(1, min(SIDE_BY_SIDE // rows, STATES // state_bytes(method, facts)))
    groups = -(-plan.runs // most)
    width = max(2, -(-plan.runs // groups))  # of one, XLA makes another program with other last bits
    apart = worth_it(method, facts, width, groups)
    compiled = (program_apart if apart else program)(objective, method, facts)
    saved = plan.resume or Checkpoint(plan.identity)
    finished = list(saved.finished)
    arrays, history = saved.arrays, saved.history
    while len(finished) < plan.runs and not (finished and plan.stopped()):
        group = _Group(plan, compiled, rows, width, finished, extra)
        finished += group.run(arrays, history)
        arrays, history = (), NO_HISTORY
    return finished


@dataclasses.dataclass
class _Group:
    """Consecutive runs that share one compiled call."""

    plan: Plan
    compiled: Program
    rows: int
    width: int
    finished: list[RunResult]
    extra: dict[str, Any]

    def run(self, arrays: tuple[np.ndarray, ...], history: np.ndarray) -> list[RunResult]:
        plan, began = self.plan, time.perf_counter()
        offset = len(self.finished)
        members = min(self.width, plan.runs - offset)
        runs = plan.first_run + offset + np.arange(self.width)
        keys = _keys()(jax.random.key(plan.seed), runs.astype(np.uint32))
        carry = self.compiled.begin(keys)
        # by numpy, which compiles nothing
        carry = carry._replace(ending=np.where(np.arange(self.width) < members, np.asarray(carry.ending), PADDING))
        if arrays:
            carry = jax.tree.unflatten(jax.tree.structure(carry), [jnp.asarray(a) for a in arrays])
        start = (
            np.zeros((0, plan.objective.dimension))
            if plan.objective.start is None
            else np.clip(plan.objective.start, 0.0, 1.0)
        )
        target = -np.inf if plan.target is None else plan.target
        patience = 2**62 if plan.stagnation is None else plan.stagnation
        done = len(history)
        data = plan.objective.costs.data if isinstance(plan.objective.costs, CostOfData) else ()

        def advance(carry: Carry, upto: int):
            first = jnp.asarray(start[: self.rows])
            return self.compiled.advance(carry, keys, first, done, upto, plan.budget, target, patience, data)

        jax.block_until_ready(advance(carry, done))  # compiles, computes nothing
        compiled_at = time.perf_counter()
        blocks, block, resumed = [history.reshape(done, self.width, 2)], 1, float(np.sum(np.asarray(carry.evaluations)))
        while np.any(np.asarray(carry.ending) == RUNNING) and not plan.stopped():
            tick = time.perf_counter()
            carry, marks, reached = advance(carry, done + block)
            gained = int(reached) - done
            blocks.append(np.asarray(marks)[:gained])
            done += gained
            pace = REPORT_SECONDS / max(time.perf_counter() - tick, 1e-6)
            block = int(np.clip(block * min(max(pace, 0.25), 4.0), 1, BLOCK))
            self._tell(carry, members, resumed, time.perf_counter() - compiled_at)
            if plan.checkpoint is not None:
                leaves = tuple(np.asarray(a) for a in jax.tree.leaves(carry))
                plan.checkpoint(Checkpoint(plan.identity, tuple(self.finished), leaves, np.concatenate(blocks)))
        times = {"seconds": (time.perf_counter() - compiled_at) / members, "compile": compiled_at - began}
        return self._results(jax.tree.map(np.asarray, carry._replace(state=())), members, np.concatenate(blocks), times)

    def _tell(self, carry: Carry, members: int, resumed: float, seconds: float) -> None:
        plan = self.plan
        if plan.progress is None:
            return
        evaluations, over = np.asarray(carry.evaluations)[:members], np.asarray(carry.ending)[:members] != RUNNING
        before = sum(r.evaluations for r in self.finished)
        earlier = sum(r.seconds for r in self.finished)
        best = min([float(np.min(np.asarray(carry.best_f)[:members])), *(r.cost for r in self.finished)])
        spent = before + float(np.sum(np.where(over, plan.budget, evaluations)))
        total = float(plan.runs * plan.budget)
        progress = estimate(len(self.finished) + int(np.sum(over)), plan.runs, spent, resumed, total, best, seconds)
        plan.progress(
            dataclasses.replace(progress, evaluations=before + float(np.sum(evaluations)), seconds=earlier + seconds)
        )

    def _results(self, carry: Carry, members: int, history: np.ndarray, times: dict[str, float]) -> list[RunResult]:
        results = []
        for k in range(members):
            evaluations, cost = float(carry.evaluations[k]), float(carry.best_f[k])
            status = ENDINGS[int(carry.ending[k])]
            if status is Status.running:
                status = Status.interrupted
            if not np.isfinite(cost) and status is not Status.interrupted:
                status = Status.failed
            at, curve = history[:, k].T
            better = curve < np.concatenate([[np.inf], curve[:-1]])
            at, costs = at[better], curve[better]
            if evaluations and (len(at) == 0 or at[-1] != evaluations):
                at, costs = np.append(at, evaluations), np.append(costs, cost)
            results.append(
                RunResult(
                    method=self.plan.name,
                    run=self.plan.first_run + len(self.finished) + k,
                    seed=self.plan.seed,
                    x=np.array(carry.best_x[k]),
                    cost=cost,
                    evaluations=evaluations,
                    seconds=times["seconds"],
                    status=status,
                    history_evaluations=at,
                    history_cost=costs,
                    failures=int(carry.failures[k]),
                    extra={**self.extra, "compile_seconds": times["compile"]},
                )
            )
        return results


@cache
def _keys() -> Callable:
    """The compiled function that makes the keys of runs."""
    return jit(jax.vmap(jax.random.fold_in, in_axes=(None, 0)))


def plain_settings(method: Any) -> str:
    """Settings as text that is equal exactly when the settings are."""
    fields = (
        {f.name: getattr(method, f.name) for f in dataclasses.fields(method)}
        if dataclasses.is_dataclass(method)
        else repr(method)
    )
    return json.dumps(fields, sort_keys=True, default=repr)
