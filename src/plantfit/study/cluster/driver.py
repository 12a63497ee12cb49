"""Studies on a dask cluster: this process holds the claims and the store, the workers of the cluster search.

Workers need neither the store nor the files of the study: problem and recordings travel with the first
task. A worker that is lost costs what it did since its task's last checkpoint.
"""

import logging
import time
import uuid
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np

from plantfit import errors
from plantfit.errors import MissingExtra, PlantfitError, SearchError, StoreError
from plantfit.optimize import Checkpoint
from plantfit.study.plan import Plan
from plantfit.study.problem_recipe import Recipe
from plantfit.study.running.cores import sensible_workers
from plantfit.study.running.heartbeat import BEAT_SECONDS
from plantfit.study.running.runner import CHECKPOINT_SECONDS, latched, note_changes
from plantfit.study.running.study_progress import Meter, StudyProgress
from plantfit.study.running.worker_names import new_worker
from plantfit.study.store.claims import Claim, ClaimLost
from plantfit.study.store.store import Store

LOCAL = "local"
LOOPBACK = "127.0.0.1"
CONNECT_SECONDS = 10
POLL_SECONDS = 0.1
DRY_SECONDS = 0.5  # between two looks for tasks that others have let go
MOST_LOSSES = 5
LOST_SECONDS = 1.0  # between two looks at which workers the cluster has

Say = Callable[[str], None]


@dataclass(frozen=True)
class Job:
    """A study that is begun, how workers make its problem, and the warm starts of its search (k, d), if any."""

    study: int
    recipe: Recipe
    start: np.ndarray | None = None


@contextmanager
def connected(address: str, workers: int | None = None) -> Generator[Any]:
    """A dask client of the scheduler at an address, or of "local" worker processes (`workers`, else one for each core).

    Raises MissingExtra without dask, and SearchError when nobody answers.
    """
    if find_spec("distributed") is None:
        raise MissingExtra(
            "Working on a cluster needs the package dask; install it with: pip install 'plantfit[cluster]'"
        )
    import distributed

    with _silent("distributed"), _client(distributed, address, workers) as client:
        yield client


def work_on_cluster(
    store: Store,
    jobs: Sequence[Job],
    client: Any,
    *,
    progress: Callable[[StudyProgress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    say: Say = lambda sentence: None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> None:
    """Work on studies with all workers of a cluster until they are done or `stop` says True.

    Workers may come and go. Results have the same bits as in this process on the same CPU type with the same
    versions; others are noted in the study. `say` gets a sentence when a worker is lost or none is there.
    Raises SearchError and StoreError; what is finished and the newest checkpoints are kept.
    """
    driver = _Driver(store, jobs, client, progress, latched(stop), say, checkpoint_seconds)
    try:
        driver.work()
    except PlantfitError:
        raise
    except Exception as error:
        if (
            not isinstance(error, OSError) and client.status == "running"
        ):  # dask's own errors of connections are OSErrors
            raise
        raise SearchError(
            f"The connection to the dask scheduler was lost ({str(error) or type(error).__name__}); "
            "what is done is saved, go on with `plantfit resume`."
        ) from error
    finally:
        driver.let_go()


@contextmanager
def _silent(package: str) -> Generator[None]:
    """Lost workers and connections are told by this module, not by the logs of a package."""
    logs = [
        logging.getLogger(name) for name in (package, *logging.root.manager.loggerDict) if name.split(".")[0] == package
    ]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)


@contextmanager
def _client(distributed: Any, address: str, workers: int | None) -> Generator[Any]:
    if address == LOCAL:
        import dask.config

        count = workers or sensible_workers()
        with (
            # after 15 s dask closes the nanny of a lost worker, on a busy machine while it is starting it anew
            dask.config.set({"distributed.deploy.lost-worker-timeout": "7 days"}),
            distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                silence_logs=logging.CRITICAL,
                # what says who may connect: nobody but this machine. None would open a page on all of its addresses
                host=LOOPBACK,
                dashboard_address=f"{LOOPBACK}:0",
                worker_dashboard_address=f"{LOOPBACK}:0",
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise SearchError(
            f"No dask scheduler answers at {address!r}; start one with `dask scheduler`, "
            "give the address that it prints, or say local for workers on this machine."
        ) from error
    with client:
        yield client


@dataclass
class _Sent:
    """A task on its way: the claim that this process holds for it, where it is searched, the newest checkpoint."""

    claim: Claim
    study: str
    worker: str
    key: str
    future: Any
    checkpoint: bytes | None
    evaluations: float | None = None
    beat_at: float = field(default_factory=time.monotonic)


class _Driver:
    """Gives every worker of the cluster one task at a time."""

    def __init__(
        self, store: Store, jobs: Sequence[Job], client: Any, progress: Any, stop: Any, say: Say, seconds: float
    ):
        from distributed import LocalCluster, Queue

        self.store, self.jobs, self.client, self.stop, self.say, self.seconds = store, jobs, client, stop, say, seconds
        self.session = uuid.uuid4().hex
        self.queue = Queue(f"plantfit-{self.session}", client=client)
        self.sent: dict[str, _Sent] = {}  # by worker
        self.workers: dict[str, int] = {}
        # whose workers nobody else starts
        self.ours = client.cluster if isinstance(client.cluster, LocalCluster) else None
        self.looked_at = self.dry_until = -np.inf
        self.said: set[str] = set()
        self.losses: dict[int, int] = {}  # by task, since its last checkpoint
        self.left = [job.study for job in jobs]
        plans = {job.study: Plan.from_record(store.study(job.study).plan) for job in jobs}
        self.meters = {study: Meter(store, study, plan, progress) for study, plan in plans.items()}

    def work(self) -> None:
        for job in self.jobs:
            self.store.settle(job.study, active=True)
            self._publish(job)
        while self.left and not self.stop():
            self._look()
            self._listen()
            self._collect()
            self._send()
            self._beat()
            if self.left:
                self.meters[self.left[0]].waiting()
                time.sleep(POLL_SECONDS)

    def let_go(self) -> None:
        """Cancel what is on its way and give the tasks back with their newest checkpoints."""
        with suppress(Exception):
            self._listen()
        for sent in self.sent.values():
            with suppress(Exception):
                self.client.cancel(sent.future, force=True)
            with suppress(StoreError, ClaimLost):
                self.store.release(sent.claim, sent.checkpoint)
        for job in self.jobs:
            with suppress(Exception):
                self.client.unregister_worker_plugin(self._name(job.study))
            with suppress(StoreError):
                self.store.settle(job.study, active=False)
        with suppress(Exception):
            self.queue.close()

    def _name(self, study: int) -> str:
        return f"plantfit-{self.session}-{study}"

    def _publish(self, job: Job) -> None:
        from plantfit.study.cluster.worker_side import Studied

        study = self.store.study(job.study)
        studied = Studied(
            job.study, job.recipe, dict(study.plan), study.coordinates, self.store.probe(job.study), job.start
        )
        try:
            self.client.register_plugin(studied, name=self._name(job.study))
        except (ImportError, AttributeError) as error:
            raise SearchError(
                f"The workers of the cluster cannot load plantfit ({error}); "
                "install the same versions of plantfit and dask there as here."
            ) from error

    def _look(self) -> None:
        """Which workers there are; tasks of lost ones are free to be sent again from their newest checkpoints."""
        if time.monotonic() - self.looked_at < LOST_SECONDS:
            return
        self.looked_at = time.monotonic()
        self.workers = self.client.nthreads()
        if self.ours is not None:
            self._start_again(self.ours)
        elif not self.workers:
            self._say_once(
                "The cluster has no worker yet; waiting for one (start it with `dask worker ADDRESS --nthreads 1`)."
            )
        for worker, threads in self.workers.items():
            if threads > 1:
                self._say_once(
                    f"The worker {worker} has {threads} threads but does one task at a time; "
                    f"start it with `--nworkers {threads} --nthreads 1` to use all."
                )
        for worker in [w for w in self.sent if w not in self.workers]:
            self._count_loss(self.sent[worker].claim)
            self.say(f"Worker {worker} was lost; another goes on with its task.")
            self._give_back(worker)

    def _start_again(self, cluster: Any) -> None:
        """A nanny starts its worker anew; one that has given up is replaced, and nobody else would do it."""
        if len(self.workers) < len(cluster.worker_spec):
            for name, nanny in list(cluster.workers.items()):
                if nanny.status.name in ("closed", "failed"):
                    cluster.workers.pop(name, None)
            cluster.scale(len(cluster.worker_spec))

    def _count_loss(self, claim: Claim) -> None:
        """A task that ends every worker before its next checkpoint must not go round for ever."""
        self.losses[claim.id] = self.losses.get(claim.id, 0) + 1
        if self.losses[claim.id] >= MOST_LOSSES:
            task = claim.task
            raise SearchError(
                f"{MOST_LOSSES} workers in a row were lost at {task.method} from run {task.first} on; give them "
                "more memory or start fewer on a machine. What is done is saved, go on with `plantfit resume`."
            )

    def _give_back(self, worker: str) -> None:
        sent = self.sent.pop(worker)
        self.client.cancel(sent.future, force=True)
        with suppress(ClaimLost):
            self.store.release(sent.claim, sent.checkpoint)

    def _listen(self) -> None:
        """Take what the workers have told: progress, and checkpoints, which are saved at once."""
        by_key = {sent.key: sent for sent in self.sent.values()}
        told_all: Any = self.queue.get(batch=True)
        for told in told_all:
            sent = by_key.get(told["key"])
            if sent is None:
                continue
            sent.evaluations = told.get("evaluations", sent.evaluations)
            if "checkpoint" in told:
                sent.checkpoint = told["checkpoint"]
                self.losses.pop(sent.claim.id, None)
                with suppress(ClaimLost):  # seen at the next beat
                    self.store.save_checkpoint(sent.claim, told["checkpoint"])

    def _collect(self) -> None:
        for worker in [w for w, sent in self.sent.items() if sent.future.done()]:
            sent = self.sent[worker]
            if worker not in self.client.nthreads():
                self.looked_at = -np.inf  # the answer went with its worker
                continue
            answer = self._answer(sent)
            if "error" in answer:
                raise getattr(errors, answer["error"], SearchError)(answer["sentence"])
            if "runs" not in answer:
                self._give_back(worker)
                continue
            results = Checkpoint.from_bytes(answer["runs"]).finished
            note_changes(self.store, sent.claim.study, answer["versions"])
            with suppress(ClaimLost):  # taken over: the other worker's runs are the same bits
                self.store.finish(sent.claim, results, answer["parameters"])
            del self.sent[worker]
            self.meters[sent.claim.study].refresh(sent.claim.task.method)

    def _answer(self, sent: _Sent) -> dict[str, Any]:
        from distributed import CancelledError, KilledWorker

        try:
            return sent.future.result(timeout=CONNECT_SECONDS)
        except (KilledWorker, TimeoutError, CancelledError):
            return {}  # the worker went with the answer; if it was the scheduler, the next call says so
        except Exception as error:
            task = sent.claim.task
            raise SearchError(
                f"Worker {sent.worker} failed at {task.method} from run {task.first} on ({type(error).__name__}: "
                f"{error}); its log says more. What is done is saved, go on with `plantfit resume`."
            ) from error

    def _send(self) -> None:
        """A task for every worker that has none; studies in their order."""
        if time.monotonic() < self.dry_until:
            return
        for worker in [w for w in self.workers if w not in self.sent]:
            for study in list(self.left):
                if (claim := self.store.claim(study, new_worker(worker))) is not None:
                    self.sent[worker] = self._submit(claim, worker)
                    self.meters[study].refresh(claim.task.method)
                    break
                done, total, *_ = self.store.counts(study)
                if done == total:
                    self.left.remove(study)
                    self.store.settle(study, active=False)
            else:
                self.dry_until = time.monotonic() + DRY_SECONDS  # what is left is in the hands of others
                break

    def _submit(self, claim: Claim, worker: str) -> _Sent:
        from plantfit.study.cluster.worker_side import do_task

        key, study, task = f"plantfit-{uuid.uuid4().hex}", self._name(claim.study), claim.task
        future = self.client.submit(
            do_task, study, key, task.method, task.first, task.count, claim.checkpoint, self.queue.name, self.seconds,
            key=key, workers=[worker], pure=False, retries=0,
        )  # fmt: skip
        return _Sent(claim, study, worker, key, future, claim.checkpoint)

    def _beat(self) -> None:
        now = time.monotonic()
        for worker, sent in list(self.sent.items()):
            if now - sent.beat_at >= BEAT_SECONDS:
                sent.beat_at = now
                try:
                    self.store.beat(sent.claim, sent.evaluations)
                except ClaimLost:
                    del self.sent[worker]
                    self.client.cancel(sent.future, force=True)

    def _say_once(self, sentence: str) -> None:
        if sentence not in self.said:
            self.said.add(sentence)
            self.say(sentence)
