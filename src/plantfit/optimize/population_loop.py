"""Population methods: runs side by side, generations in compiled blocks, randomness by counter.

The key of run r is fold_in(key(seed), r) and that of its generation g fold_in(run key, g), so any
generation can be computed again from the carry alone.
"""

import dataclasses
import json
import time
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, Status
from plantfit.optimize.checkpoint import Checkpoint
from plantfit.optimize.contract import Facts, Objective, Population, RunResult
from plantfit.optimize.plan import Plan
from plantfit.optimize.progress import estimate

import jax
import jax.numpy as jnp
from jax import Array, lax

CHUNK = 64  # most candidates per evaluation
LANES = 16  # chunks are multiples of it
BLOCK = 256  # most generations between two looks at the clock
SIDE_BY_SIDE = 1024  # most candidates evaluated at once
REPORT_SECONDS = 0.5

ENDINGS = (Status.running, Status.converged, Status.stagnated, Status.target)
PADDING = -1


class Carry(NamedTuple):
    """All runs of a group; leading axis: run. `ending` indexes ENDINGS, PADDING marks rows that fill the group."""

    state: Any
    best_x: Array
    best_f: Array
    generations: Array
    improved_at: Array  # evaluations at the last improvement
    failures: Array
    ending: Array


class Program(NamedTuple):
    """Compiled functions of one method on one cost."""

    begin: Callable
    advance: Callable


def chunk_of(rows: int) -> int:
    """Candidates per evaluation: the same for any number of runs, so that a run has the same bits in any company."""
    return min(CHUNK, -(-rows // LANES) * LANES)


def _begin(method: Population, facts: Facts) -> Callable:
    def one(key: Array) -> Carry:
        zero = jnp.zeros((), int)
        state = method.init(jax.random.fold_in(key, 2**31), facts)
        return Carry(state, jnp.full(facts.dimension, 0.5), jnp.asarray(jnp.inf), zero, zero, zero, zero)

    def strong(a: Array) -> Array:
        # weak types would make jax compile `advance` a second time
        return lax.convert_element_type(a, a.dtype)

    return jax.jit(lambda keys: jax.tree.map(strong, lax.map(one, keys)))


@lru_cache(maxsize=32)
def _advance(costs: Callable, method: Population, rows: int, dimension: int, period: int | None) -> Callable:
    """Compile `advance`, which runs generations first..last-1 and returns (carry, history, end).

    `history` (BLOCK, runs) holds the best cost after each generation, `end` is the generation reached:
    less than `last` when all runs have ended. The number of generations is data, not shape, so results
    cannot depend on how blocks are cut. `chunks` covers the rows of the group that are not padding.
    """

    size = chunk_of(rows)

    def chunk_costs(x: Array) -> Array:
        f = costs(x)
        if f.shape != (size,):
            raise SearchError(f"The cost returned shape {f.shape} for {size} candidates; it must return one cost for each.")
        return f

    def evaluate(x: Array, chunks: Array) -> Array:
        # a loop whose length is data: XLA compiles one body, so a run has the same bits in any company
        flat = x.reshape(-1, dimension)
        count = -(-len(flat) // size)
        filled = jnp.concatenate([flat, jnp.full((count * size - len(flat), dimension), 0.5)]).reshape(count, size, dimension)
        empty = jnp.full((count, size), jnp.inf)
        f = lax.fori_loop(0, chunks, lambda i, f: f.at[i].set(chunk_costs(filled[i])), empty)
        f = f.reshape(-1)[: len(flat)].reshape(x.shape[:2])
        return jnp.where(jnp.isfinite(f), f, jnp.inf)

    def generation(carry: Carry, g: Array, keys: Array, start: Array, chunks: Array, target: Array, patience: Array) -> Carry:
        state = carry.state
        if period is not None:
            state = lax.cond(g % period == 0, partial(lax.map, method.refresh), lambda s: s, state)  # type: ignore[attr-defined]
        x, state = lax.map(lambda ks: method.ask(jax.random.fold_in(ks[0], g), ks[1]), (keys, state))
        if start.shape[0]:
            x = jnp.where(g == 0, x.at[:, : start.shape[0]].set(start), x)
        f = evaluate(x, chunks)
        state, info = lax.map(lambda told: method.tell(*told), (state, x, f))
        no = jnp.zeros(len(keys), bool)
        row = jnp.argmin(f, axis=1)
        lowest = jnp.take_along_axis(f, row[:, None], axis=1)[:, 0]
        better = lowest < carry.best_f
        best_f = jnp.where(better, lowest, carry.best_f)
        best_x = jnp.where(better[:, None], jnp.take_along_axis(x, row[:, None, None], axis=1)[:, 0], carry.best_x)
        generations = carry.generations + 1
        improved_at = jnp.where(better, generations * rows, carry.improved_at)
        stale = info.get("stagnated", no) | (generations * rows - improved_at >= patience)
        ending = jnp.select([best_f <= target, info.get("stop", no), stale], [3, 1, 2], 0)
        failures = carry.failures + jnp.sum(~jnp.isfinite(f), axis=1)
        new = Carry(state, best_x, best_f, generations, improved_at, failures, ending)
        active = carry.ending == 0
        return jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), new, carry)

    def advance(
        carry: Carry, keys: Array, start: Array, chunks: Array, first: Array, last: Array, target: Array, patience: Array
    ) -> tuple[Carry, Array, Array]:
        def step(loop):
            carry, history, g = loop
            carry = generation(carry, g, keys, start, chunks, target, patience)
            return carry, lax.dynamic_update_index_in_dim(history, carry.best_f, g - first, 0), g + 1

        def going(loop):
            return (loop[2] < last) & jnp.any(loop[0].ending == 0)

        history = jnp.full((BLOCK, len(keys)), jnp.inf)
        return lax.while_loop(going, step, (carry, history, first))

    return jax.jit(advance)


def program(objective: Objective, method: Population, facts: Facts) -> Program:
    """The compiled functions, reused by every search with the same cost, settings and shapes."""
    rows = method.rows(facts)
    period = getattr(method, "refresh_period", None)
    return Program(
        _begin(method, facts), _advance(objective.costs, method, rows, facts.dimension, None if period is None else period(facts))
    )


def run_population(plan: Plan, method: Population, extra: dict[str, Any]) -> list[RunResult]:
    """All runs of the plan, in groups of equal width that run one after another."""
    objective = plan.objective
    facts = Facts(objective.dimension, plan.budget, objective.lower, objective.upper)
    rows = method.rows(facts)
    if rows < method.needs.minimum_population:
        raise SearchError(f"Method {plan.name!r} needs a population of at least {method.needs.minimum_population}, not {rows}.")
    if plan.budget < rows:
        raise SearchError(
            f"A budget of {plan.budget} does not cover one generation of method {plan.name!r}; "
            f"give at least {rows} evaluations or a smaller population."
        )
    compiled = program(objective, method, facts)
    most = max(1, SIDE_BY_SIDE // rows)
    groups = -(-plan.runs // most)
    width = max(2, -(-plan.runs // groups))
    saved = plan.resume or Checkpoint(plan.identity)
    finished = list(saved.finished)
    arrays, history = saved.arrays, saved.history
    while len(finished) < plan.runs and not (finished and plan.stopped()):
        group = _Group(plan, compiled, rows, width, finished, extra)
        finished += group.run(arrays, history)
        arrays, history = (), np.zeros((0, 0))
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
        keys = jax.vmap(lambda r: jax.random.fold_in(jax.random.key(plan.seed), r))(jnp.asarray(runs, jnp.uint32))
        carry = self.compiled.begin(keys)
        carry = carry._replace(ending=jnp.where(jnp.arange(self.width) < members, carry.ending, PADDING))
        if arrays:
            carry = jax.tree.unflatten(jax.tree.structure(carry), [jnp.asarray(a) for a in arrays])
        start = np.zeros((0, plan.objective.dimension)) if plan.objective.start is None else np.clip(plan.objective.start, 0.0, 1.0)
        target = -np.inf if plan.target is None else plan.target
        patience = 2**62 if plan.stagnation is None else plan.stagnation
        chunks = -(-members * self.rows // chunk_of(self.rows))
        done, last = len(history), plan.budget // self.rows

        def advance(carry: Carry, upto: int):
            return self.compiled.advance(carry, keys, jnp.asarray(start[: self.rows]), chunks, done, upto, target, patience)

        jax.block_until_ready(advance(carry, done))  # compiles, computes nothing
        compiled_at = time.perf_counter()
        blocks, block, resumed = [history.reshape(done, self.width)], 1, done
        while done < last and np.any(np.asarray(carry.ending) == 0) and not plan.stopped():
            tick = time.perf_counter()
            carry, best, reached = advance(carry, min(done + block, last))
            gained = int(reached) - done
            blocks.append(np.asarray(best)[:gained])
            done += gained
            pace = REPORT_SECONDS / max(time.perf_counter() - tick, 1e-6)
            block = int(np.clip(block * min(max(pace, 0.25), 4.0), 1, BLOCK))
            self._tell(carry, members, resumed, time.perf_counter() - compiled_at)
            if plan.checkpoint is not None:
                leaves = tuple(np.asarray(a) for a in jax.tree.leaves(carry))
                plan.checkpoint(Checkpoint(plan.identity, tuple(self.finished), leaves, np.concatenate(blocks)))
        times = {"seconds": (time.perf_counter() - compiled_at) / members, "compile": compiled_at - began}
        return self._results(jax.tree.map(np.asarray, carry._replace(state=())), members, np.concatenate(blocks), last, times)

    def _tell(self, carry: Carry, members: int, resumed: int, seconds: float) -> None:
        plan = self.plan
        if plan.progress is None:
            return
        generations, ending = np.asarray(carry.generations)[:members], np.asarray(carry.ending)[:members]
        over = (ending != 0) | (generations >= plan.budget // self.rows)
        before = sum(r.evaluations for r in self.finished)
        earlier = sum(r.seconds for r in self.finished)
        best = min([float(np.min(np.asarray(carry.best_f)[:members])), *(r.cost for r in self.finished)])
        spent = before + float(np.sum(np.where(over, plan.budget, generations * self.rows)))
        total = float(plan.runs * plan.budget)
        evaluations = before + float(np.sum(generations) * self.rows)
        progress = estimate(len(self.finished) + int(np.sum(over)), plan.runs, spent, resumed * self.rows * members, total, best, seconds)
        plan.progress(dataclasses.replace(progress, evaluations=evaluations, seconds=earlier + seconds))

    def _results(self, carry: Carry, members: int, history: np.ndarray, last: int, times: dict[str, float]) -> list[RunResult]:
        results = []
        for k in range(members):
            generations, cost = int(carry.generations[k]), float(carry.best_f[k])
            status = ENDINGS[int(carry.ending[k])]
            if status is Status.running:
                status = Status.budget if generations >= last else Status.interrupted
            if not np.isfinite(cost) and status is not Status.interrupted:
                status = Status.failed
            curve = history[:generations, k]
            better = np.flatnonzero(curve < np.concatenate([[np.inf], curve[:-1]])) if generations else np.zeros(0, int)
            at = (better + 1) * self.rows
            costs = curve[better]
            if generations and (len(at) == 0 or at[-1] != generations * self.rows):
                at, costs = np.append(at, generations * self.rows), np.append(costs, cost)
            results.append(
                RunResult(
                    method=self.plan.name,
                    run=self.plan.first_run + len(self.finished) + k,
                    seed=self.plan.seed,
                    x=np.array(carry.best_x[k]),
                    cost=cost,
                    evaluations=float(generations * self.rows),
                    seconds=times["seconds"],
                    status=status,
                    history_evaluations=at.astype(float),
                    history_cost=np.array(costs, dtype=float),
                    failures=int(carry.failures[k]),
                    extra={**self.extra, "compile_seconds": times["compile"]},
                )
            )
        return results


def plain_settings(method: Any) -> str:
    """Settings as text that is equal exactly when the settings are."""
    fields = {f.name: getattr(method, f.name) for f in dataclasses.fields(method)} if dataclasses.is_dataclass(method) else repr(method)
    return json.dumps(fields, sort_keys=True, default=repr)
