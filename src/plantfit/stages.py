"""The stages from a problem to its answer, the one way of `fit`, commands, stored studies and workers.

    prepare   the step of the simulation, starts by multiple shooting, and what a search sees
    search    seeded runs: in this process, or `begin` them in a store, in which any process works on them
    finish    scales, steps fine enough, and every run led to its end on that final problem
    judge     findings, when they are asked for

`judged` takes runs, however they were searched, through the last two; `judged_in_store` those of a stored study, which
is finished once.
"""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import StoreError
from plantfit.optimize.contract import Objective, RunResult
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.problem.problem import GENERALISED, Problem
from plantfit.problem.shooting.start import Shooting
from plantfit.study.objective import objective_of
from plantfit.study.plan import Plan
from plantfit.study.running import runner
from plantfit.study.running.probe import check_same, probe
from plantfit.study.running.task_worker import ToPhysical
from plantfit.study.store.addresses import shown
from plantfit.study.store.store import Store
from plantfit.trust.finish.final_problem import finish
from plantfit.trust.finish.noise_weights import with_noise_weights
from plantfit.trust.finish.stored import finish_bytes, finish_key, finish_of_bytes
from plantfit.trust.stated_errors.shared_error import SharedError

Stated = tuple[Sequence[SharedError], int | None]
"""Errors of instruments, and the refits that carry them to the parameters (None: to first order)."""
_OF_RUN = tuple(f.name for f in dataclasses.fields(RunResult))


@dataclass(frozen=True)
class Prepared:
    """A problem with its steps chosen, what a search sees of it, and how long that took."""

    problem: Problem
    objective: Objective
    seconds: float

    @property
    def to_physical(self) -> ToPhysical:
        """Cube points (d,) or (n, d) in declared units."""
        return self.problem.space.physical


def prepare(
    problem: Problem, *, shooting: int | None = None, seed: int = 0, start: np.ndarray | None = None
) -> Prepared:
    """The same for the same arguments in any process, so that workers and resumed studies repeat it.

    A search begins at the cube points `start` (k, d), else where multiple shooting with so many segments a record ends,
    else at the guesses of the space.
    """
    began = time.perf_counter()
    if problem.by_filters:  # whose rooms are slow to import
        from plantfit.filter_answer import check_estimator

        check_estimator(problem)
    chosen = choose_substeps(problem)
    if start is None and shooting is not None:
        start = Shooting.of(chosen, segments=shooting).search(seed=seed).z[None, :]
    return Prepared(chosen, objective_of(chosen, start), time.perf_counter() - began)


def begin(prepared: Prepared, plan: Plan, store: Store, text: str | None = None, path: Path | None = None) -> int:
    """Put a study into a store, with the `text` and the `path` of its study file if it has one; its number."""
    return runner.begin(
        plan, prepared.objective, store, spec_text=text, spec_path=None if path is None else str(path.resolve()),
        coordinates=prepared.problem.space.names, to_physical=prepared.to_physical,
    )  # fmt: skip


def stored_runs(store: Store, number: int) -> list[RunResult]:
    """The finished runs of a stored study, as the searches gave them. Raises StoreError where there is none."""
    found = [RunResult(**{f: getattr(r, f) for f in _OF_RUN}) for r in store.runs(number)]
    if not found:
        raise StoreError(
            f"Study {number} in {shown(store.name)} has no finished run yet; go on with `plantfit resume {number}`."
        )
    return found


def stated_in_file(problem: Problem, errors: Sequence[SharedError] | None, draws: int | None) -> Stated:
    """The errors of instruments and the refits for them: as given, else as the study file of the problem states
    them."""
    file = problem.study_file
    if file is None or errors is not None:
        return errors or (), draws
    return file.errors, file.draws if draws is None else draws


def judged(
    problem: Problem,
    runs: Sequence[RunResult],
    *,
    seed: int,
    spec: str | None,
    command: str,
    seconds: Mapping[str, float],
    stated: Stated,
) -> Answer:
    """The answer of searched runs of a prepared problem; `seconds` by the stages before."""
    began = time.perf_counter()
    final, results = finish(problem, runs)
    final = _weighted(_filtered(final, results, spec, stated), results, stated)
    spent = {**seconds, "finish": time.perf_counter() - began}
    return Answer(final, results, seed, spec, command, spent, tuple(stated[0]), stated[1])


def judged_in_store(
    store: Store, number: int, problem: Problem, runs: Sequence[RunResult], prepared: Prepared | None = None, *,
    refuse: bool = False,
    seed: int, spec: str | None, command: str, seconds: Mapping[str, float], stated: Stated,
) -> Answer:  # fmt: skip
    """The answer of the runs of a stored study: with the finishing that the store keeps, else finished now, and kept
    there.

    `problem` is as it was written, `prepared` the same where it is prepared already. Another problem than that of the
    study is not kept, and with `refuse` it raises StoreError.
    """
    key, began = finish_key(problem, runs, _wishes(problem, spec, stated)), time.perf_counter()
    found = None if key is None else finish_of_bytes(store.finish_of(number, key), key, problem, runs)
    if found is None:
        prepared = prepared or prepare(problem)
        same = _is_of_study(store, number, prepared, refuse)
        began = time.perf_counter()
        made, ends = finish(prepared.problem, runs)
        found = _filtered(made, ends, spec, stated), ends
        if key is not None and same:
            store.keep_finish(number, key, finish_bytes(key, *found))
    final, results = found
    final = _weighted(final, results, stated)
    spent = {**seconds, "finish": time.perf_counter() - began}
    return Answer(final, results, seed, spec, command, spent, tuple(stated[0]), stated[1])


def _wishes(problem: Problem, spec: str | None, stated: Stated) -> str:
    """What finishing depends on beside problem and runs, as text."""
    if not problem.by_filters:
        return ""
    from plantfit.filter_answer import filter_wishes

    return f"{filter_wishes(problem, spec)} {bool(stated[0])}"


def _filtered(final: Problem, runs: Sequence[RunResult], spec: str | None, stated: Stated) -> Problem:
    """The final problem with the answer of maximum likelihood or of a Kalman filter, where that is asked for."""
    if not final.by_filters:
        return final
    from plantfit.filter_answer import with_filter_answer

    return with_filter_answer(final, runs, spec, bool(stated[0]))


def _weighted(final: Problem, runs: Sequence[RunResult], stated: Stated) -> Problem:
    """The final problem, weighted for its noise where that is asked for and no errors of instruments are stated, whose
    effect is that on least squares."""
    if not stated[0]:
        return with_noise_weights(final, runs)
    return final.with_answer(None, "errors of instruments are stated") if final.estimator == GENERALISED else final


def _is_of_study(store: Store, number: int, prepared: Prepared, refuse: bool) -> bool:
    """Whether a problem is that of a stored study; with `refuse` another one raises StoreError."""
    try:
        check_same(store.probe(number), probe(prepared.objective, prepared.to_physical), number)
    except StoreError:
        if refuse:
            raise
        return False
    return True
