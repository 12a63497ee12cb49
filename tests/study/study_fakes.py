"""A quick search in plain Python that keeps the contract of `plantfit.study.running.search.Search`, and problems to
search."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Status
from plantfit.optimize.contract import Objective, RunResult
from plantfit.optimize.loop.progress import Progress

import jax.numpy as jnp

TARGET = np.array([0.3, 0.7, 1 / 3])


def sphere(z):
    return jnp.sum((z - TARGET) ** 2, axis=-1)


def objective() -> Objective:
    return Objective(
        dimension=3, costs=sphere, value_and_gradient=lambda z: (float(np.sum((z - TARGET) ** 2)), 2 * (z - TARGET))
    )


def to_physical(z):
    return 10.0 ** (3 * jnp.asarray(z) - 1)


def draw(seed: int, run: int, budget: int) -> np.ndarray:
    return np.random.default_rng([seed, run]).random((budget, 3))


@dataclass
class FakeSearch:
    """Random search, one run after another; `after_run(task, run)` is called after each."""

    after_run: Callable[[Any, int], None] = lambda task, run: None
    done: list[tuple[str, int]] = field(default_factory=list)

    def __call__(self, objective, plan, task, *, progress, checkpoint, resume, stop) -> list[RunResult]:
        finished = [] if resume is None else json.loads(resume)
        while len(finished) < task.count and not stop():
            run = task.first + len(finished)
            self.done.append((task.method, run))
            finished.append(run)
            checkpoint(lambda kept=tuple(finished): json.dumps(kept).encode())
            progress(
                Progress(
                    len(finished), task.count, len(finished) * plan.budget, task.count * plan.budget, 1.0, 0.1, None
                )
            )
            self.after_run(task, run)
        return [fake_result(plan, task.method, run) for run in finished]


def fake_result(plan, method: str, run: int) -> RunResult:
    x = draw(plan.seed, run, plan.budget)
    cost = np.asarray(sphere(x))
    best = np.minimum.accumulate(cost)
    better = np.flatnonzero(np.diff(best, prepend=np.inf) < 0)
    at = np.append(better + 1.0, float(plan.budget))
    k = int(np.argmin(cost))
    return RunResult(
        method,
        run,
        plan.seed,
        x[k],
        float(cost[k]),
        float(plan.budget),
        0.25,
        Status.budget,
        at,
        np.append(best[better], best[-1]),
        run,
        {"k": k},
    )
