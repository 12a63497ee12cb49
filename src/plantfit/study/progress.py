"""Progress of a whole study from the progress of its tasks."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from plantfit.optimize.progress import Progress
from plantfit.study.plan import Plan
from plantfit.study.store import Store


@dataclass(frozen=True)
class StudyProgress:
    """Where a study stands. `method` is the one at work, `best` the lowest cost of any method (inf
    before the first), `seconds` the time since this worker began, `seconds_left` None until known.
    """

    study_id: int
    method: str
    tasks_done: int
    tasks: int
    runs_done: int
    runs: int
    evaluations: float
    budget_total: float
    best: float
    seconds: float
    seconds_left: float | None


class Meter:
    """Adds the running task to what the store has finished and tells the sum to `callback`."""

    def __init__(self, store: Store, study_id: int, plan: Plan, callback: Callable[[StudyProgress], None] | None):
        self.store, self.study_id, self.plan, self.callback = store, study_id, plan, callback
        self._began = time.monotonic()
        self._first: tuple[float, float] | None = None  # time and work of the first report
        self._method, self._done = "", (0, 0, 0, 0.0, float("inf"))

    def refresh(self, method: str) -> None:
        """A task of `method` begins or has ended: read what is finished, by this worker and others."""
        if self.callback is not None:
            self._method, self._done = method, self.store.counts(self.study_id)
            self._tell(0, 0.0, float("inf"))

    def __call__(self, task: Progress) -> None:
        """Progress of the running task."""
        if self.callback is not None:
            self._tell(task.runs_done, task.evaluations, task.best)

    def _work(self, runs: int, evaluations: float) -> float:
        """Evaluations done or saved: a finished run counts as its whole budget."""
        return self._done[2] * self.plan.budget + max(evaluations, runs * self.plan.budget)

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
                evaluations=spent + evaluations,
                budget_total=float(total_runs * plan.budget),
                best=min(lowest, best),
                seconds=time.monotonic() - self._began,
                seconds_left=self._left(runs, evaluations, total_runs * plan.budget),
            )
        )

    def _left(self, runs: int, evaluations: float, total: float) -> float | None:
        now, work = time.monotonic(), self._work(runs, evaluations)
        if work >= total:
            return 0.0
        if self._first is None and evaluations > 0:  # from here on, what a checkpoint brought is no pace
            self._first = now, work
        began, before = self._first or (now, work)
        return (total - work) * (now - began) / (work - before) if work > before else None
