"""Work through the tasks of a study: claim, search, finish; stop or be killed at any point and go on.

Any number of processes may work on one study. Each holds one task at a time; the runs of a task
are written in the transaction that marks it done, so nothing is done or counted twice.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from plantfit.errors import SearchError, Status, StoreError
from plantfit.optimize.contract import Objective, RunResult
from plantfit.study.claims import Claim, ClaimLost
from plantfit.study.heartbeat import beating
from plantfit.study.keeper import Keeper
from plantfit.study.plan import Plan, Task
from plantfit.study.probe import check_same, probe
from plantfit.study.progress import Meter, StudyProgress
from plantfit.study.search import Search, search_task
from plantfit.study.store import Store
from plantfit.study.versions import cpu_model, versions
from plantfit.study.worker import new_worker

CHECKPOINT_SECONDS = 2.0
POLL_SECONDS = 0.2

ToPhysical = Callable[[Any], Any]
Tell = Callable[[StudyProgress], None]


def run(
    plan: Plan,
    objective: Objective,
    store: Store,
    *,
    spec_text: str | None = None,
    spec_path: str | None = None,
    coordinates: Sequence[str] | None = None,
    to_physical: ToPhysical | None = None,
    progress: Tell | None = None,
    stop: Callable[[], bool] | None = None,
    search: Search = search_task,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> int:
    """Start a study and work on it until it is done or `stop` says True; returns its id.

    `coordinates` names the axes of the cube (x1, x2, ... if None); `to_physical` maps (d,) and
    (n, d) cube points to values in declared units (the identity if None). A stopped study has
    state "interrupted" and goes on with `resume`. Whatever raises in here, what is finished and
    the newest checkpoint are kept. Raises SearchError and StoreError.
    """
    names = tuple(coordinates) if coordinates is not None else tuple(f"x{k + 1}" for k in range(objective.dimension))
    if len(names) != objective.dimension:
        raise SearchError(
            f"Study {plan.name!r} names {len(names)} coordinates but its problem has {objective.dimension}; name each one once."
        )
    study_id = store.add(plan, spec_text=spec_text, coordinates=names, probe=probe(objective, to_physical), spec_path=spec_path)
    _Worker(store, study_id, plan, objective, names, to_physical, progress, stop, search, checkpoint_seconds).work()
    return study_id


def resume(
    store: Store,
    study_id: int,
    objective: Objective,
    *,
    to_physical: ToPhysical | None = None,
    progress: Tell | None = None,
    stop: Callable[[], bool] | None = None,
    search: Search = search_task,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> int:
    """Go on with a study, or help another process with it; returns its id.

    On the same CPU type with the same versions the results have the same bits as without the
    interruption (`seconds` apart); a difference is noted in the study. Waits for tasks that other
    live workers hold. Raises StoreError if there is no such study or the problem is another one.
    """
    study = store.study(study_id)
    if study.runs_done == study.runs_total:
        return study_id
    plan = Plan.from_record(study.plan)
    check_same(store.probe(study_id), probe(objective, to_physical), study_id)
    _note_changes(store, study_id, dict(study.versions), study.cpu)
    _Worker(store, study_id, plan, objective, study.coordinates, to_physical, progress, stop, search, checkpoint_seconds).work()
    return study_id


def _note_changes(store: Store, study_id: int, before: dict[str, str], cpu: str) -> None:
    now = versions() | {"CPU": cpu_model()}
    before = before | {"CPU": cpu}
    changed = [f"{key} {before.get(key, 'unknown')} became {now[key]}" for key in now if before.get(key) != now[key]]
    if changed:
        store.add_note(study_id, f"Resumed elsewhere ({', '.join(changed)}); later runs may differ in their last bits.")


class _Worker:
    """One process at work on one study."""

    def __init__(
        self,
        store: Store,
        study_id: int,
        plan: Plan,
        objective: Objective,
        names: tuple[str, ...],
        to_physical: ToPhysical | None,
        progress: Tell | None,
        stop: Callable[[], bool] | None,
        search: Search,
        checkpoint_seconds: float,
    ):
        self.store, self.study_id, self.plan, self.objective = store, study_id, plan, objective
        self.names, self.to_physical, self.search, self.checkpoint_seconds = names, to_physical, search, checkpoint_seconds
        self.stop = _latched(stop)
        self.meter = Meter(store, study_id, plan, progress)
        self.name = new_worker()

    def work(self) -> None:
        """Tasks until all are done, by this worker or others, or until told to stop."""
        self.store.settle(self.study_id, active=True)
        try:
            while not self.stop():
                claim = self.store.claim(self.study_id, self.name)
                if claim is not None:
                    self._do(claim)
                elif self._all_done():
                    break
                else:
                    time.sleep(POLL_SECONDS)  # others hold what is left; take it over if they die
        except BaseException:
            with suppress(StoreError):  # the first error is the one to tell
                self.store.settle(self.study_id, active=False)
            raise
        self.store.settle(self.study_id, active=False)

    def _all_done(self) -> bool:
        done, total, *_ = self.store.counts(self.study_id)
        return done == total

    def _do(self, claim: Claim) -> None:
        self.meter.refresh(claim.task.method)
        keeper = Keeper(self.store, claim, self.checkpoint_seconds)
        try:
            with suppress(ClaimLost):  # taken over: the other worker's runs are the same bits
                self._search_and_finish(claim, keeper)
        except BaseException:
            with suppress(StoreError, ClaimLost):
                self.store.release(claim, keeper.newest())
            raise

    def _search_and_finish(self, claim: Claim, keeper: Keeper) -> None:
        with beating(self.store, claim) as lost:
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
        if self.stop() and not _complete(results, claim.task):
            self.store.release(claim, keeper.newest())
            return
        _check(results, claim.task, self.objective.dimension)
        self.store.finish(claim, results, [self._parameters(r.x) for r in results])
        self.meter.refresh(claim.task.method)

    def _parameters(self, x: np.ndarray) -> dict[str, float]:
        values = x if self.to_physical is None else self.to_physical(x)
        return dict(zip(self.names, np.asarray(values, dtype=float).tolist(), strict=True))


def _latched(stop: Callable[[], bool] | None) -> Callable[[], bool]:
    """`stop`, but once True always True, so that a stop is never seen by half of the code."""
    stopped = False

    def asked() -> bool:
        nonlocal stopped
        stopped = stopped or (stop is not None and bool(stop()))
        return stopped

    return asked


def _complete(results: Sequence[RunResult], task: Task) -> bool:
    return len(results) == task.count and all(r.status != Status.interrupted for r in results)


def _check(results: Sequence[RunResult], task: Task, dimension: int) -> None:
    """A method that loses or mixes up runs must not fill a study with wrong numbers."""
    expected, given = list(range(task.first, task.first + task.count)), [r.run for r in results]
    if given != expected or any(r.method != task.method for r in results):
        raise SearchError(f"Method {task.method!r} gave back runs {given} where {expected} were asked for; report this to its author.")
    for r in results:
        if np.shape(r.x) != (dimension,) or r.status in (Status.interrupted, Status.running):
            what = f"x of shape {np.shape(r.x)} and status {r.status.value!r}"
            raise SearchError(f"Method {task.method!r} ended run {r.run} with {what}; report this to its author.")
