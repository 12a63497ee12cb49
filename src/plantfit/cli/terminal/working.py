"""Studies searched by this process, by helpers on this machine, or by a cluster."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from plantfit.cli.terminal.interrupts import Stopping, stoppable
from plantfit.cli.terminal.out import preparing, warn
from plantfit.errors import SearchError

if TYPE_CHECKING:
    from plantfit.spec import Study
    from plantfit.stages import Prepared


@dataclass(frozen=True)
class Ready:
    """A study file and its problem, `prepared`; `number` is its study in the store, None before it is begun."""

    study: "Study"
    prepared: "Prepared"
    number: int | None


def ready(study: "Study", number: int | None) -> Ready:
    """Prepare the problem of a study file as every worker does."""
    from plantfit.rebuild import prepared_study

    demand_search(study)
    with preparing(study.name, study.table.search.shooting):
        return Ready(study, prepared_study(study), number)


def demand_search(study: Any) -> None:
    """Raise SearchError for a study that is solved at once: a search would end at plain least squares."""
    if study.regression is not None:
        raise SearchError(
            f"{study.path.name} has a table [regression] and needs no search; solve it by `plantfit run "
            f"{study.path.name}`."
        )


def worker_count(workers: str | None, scheduler: str | None) -> int | None:
    """The number that `--workers` asks for; None if it is left open. Raises SearchError."""
    from plantfit.study.running.cores import sensible_workers

    if scheduler not in (None, "local") and workers is not None:
        raise SearchError(
            "--workers cannot be used with a scheduler, which has its own workers; leave --workers out, or use "
            "--scheduler local."
        )
    if workers is None:
        return None
    if workers == "auto":
        return sensible_workers()
    if not workers.isascii() or not workers.isdigit() or not 1 <= int(workers) <= 1024:
        raise SearchError(
            f"--workers {workers} cannot be used; give a number from 1 to 1024, or auto for one for each core."
        )
    return int(workers)


def search(
    opened: Any, chosen: Sequence[Ready], workers: str | None, scheduler: str | None, quiet: bool
) -> tuple[list[int], bool]:
    """Begin or go on with studies; their numbers, and whether Ctrl-C stopped them."""
    from plantfit.cli.terminal.watching import study_progress  # rich.live, after the study files were understood

    count = worker_count(workers, scheduler)
    numbers: list[int] = []

    def named(number: int) -> str:
        return chosen[numbers.index(number)].study.name if len(chosen) > 1 else ""

    with ExitStack() as stack:
        tell = stack.enter_context(study_progress(quiet, named))
        stop = stack.enter_context(stoppable(farewell=lambda: _farewell(opened, numbers)))
        if scheduler is None:
            numbers += [_begun(opened, one) for one in chosen]
            _here(opened, chosen, numbers, count or 1, tell, stop)
        else:
            # first, so that no study is begun if nobody answers
            client = stack.enter_context(_client(scheduler, count))
            numbers += [_begun(opened, one) for one in chosen]
            _cluster(opened, chosen, numbers, client, tell, stop)
        return numbers, stop()


def _farewell(opened: Any, numbers: Sequence[int]) -> str:
    from plantfit.study.store.addresses import store_option

    if not numbers:
        return "Stopped at once, before any work began."
    where = store_option(opened.name)
    return (
        f"Stopped at once; go on from the last checkpoint with `plantfit resume {' '.join(map(str, numbers))}{where}`."
    )


def _begun(opened: Any, one: Ready) -> int:
    from plantfit.stages import begin

    return (
        begin(one.prepared, one.study.plan, opened, one.study.text, one.study.path)
        if one.number is None
        else one.number
    )


def _here(opened: Any, chosen: Sequence[Ready], numbers: Sequence[int], count: int, tell: Any, stop: Stopping) -> None:
    from plantfit.study.running.helper_processes import helping
    from plantfit.study.running.runner import attend, joined, latched

    with helping(opened, numbers, count - 1, say=warn) as team:
        # their claims are free at once, their newest checkpoints are saved
        stop.before_exit += [helper.kill for helper in team]
        asked = latched(stop)
        attend(
            [
                lambda one=one, number=number: joined(
                    opened, number, one.prepared.objective, one.prepared.to_physical, tell, asked
                )
                for one, number in zip(chosen, numbers, strict=True)
            ],
            asked,
        )


def _client(scheduler: str, count: int | None) -> Any:
    from plantfit.study.cluster.driver import connected

    return connected(scheduler, count)


def _cluster(
    opened: Any, chosen: Sequence[Ready], numbers: Sequence[int], client: Any, tell: Any, stop: Callable[[], bool]
) -> None:
    from plantfit.rebuild import recipe_of
    from plantfit.study.cluster.driver import Job, work_on_cluster

    jobs = [
        Job(number, recipe_of(one.study), one.prepared.objective.start)
        for one, number in zip(chosen, numbers, strict=True)
    ]
    work_on_cluster(opened, jobs, client, progress=tell, stop=stop, say=warn)
