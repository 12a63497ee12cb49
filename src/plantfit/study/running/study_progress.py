"""Progress of a whole study from the progress of its tasks, whoever works on them."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from plantfit.optimize.loop.progress import Progress
from plantfit.study.plan import Plan
from plantfit.study.store.claims import Held
from plantfit.study.store.store import Store

LOOK_SECONDS = 1.0  # between two looks into the store for the work of others


@dataclass(frozen=True, kw_only=True)
class StudyProgress(Progress):
    """Where a study stands. `method` is the one at work here, `best` the lowest cost of any method (inf
    before the first), `seconds` the time since this worker began, `seconds_left` None until known.
    `workers` are the tasks that live workers hold, this one's among them.
    """

    study_id: int
    method: str
    tasks_done: int
    tasks: int
    workers: tuple[Held, ...] = ()


class Meter:
    """Adds the task at work in this process to what the store knows, and tells the sum to `callback`.

    `mine` is the name of this worker; `spent` are the evaluations of its task so far.
    """

    def __init__(
        self, store: Store, study_id: int, plan: Plan, callback: Callable[[StudyProgress], None] | None, mine: str = ""
    ):
        self.store, self.study_id, self.plan, self.callback, self._mine = store, study_id, plan, callback, mine
        self.spent: float | None = None
        self._began = self._looked = time.monotonic()
        self._first: tuple[float, float] | None = None  # time and work of the first report
        self._method, self._done = "", (0, 0, 0, 0.0, float("inf"))
        self._held: tuple[Held, ...] = ()

    def refresh(self, method: str) -> None:
        """A task of `method` begins or has ended: read what is finished, by this worker and others."""
        self.spent = None
        if self.callback is not None:
            self._method = method
            self._look()
            self._tell(0, 0.0, float("inf"))

    def waiting(self) -> None:
        """Others work and this worker does not."""
        if self.callback is not None and time.monotonic() - self._looked >= LOOK_SECONDS:
            self.refresh(self._method)

    def __call__(self, task: Progress) -> None:
        """Progress of the running task."""
        self.spent = task.evaluations
        if self.callback is not None:
            if time.monotonic() - self._looked >= LOOK_SECONDS:
                self._look()
            self._tell(task.runs_done, task.evaluations, task.best)

    def _look(self) -> None:
        self._looked = time.monotonic()
        self._done, self._held = self.store.counts(self.study_id), tuple(self.store.held(self.study_id))

    def _elsewhere(self) -> float:
        """Evaluations of unfinished tasks of other workers."""
        return sum(h.evaluations or 0.0 for h in self._held if h.worker != self._mine)

    def _work(self, runs: int, evaluations: float) -> float:
        """Evaluations done or saved: a finished run counts as its whole budget."""
        return self._done[2] * self.plan.budget + max(evaluations, runs * self.plan.budget) + self._elsewhere()

    def _tell(self, runs: int, evaluations: float, best: float) -> None:
        assert self.callback is not None
        plan, (tasks_done, tasks, runs_done, spent, lowest) = self.plan, self._done
        total_runs = plan.runs * len(plan.methods)
        self.callback(
            StudyProgress(
                study_id=self.study_id,
                method=self._method,
                tasks_done=tasks_done,
                tasks=tasks,
                runs_done=runs_done + runs,
                runs=total_runs,
                evaluations=spent + evaluations + self._elsewhere(),
                budget_total=float(total_runs * plan.budget),
                best=min(lowest, best),
                seconds=time.monotonic() - self._began,
                seconds_left=self._left(runs, evaluations, total_runs * plan.budget),
                workers=self._held,
            )
        )

    def _left(self, runs: int, evaluations: float, total: float) -> float | None:
        now, work = time.monotonic(), self._work(runs, evaluations)
        if work >= total:
            return 0.0
        if (
            self._first is None and evaluations + self._elsewhere() > 0
        ):  # from here on, what a checkpoint brought is no pace
            self._first = now, work
        began, before = self._first or (now, work)
        return (total - work) * (now - began) / (work - before) if work > before else None
