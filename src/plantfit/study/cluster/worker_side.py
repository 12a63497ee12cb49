"""What runs inside a worker process of a dask cluster. Nothing here touches a store; only plain values and bytes
travel."""

import threading
from typing import Any

from distributed import Queue, WorkerPlugin, get_worker

from plantfit.errors import PlantfitError
from plantfit.optimize import Checkpoint
from plantfit.study.plan import Plan, Task
from plantfit.study.problem_recipe import Made, Recipe
from plantfit.study.running.checkpoint_keeper import Keeper
from plantfit.study.running.probe import check_same, probe
from plantfit.study.running.search import search_task
from plantfit.study.running.task_worker import as_planned, check_results, complete, parameters
from plantfit.study.versions import cpu_model, versions

TELL_SECONDS = 0.5
GONE = "cancelled"  # state of a task that nobody waits for any more


class Studied(WorkerPlugin):
    """A study as every worker process of the cluster gets it, those that come later too; made when first asked for."""

    def __init__(
        self, study_id: int, recipe: Recipe, plan: dict[str, Any], names: tuple[str, ...], before: bytes, start: Any
    ):
        self.study_id, self.recipe, self.plan, self.names, self.before, self.start = (
            study_id,
            recipe,
            plan,
            names,
            before,
            start,
        )

    def setup(self, worker: Any) -> None:
        """Called by dask when the study arrives."""
        self._lock = threading.Lock()
        self._made: Made | None = None

    def teardown(self, worker: Any) -> None:
        """Called by dask when the study is taken away."""

    def search(self, task: Task, checkpoint: bytes | None, queue: str, key: str, seconds: float) -> dict[str, Any]:
        """The finished runs of a task as bytes, or what went wrong as a sentence."""
        with self._lock:  # one task at a time: a search uses one core, and its compiled loops are not shared by threads
            try:
                if self._made is None:
                    objective, to_physical = self.recipe.make(self.start)
                    check_same(self.before, probe(objective, to_physical), self.study_id)
                    self._made = as_planned(objective, Plan.from_record(self.plan)), to_physical
                return self._searched(self._made, task, checkpoint, _Line(queue, key), seconds)
            except PlantfitError as error:
                return {"error": type(error).__name__, "sentence": str(error)}

    def _searched(
        self, made: Made, task: Task, checkpoint: bytes | None, line: "_Line", seconds: float
    ) -> dict[str, Any]:
        objective, to_physical = made
        keeper = Keeper(line.save, seconds)
        results = search_task(
            objective, Plan.from_record(self.plan), task,
            progress=line.tell, checkpoint=keeper.offer, resume=checkpoint, stop=line.is_cut,
        )  # fmt: skip
        if not complete(results, task):
            return {}  # nobody waits for it
        check_results(results, task, objective.dimension)
        return {
            "runs": Checkpoint("", tuple(results)).to_bytes(),
            "parameters": [parameters(self.names, to_physical, r.x) for r in results],
            "versions": versions() | {"CPU": cpu_model()},
        }


class _Line:
    """From a task to the process that waits for it: progress and checkpoints."""

    def __init__(self, queue: str, key: str):
        self.worker, self.queue, self.key = get_worker(), Queue(queue), key

    def tell(self, progress: Any) -> None:
        self.queue.put({"key": self.key, "evaluations": float(progress.evaluations)})

    def save(self, checkpoint: bytes) -> None:
        self.queue.put({"key": self.key, "checkpoint": checkpoint})

    def is_cut(self) -> bool:
        """Whether the waiting process is gone or wants no more of this task."""
        task = self.worker.state.tasks.get(self.key)
        return task is None or task.state == GONE


def do_task(
    study: str, key: str, method: str, first: int, count: int, checkpoint: bytes | None, queue: str, seconds: float
) -> dict[str, Any]:
    """One task on this worker; `study` is the name under which dask keeps the `Studied`."""
    studied: Any = get_worker().plugins[study]
    return studied.search(Task(method, first, count), checkpoint, queue, key, seconds)
