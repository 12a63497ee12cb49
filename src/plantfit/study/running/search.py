"""One task through `plantfit.optimize.minimise`, with checkpoints as bytes."""

from collections.abc import Callable
from typing import Protocol

from plantfit.optimize import Checkpoint, minimise
from plantfit.optimize.contract import Objective, RunResult
from plantfit.optimize.loop.progress import Progress
from plantfit.study.plan import Plan, Task


class Search(Protocol):
    """Do one task of a plan. Same plan and task, same bits, whatever the checkpoint it goes on from.

    `checkpoint` takes a function that encodes where the task stands, called only when it is kept.
    Results are one per run; a run that `stop` ended has status interrupted or is left out.
    """

    def __call__(
        self,
        objective: Objective,
        plan: Plan,
        task: Task,
        *,
        progress: Callable[[Progress], None],
        checkpoint: Callable[[Callable[[], bytes]], None],
        resume: bytes | None,
        stop: Callable[[], bool],
    ) -> list[RunResult]: ...


def search_task(
    objective: Objective,
    plan: Plan,
    task: Task,
    *,
    progress: Callable[[Progress], None],
    checkpoint: Callable[[Callable[[], bytes]], None],
    resume: bytes | None,
    stop: Callable[[], bool],
) -> list[RunResult]:
    """The `Search` that studies use."""
    return minimise(
        objective,
        task.method,
        runs=task.count,
        first_run=task.first,
        budget=plan.budget,
        seed=plan.seed,
        settings=plan.settings.get(task.method),
        progress=progress,
        checkpoint=lambda point: checkpoint(point.to_bytes),
        resume=None if resume is None else Checkpoint.from_bytes(resume),
        stop=stop,
    )
