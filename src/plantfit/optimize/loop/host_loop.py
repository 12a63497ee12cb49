"""Host methods: one run after another, each through a Counter of its own."""

import time
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Interrupted, Status
from plantfit.optimize.contract import Host, RunResult
from plantfit.optimize.loop.checkpoint import Checkpoint
from plantfit.optimize.loop.counter import BudgetSpent, Counter, TargetReached
from plantfit.optimize.loop.progress import estimate
from plantfit.optimize.loop.request import Plan

import jax

REPORT_SECONDS = 0.5


def run_host(plan: Plan, method: Host, extra: dict[str, Any]) -> list[RunResult]:
    """All runs of the plan; an interrupted run ends the list and is begun anew on resume."""
    finished = list(plan.resume.finished) if plan.resume is not None else []
    reporter = _Reporter(plan, finished)
    while len(finished) < plan.runs and not (finished and plan.stopped()):
        result = _run(plan, method, plan.first_run + len(finished), reporter, extra)
        finished.append(result)
        if result.status is Status.interrupted:
            break
        reporter.tell(None)
        if plan.checkpoint is not None:
            plan.checkpoint(Checkpoint(plan.identity, tuple(finished)))
    return finished


class _Reporter:
    """Sends progress at most every REPORT_SECONDS."""

    def __init__(self, plan: Plan, finished: list[RunResult]):
        self.plan, self.finished = plan, finished
        self.began = self.last = time.perf_counter()
        self.skipped = len(finished) * plan.budget

    def during(self, counter: Counter) -> None:
        if self.plan.progress is not None and time.perf_counter() - self.last >= REPORT_SECONDS:
            self.tell(counter)

    def tell(self, counter: Counter | None) -> None:
        if self.plan.progress is None:
            return
        self.last = time.perf_counter()
        spent, best = (counter.spent, counter.best_cost) if counter else (0.0, np.inf)
        plan, done = self.plan, len(self.finished)
        total = float(plan.runs * plan.budget)
        pace = estimate(done, plan.runs, done * plan.budget + spent, self.skipped, total, best, self.last - self.began)
        evaluations = sum(r.evaluations for r in self.finished) + spent
        best = min([best, *(r.cost for r in self.finished)])
        plan.progress(type(pace)(done, plan.runs, evaluations, total, best, pace.seconds, pace.seconds_left))  # pyrefly: ignore[not-callable]


def _run(plan: Plan, method: Host, run: int, reporter: _Reporter, extra: dict[str, Any]) -> RunResult:
    began = time.perf_counter()
    counter = Counter(plan.objective, plan.budget, target=plan.target, stop=plan.stop, report=reporter.during)
    key = jax.random.fold_in(jax.random.key(plan.seed), run)
    try:
        status = method.run(key, plan.objective, plan.budget, counter)
    except BudgetSpent:
        status = Status.budget
    except TargetReached:
        status = Status.target
    except Interrupted:
        status = Status.interrupted
    if not np.isfinite(counter.best_cost) and status is not Status.interrupted:
        status = Status.failed
    curve = [*counter.history]
    if counter.spent and (not curve or curve[-1][0] != counter.spent):
        curve.append((counter.spent, counter.best_cost))
    at, costs = np.array(curve, dtype=float).reshape(-1, 2).T
    return RunResult(
        plan.name, run, plan.seed, counter.best_x, counter.best_cost, counter.spent, time.perf_counter() - began,
        status,
        at, costs, counter.failures, {**extra, **counter.extra},
    )  # fmt: skip
