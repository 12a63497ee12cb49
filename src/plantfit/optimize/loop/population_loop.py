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
from plantfit.optimize.contract import CostOfData, Facts, Objective, Population, RunResult
from plantfit.optimize.loop.checkpoint import NO_HISTORY, Checkpoint
from plantfit.optimize.loop.progress import estimate
from plantfit.optimize.loop.request import Plan

import jax
import jax.numpy as jnp
from jax import Array, lax

CHUNK = 64  # most candidates per evaluation
LANES = 16  # chunks are multiples of it
BLOCK = 256  # most generations between two looks at the clock
SIDE_BY_SIDE = 1024  # most candidates evaluated at once
STATES = 10 << 20  # most bytes of states side by side: more fall out of the cache and a generation takes up to 1.7 times as long
REPORT_SECONDS = 0.5

ENDINGS = (Status.running, Status.converged, Status.stagnated, Status.target, Status.budget)
PADDING = -1


class Carry(NamedTuple):
    """All runs of a group; leading axis: run. `ending` indexes ENDINGS, PADDING marks rows that fill the group."""

    state: Any
    best_x: Array
    best_f: Array
    evaluations: Array
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


def first_carry(method: Population, facts: Facts, key: Array) -> Carry:
    """One run before its first generation; `key` is that of the run."""

    def strong(a: Array) -> Array:
        # weak types would make jax compile `advance` a second time
        a = jnp.asarray(a)  # a plug-in may begin with a plain number
        return lax.convert_element_type(a, a.dtype)

    zero = jnp.zeros((), int)
    state = method.init(jax.random.fold_in(key, 2**31), facts)
    return jax.tree.map(strong, Carry(state, jnp.full(facts.dimension, 0.5), jnp.asarray(jnp.inf), zero, zero, zero, zero))


def _begin(method: Population, facts: Facts) -> Callable:
    return jax.jit(lambda keys: lax.map(partial(first_carry, method, facts), keys))


@lru_cache(maxsize=32)
def _advance(costs: Callable, of_data: bool, method: Population, rows: int, dimension: int, period: int | None) -> Callable:
    """Compile `advance`, which runs generations first..last-1 and returns (carry, history, end).

    `history` (BLOCK, runs, 2) holds evaluations and best cost after each generation, `end` is the generation
    reached: less than `last` when all runs have ended. The number of generations is data, not shape, so
    results cannot depend on how blocks are cut. With `of_data` the costs take data, which `advance` is given, beside the candidates.
    """

    size = chunk_of(rows)

    def chunk_costs(x: Array, data: Any) -> Array:
        f = costs(x, data) if of_data else costs(x)
        if f.shape != (size,):
            raise SearchError(f"The cost returned shape {f.shape} for {size} candidates; it must return one cost for each.")
        return f

    def evaluate(x: Array, counts: Array, data: Any) -> Array:
        """Costs (runs, rows) of the first `counts` candidates of each run, +inf for the others."""
        flat = x.reshape(-1, dimension)
        live = (jnp.arange(rows) < counts[:, None]).reshape(-1)
        place = jnp.cumsum(live) - 1
        padded = -(-len(flat) // size) * size
        source = jnp.zeros(padded, int).at[jnp.where(live, place, padded)].set(jnp.arange(len(flat)), mode="drop")

        def chunk(i: Array, f: Array) -> Array:
            return f.at[i].set(chunk_costs(flat[lax.dynamic_slice_in_dim(source, i * size, size)], data))

        # a loop whose length is data: XLA compiles one body, so a run has the same bits in any company
        f = lax.fori_loop(0, -(-jnp.sum(live) // size), chunk, jnp.full((padded // size, size), jnp.inf))
        f = jnp.where(live, f.reshape(-1)[place], jnp.inf).reshape(x.shape[:2])
        return jnp.where(jnp.isfinite(f), f, jnp.inf)

    def due(state: Any, runs: int) -> Array:
        """Evaluations (runs,) of the next generation."""
        live = getattr(method, "live", None)
        return jnp.full(runs, rows) if live is None else jnp.clip(jax.vmap(live)(state), 1, rows)

    def generation(
        carry: Carry, g: Array, keys: Array, start: Array, budget: Array, target: Array, patience: Array, data: Any
    ) -> Carry:  # fmt: skip
        state, active = carry.state, carry.ending == 0
        if period is not None:
            state = lax.cond(g % period == 0, partial(lax.map, method.refresh), lambda s: s, state)  # type: ignore[attr-defined]
        counts = jnp.where(active, due(state, len(keys)), 0)
        x, state = lax.map(lambda ks: method.ask(jax.random.fold_in(ks[0], g), ks[1]), (keys, state))
        if start.shape[0]:
            x = jnp.where(g == 0, x.at[:, : start.shape[0]].set(start), x)
        f = evaluate(x, counts, data)
        state, info = lax.map(lambda told: method.tell(*told), (state, x, f))
        no = jnp.zeros(len(keys), bool)
        row = jnp.argmin(f, axis=1)
        lowest = jnp.take_along_axis(f, row[:, None], axis=1)[:, 0]
        better = lowest < carry.best_f
        best_f = jnp.where(better, lowest, carry.best_f)
        best_x = jnp.where(better[:, None], jnp.take_along_axis(x, row[:, None, None], axis=1)[:, 0], carry.best_x)
        evaluations = carry.evaluations + counts
        improved_at = jnp.where(better, evaluations, carry.improved_at)
        stale = info.get("stagnated", no) | (evaluations - improved_at >= patience)
        spent = evaluations + due(state, len(keys)) > budget
        ending = jnp.select([best_f <= target, info.get("stop", no), stale, spent], [3, 1, 2, 4], 0)
        failures = carry.failures + counts - jnp.sum(jnp.isfinite(f), axis=1)
        new = Carry(state, best_x, best_f, evaluations, improved_at, failures, ending)
        return jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), new, carry)

    def advance(
        carry: Carry, keys: Array, start: Array, first: Array, last: Array, budget: Array, target: Array, patience: Array, data: Any
    ) -> tuple[Carry, Array, Array]:
        def step(loop):
            carry, history, g = loop
            carry = generation(carry, g, keys, start, budget, target, patience, data)
            mark = jnp.stack([carry.evaluations.astype(float), carry.best_f], axis=-1)
            return carry, lax.dynamic_update_index_in_dim(history, mark, g - first, 0), g + 1

        def going(loop):
            return (loop[2] < last) & jnp.any(loop[0].ending == 0)

        return lax.while_loop(going, step, (carry, jnp.zeros((BLOCK, len(keys), 2)), first))

    return jax.jit(advance)


def program(objective: Objective, method: Population, facts: Facts) -> Program:
    """The compiled functions, reused by every search with the same cost, settings and shapes."""
    rows = method.rows(facts)
    period = getattr(method, "refresh_period", None)
    costs, of_data = objective.costs, isinstance(objective.costs, CostOfData)
    function = costs.function if isinstance(costs, CostOfData) else costs
    return Program(
        _begin(method, facts), _advance(function, of_data, method, rows, facts.dimension, None if period is None else period(facts))
    )


def run_population(plan: Plan, method: Population, extra: dict[str, Any]) -> list[RunResult]:
    """All runs of the plan, in groups of equal width that run one after another."""
    objective = plan.objective
    facts = Facts(objective.dimension, plan.budget, objective.lower, objective.upper, objective.start)
    rows = method.rows(facts)
    if rows < method.needs.minimum_population:
        raise SearchError(f"Method {plan.name!r} needs a population of at least {method.needs.minimum_population}, not {rows}.")
    if plan.budget < rows:
        raise SearchError(
            f"A budget of {plan.budget} does not cover one generation of method {plan.name!r}; "
            f"give at least {rows} evaluations or a smaller population."
        )
    compiled = program(objective, method, facts)
    most = max(1, min(SIDE_BY_SIDE // rows, STATES // _state_bytes(method, facts)))
    groups = -(-plan.runs // most)
    width = max(2, -(-plan.runs // groups))  # of one, XLA makes another program with other last bits
    saved = plan.resume or Checkpoint(plan.identity)
    finished = list(saved.finished)
    arrays, history = saved.arrays, saved.history
    while len(finished) < plan.runs and not (finished and plan.stopped()):
        group = _Group(plan, compiled, rows, width, finished, extra)
        finished += group.run(arrays, history)
        arrays, history = (), NO_HISTORY
    return finished


def _state_bytes(method: Population, facts: Facts) -> int:
    carry = jax.eval_shape(partial(first_carry, method, facts), jax.random.key(0))
    return sum(a.size * a.dtype.itemsize for a in jax.tree.leaves(carry))


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
        done = len(history)
        data = plan.objective.costs.data if isinstance(plan.objective.costs, CostOfData) else ()

        def advance(carry: Carry, upto: int):
            first = jnp.asarray(start[: self.rows])
            return self.compiled.advance(carry, keys, first, done, upto, plan.budget, target, patience, data)

        jax.block_until_ready(advance(carry, done))  # compiles, computes nothing
        compiled_at = time.perf_counter()
        blocks, block, resumed = [history.reshape(done, self.width, 2)], 1, float(np.sum(carry.evaluations))
        while np.any(np.asarray(carry.ending) == 0) and not plan.stopped():
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
        evaluations, over = np.asarray(carry.evaluations)[:members], np.asarray(carry.ending)[:members] != 0
        before = sum(r.evaluations for r in self.finished)
        earlier = sum(r.seconds for r in self.finished)
        best = min([float(np.min(np.asarray(carry.best_f)[:members])), *(r.cost for r in self.finished)])
        spent = before + float(np.sum(np.where(over, plan.budget, evaluations)))
        total = float(plan.runs * plan.budget)
        progress = estimate(len(self.finished) + int(np.sum(over)), plan.runs, spent, resumed, total, best, seconds)
        plan.progress(dataclasses.replace(progress, evaluations=before + float(np.sum(evaluations)), seconds=earlier + seconds))

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


def plain_settings(method: Any) -> str:
    """Settings as text that is equal exactly when the settings are."""
    fields = {f.name: getattr(method, f.name) for f in dataclasses.fields(method)} if dataclasses.is_dataclass(method) else repr(method)
    return json.dumps(fields, sort_keys=True, default=repr)
