"""Begin a study and work on it, alone or beside any number of other processes.

A study lives in its store: whoever opens the store may work on it, be killed, and go on.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from plantfit.errors import SearchError, StoreError
from plantfit.optimize.contract import Objective
from plantfit.study.plan import Plan
from plantfit.study.running.probe import check_same, probe
from plantfit.study.running.search import Search, search_task
from plantfit.study.running.study_progress import StudyProgress
from plantfit.study.running.task_worker import TaskWorker, ToPhysical
from plantfit.study.store.store import Store
from plantfit.study.versions import SEARCHES, cpu_model, versions

CHECKPOINT_SECONDS = 2.0
POLL_SECONDS = 0.3

Tell = Callable[[StudyProgress], None]


def begin(
    plan: Plan,
    objective: Objective,
    store: Store,
    *,
    spec_text: str | None = None,
    spec_path: str | None = None,
    coordinates: Sequence[str] | None = None,
    to_physical: ToPhysical | None = None,
) -> int:
    """Put a study into the store without working on it; returns its id.

    `coordinates` names the axes of the cube (x1, x2, ... if None); `to_physical` maps (d,) and
    (n, d) cube points to values in declared units (the identity if None). Charges of derivatives that the
    plan leaves open become those of the objective. Raises SearchError and StoreError.
    """
    names = tuple(coordinates) if coordinates is not None else tuple(f"x{k + 1}" for k in range(objective.dimension))
    if len(names) != objective.dimension:
        raise SearchError(
            f"Study {plan.name!r} names {len(names)} coordinates but "
            f"its problem has {objective.dimension}; name each one once."
        )
    plan = replace(
        plan,
        gradient_charge=objective.gradient_charge if plan.gradient_charge is None else plan.gradient_charge,
        jacobian_charge=objective.jacobian_charge if plan.jacobian_charge is None else plan.jacobian_charge,
    )
    return store.add(
        plan, spec_text=spec_text, coordinates=names, probe=probe(objective, to_physical), spec_path=spec_path
    )


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
    """`begin` a study and work on it until it is done or `stop` says True; returns its id.

    A stopped study has state "interrupted" and goes on with `resume`. Whatever raises in here, what is
    finished and the newest checkpoint are kept. Raises SearchError and StoreError.
    """
    study_id = begin(
        plan, objective, store, spec_text=spec_text, spec_path=spec_path, coordinates=coordinates,
        to_physical=to_physical
    )  # fmt: skip
    stop = latched(stop)
    worker = _worker(store, study_id, objective, to_physical, progress, stop, search, checkpoint_seconds)
    attend([lambda: worker], stop)
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
    stop = latched(stop)
    if store.study(study_id).runs_done < store.study(study_id).runs_total:
        worker = joined(store, study_id, objective, to_physical, progress, stop, search, checkpoint_seconds)
        attend([lambda: worker], stop)
    return study_id


def joined(
    store: Store,
    study_id: int,
    objective: Objective,
    to_physical: ToPhysical | None,
    progress: Tell | None,
    stop: Callable[[], bool],
    search: Search = search_task,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> TaskWorker:
    """A worker for a study that was begun earlier or elsewhere, once the problem is known to be the same."""
    check_searches(store, study_id)
    check_same(store.probe(study_id), probe(objective, to_physical), study_id)
    note_changes(store, study_id, versions() | {"CPU": cpu_model()})
    return _worker(store, study_id, objective, to_physical, progress, stop, search, checkpoint_seconds)


def attend(workers: Sequence[Callable[[], TaskWorker]], stop: Callable[[], bool]) -> None:
    """Work on several studies, one after the other, until all are done or `stop` says True.

    A worker is made when its study is first come to. Studies of which all tasks are in other hands are left
    for the next one and looked at again, in case one of the holders dies.
    """
    made: dict[int, TaskWorker] = {}
    left = dict(enumerate(workers))
    while left and not stop():
        for k, make in list(left.items()):
            if k not in made:
                made[k] = make()
            if made[k].work():
                del left[k]
            if stop():
                break
        if left and not stop():
            made[next(iter(left))].meter.waiting()
            time.sleep(POLL_SECONDS)


def check_searches(store: Store, study_id: int) -> None:
    """Raise StoreError for a study whose other runs were made by searches that took other steps."""
    study = store.study(study_id)
    before = study.versions.get("searches", "1")
    if before != str(SEARCHES):
        raise StoreError(
            f"Study {study_id} ({study.name}) was begun by plantfit "
            f"{study.versions.get('plantfit', 'of unknown version')} with edition {before} of the searches, "
            f"and this plantfit has edition {SEARCHES}: its runs could not be compared. Finish it with that "
            "version, or start it anew with `plantfit run`; `plantfit report` still shows what it has."
        )


def note_changes(store: Store, study_id: int, now: dict[str, str]) -> None:
    """Note in the study what it goes on with if that is not what it began with."""
    study = store.study(study_id)
    before = dict(study.versions) | {"CPU": study.cpu}
    known = [key for key in now if key in before or key != "engine"]  # which older studies do not tell
    changed = [f"{key} {before.get(key, 'unknown')} became {now[key]}" for key in known if before.get(key) != now[key]]
    if changed:
        store.add_note(
            study_id, f"Worked on elsewhere ({', '.join(changed)}); runs from there may differ in their last bits."
        )


def latched(stop: Callable[[], bool] | None) -> Callable[[], bool]:
    """`stop`, but once True always True, so that a stop is never seen by half of the code."""
    stopped = False

    def asked() -> bool:
        nonlocal stopped
        stopped = stopped or (stop is not None and bool(stop()))
        return stopped

    return asked


def _worker(store, study_id, objective, to_physical, progress, stop, search, checkpoint_seconds) -> TaskWorker:
    study = store.study(study_id)
    plan = Plan.from_record(study.plan)
    return TaskWorker(
        store, study_id, plan, objective, study.coordinates, to_physical, progress, stop, search, checkpoint_seconds
    )  # fmt: skip
