"""The short way: `fit(problem)` gives an `Answer`, and may keep its runs in a store."""

import dataclasses
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer as Answer
from plantfit.errors import SearchError, StoreError
from plantfit.estimate.estimate import Estimate
from plantfit.optimize import minimise
from plantfit.optimize.contract import Host, Objective, Population, RunResult
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.start import Shooting
from plantfit.study.objective import objective_of
from plantfit.study.plan import Plan, default_budget
from plantfit.study.running import runner
from plantfit.study.store.addresses import shown
from plantfit.study.store.store import Store
from plantfit.trust.finish.descent import gauss_newton as gauss_newton
from plantfit.trust.finish.final_problem import finish
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.stated_errors.parameter_uncertainty import check_errors
from plantfit.trust.stated_errors.shared_error import SharedError

_OF_RUN = tuple(f.name for f in dataclasses.fields(RunResult))


def fit(
    problem: Problem,
    method: str | Population | Host = "auto",
    *,
    runs: int = 1,
    budget: int | None = None,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    shooting: int | None = None,
    progress: Callable[[Any], None] | None = None,
    stop: Callable[[], bool] | None = None,
    spec: str | None = None,
    command: str = "",
    errors: Sequence[SharedError] | None = None,
    draws: int | None = None,
    store: Store | str | os.PathLike[str] | None = None,
) -> Answer:
    """Find the parameters and what they are worth.

    Chooses the step of the simulation, searches, estimates from the residuals the scale of every output that was given none when
    there are several outputs, checks the step at the answer, and brings every run to its end on that final problem.

    `method` is a name of `plantfit.methods`, with `settings` by name, or an instance, as of `plantfit.methods.make` or of a class of
    your own, without `settings`. Each of the `runs` gets `budget` evaluations (by default at least 6000, 1500 for each parameter), and
    depends on `seed` and its number alone. `progress` is called with a `Progress` (with a `store`: a `StudyProgress`); `stop` is asked
    again and again, and ends the search when it says True.

    With `shooting` every record is first cut into so many segments whose ends need not meet, which finds answers in long, oscillating
    and unstable records (docs/long-records.md); the search then begins at what it found. `errors` of instruments and `draws` are for
    the intervals (docs/uncertainty.md); left out, a problem that was read from a study file has those of the file.

    With a `store`, a place as of `Store.open` or a Store, every run is kept when it is finished, as a study with the name of the
    problem, and `plantfit.open_study` gives the answer again. Methods are then given by name.

    Raises SearchError when no candidate could be simulated and for a method, setting or budget that cannot work, StoreError for a store
    that cannot be used.
    """
    file = problem.study_file
    if file is not None and file.solved:
        raise SearchError(
            f"{file.path.name} has a table [regression]; solve it by plantfit.regress, or by `plantfit run {file.path.name}`."
        )
    errors, draws = _stated(problem, errors, draws, store is not None)
    check_errors(problem, errors)
    started = time.perf_counter()
    problem = prepare(problem)
    prepared = time.perf_counter()
    start = shooting_starts(problem, shooting, seed)
    if start is not None and method == "auto":
        method, settings = "least_squares", {"agree": 1, **dict(settings or {})}
    objective, budget = objective_of(problem, start), budget or default_budget(problem.space.dimension)
    if store is None:
        results: Sequence[RunResult] = minimise(
            objective, method, runs=runs, budget=budget, seed=seed, settings=dict(settings or {}), progress=progress, stop=stop
        )
    else:
        if not isinstance(method, str):
            raise SearchError(
                "A store keeps a method by its name, so that other processes can go on with it; give method='cmaes' and settings={...}, "
                "or leave store out."
            )
        plan = Plan(problem.name, (method,), runs, budget, seed, {method: dict(settings)} if settings else {})
        results = _kept(store, plan, problem, objective, None if file is None else (file.text, str(file.path.resolve())), progress, stop)
        spec = spec if file is None else file.text
    searched = time.perf_counter()
    problem, results = finish(problem, results)
    seconds = {"prepare": prepared - started, "search": searched - prepared, "finish": time.perf_counter() - searched}
    return Answer(problem, results, seed, spec, command, seconds, tuple(errors), draws)


def _stated(
    problem: Problem, errors: Sequence[SharedError] | None, draws: int | None, stored: bool
) -> tuple[Sequence[SharedError], int | None]:
    """The errors of instruments and the refits for them: as given, else as the study file of the problem states them."""
    file = problem.study_file
    if file is None or errors is not None:
        if stored and file is not None and (tuple(errors or ()), draws) != (file.errors, file.draws):
            raise SearchError(
                f"{file.path.name} states other errors or draws than were given, and the stored study would be opened with those of the "
                "file; write them into the file, or leave errors or store out."
            )
        return errors or (), draws
    return file.errors, file.draws if draws is None else draws


def _kept(
    store: Any, plan: Plan, problem: Problem, objective: Objective, file: tuple[str, str] | None, progress: Any, stop: Any
) -> list[RunResult]:
    """The finished runs of a plan that is begun in a store. Raises StoreError where none was finished before `stop`."""
    opened = store if isinstance(store, Store) else Store.open(store)
    text, path = file or (None, None)
    number = runner.run(
        plan, objective, opened, spec_text=text, spec_path=path, coordinates=problem.space.names, to_physical=problem.space.physical,
        progress=progress, stop=stop,
    )  # fmt: skip
    return stored_runs(opened, number)


def stored_runs(store: Store, number: int) -> list[RunResult]:
    """The finished runs of a stored study, as the searches gave them. Raises StoreError where there is none."""
    found = [RunResult(**{f: getattr(r, f) for f in _OF_RUN}) for r in store.runs(number)]
    if not found:
        raise StoreError(f"Study {number} in {shown(store.name)} has no finished run yet; go on with `plantfit resume {number}`.")
    return found


def shooting_starts(problem: Problem, segments: int | None, seed: int) -> np.ndarray | None:
    """Where multiple shooting with so many segments a record ends (1, d); None without segments."""
    return None if segments is None else Shooting.of(problem, segments=segments).search(seed=seed).z[None, :]


def prepare(problem: Problem) -> Problem:
    """Choose the substeps of the simulation; the same for the same problem, so that a resumed study repeats it."""
    return choose_substeps(problem)


def estimate_at(problem: Problem, z: np.ndarray, names: Sequence[str]) -> Estimate:
    """The parameters `names` at the cube point z (d,), with the covariance that all others being free leaves them."""
    local, at = linearise(problem, z), [problem.space.names.index(n) for n in names]
    return Estimate(tuple(names), local.values[at], local.covariance[np.ix_(at, at)])
