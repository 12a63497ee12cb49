"""One process at work on one study: claim a task, search, finish; stop or be killed at any point and go on.

Each worker holds one task at a time; the runs of a task are written in the transaction that marks it
done, so nothing is done or counted twice.
"""

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from plantfit.errors import SearchError, Status, StoreError
from plantfit.optimize.contract import Objective, RunResult
from plantfit.study.plan import Plan, Task
from plantfit.study.running.checkpoint_keeper import Keeper
from plantfit.study.running.heartbeat import beating
from plantfit.study.running.search import Search
from plantfit.study.running.study_progress import Meter, StudyProgress
from plantfit.study.running.worker_names import new_worker
from plantfit.study.store.claims import Claim, ClaimLost
from plantfit.study.store.store import Store

ToPhysical = Callable[[Any], Any]


class TaskWorker:
    """Does free tasks of a study; `stop` must stay True once it was."""

    def __init__(
        self,
        store: Store,
        study_id: int,
        plan: Plan,
        objective: Objective,
        names: tuple[str, ...],
        to_physical: ToPhysical | None,
        progress: Callable[[StudyProgress], None] | None,
        stop: Callable[[], bool],
        search: Search,
        checkpoint_seconds: float,
    ):
        self.store, self.study_id, self.plan, self.objective = store, study_id, plan, as_planned(objective, plan)
        self.names, self.to_physical, self.search, self.checkpoint_seconds = (
            names,
            to_physical,
            search,
            checkpoint_seconds,
        )
        self.stop, self.name, self._new = stop, new_worker(), True
        self.meter = Meter(store, study_id, plan, progress, self.name)

    def work(self) -> bool:
        """Do tasks until none is free; whether all are done. What is left is in the hands of other workers, unless
        stopped."""
        news, self._new = self._new, False
        try:
            if news:
                self.store.settle(self.study_id, active=True)
            while not self.stop() and (claim := self.store.claim(self.study_id, self.name)) is not None:
                news = True
                self._do(claim)
        except BaseException:
            with suppress(StoreError):  # the first error is the one to tell
                self.store.settle(self.study_id, active=False)
            raise
        if news:
            self.store.settle(self.study_id, active=False)
        done, total, *_ = self.store.counts(self.study_id)
        return done == total

    def _do(self, claim: Claim) -> None:
        self.meter.refresh(claim.task.method)
        keeper = Keeper(lambda blob: self.store.save_checkpoint(claim, blob), self.checkpoint_seconds)
        try:
            with suppress(ClaimLost):  # taken over: the other worker's runs are the same bits
                self._search_and_finish(claim, keeper)
        except BaseException:
            with suppress(StoreError, ClaimLost):
                self.store.release(claim, keeper.newest())
            raise

    def _search_and_finish(self, claim: Claim, keeper: Keeper) -> None:
        with beating(self.store, claim, lambda: self.meter.spent) as lost:
            results = self.search(
                self.objective,
                self.plan,
                claim.task,
                progress=self.meter,
                checkpoint=keeper.offer,
                resume=claim.checkpoint,
                stop=lambda: self.stop() or lost.is_set(),
            )
        if lost.is_set():
            return
        if self.stop() and not complete(results, claim.task):
            self.store.release(claim, keeper.newest())
            return
        check_results(results, claim.task, self.objective.dimension)
        self.store.finish(claim, results, [parameters(self.names, self.to_physical, r.x) for r in results])
        self.meter.refresh(claim.task.method)


def as_planned(objective: Objective, plan: Plan) -> Objective:
    """The objective with the charges that the study began with."""
    gradient, jacobian = plan.gradient_charge, plan.jacobian_charge
    return dataclasses.replace(
        objective,
        gradient_charge=objective.gradient_charge if gradient is None else gradient,
        jacobian_charge=objective.jacobian_charge if jacobian is None else jacobian,
    )


def complete(results: Sequence[RunResult], task: Task) -> bool:
    """Whether every run of the task is there and ended by itself."""
    return len(results) == task.count and all(r.status != Status.interrupted for r in results)


def check_results(results: Sequence[RunResult], task: Task, dimension: int) -> None:
    """A method that loses or mixes up runs must not fill a study with wrong numbers."""
    expected, given = list(range(task.first, task.first + task.count)), [r.run for r in results]
    if given != expected or any(r.method != task.method for r in results):
        raise SearchError(
            f"Method {task.method!r} gave back runs {given} where {expected} were asked for; report this to its author."
        )
    for r in results:
        if np.shape(r.x) != (dimension,) or r.status in (Status.interrupted, Status.running):
            what = f"x of shape {np.shape(r.x)} and status {r.status.value!r}"
            raise SearchError(f"Method {task.method!r} ended run {r.run} with {what}; report this to its author.")


def parameters(names: Sequence[str], to_physical: ToPhysical | None, x: np.ndarray) -> dict[str, float]:
    """A cube point as named values in declared units."""
    values = x if to_physical is None else to_physical(x)
    return dict(zip(names, np.asarray(values, dtype=float).tolist(), strict=True))
