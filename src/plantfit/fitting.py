"""The short way: `fit(problem)` gives an `Answer`, and may keep its runs in a store."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer as Answer
from plantfit.errors import SearchError
from plantfit.estimate.estimate import Estimate
from plantfit.optimize import minimise
from plantfit.optimize.contract import Host, Population
from plantfit.problem.problem import Problem
from plantfit.stages import Stated, begin, judged, judged_in_store, prepare, stated_in_file, stored_runs
from plantfit.study.plan import AFTER_SHOOTING, Plan, default_budget
from plantfit.study.running import runner
from plantfit.study.store.store import Store
from plantfit.trust.finish.descent import gauss_newton as gauss_newton
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.stated_errors.parameter_uncertainty import check_errors
from plantfit.trust.stated_errors.shared_error import SharedError


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

    Chooses the step of the simulation, searches, estimates from the residuals the scale of every output that was given
    none when there are several outputs, checks the step at the answer, and brings every run to its end on that final
    problem.

    `method` is a name of `plantfit.methods`, with `settings` by name, or an instance, as of `plantfit.methods.make` or
    of a class of your own, without `settings`. Each of the `runs` gets `budget` evaluations (by default at least 6000,
    1500 for each parameter), and depends on `seed` and its number alone. `progress` is called with a `Progress` (with a
    `store`: a `StudyProgress`); `stop` is asked again and again, and ends the search when it says True.

    With `shooting` every record is first cut into so many segments whose ends need not meet, which finds answers in
    long, oscillating and unstable records (docs/long-records.md); the search then begins at what it found. `errors` of
    instruments and `draws` are for the intervals (docs/uncertainty.md); left out, a problem that was read from a study
    file has those of the file.

    With a `store`, a place as of `Store.open` or a Store, every run is kept when it is finished, as a study with the
    name of the problem, and `plantfit.open_study` gives the answer again. Methods are then given by name.

    Raises SearchError when no candidate could be simulated and for a method, setting or budget that cannot work,
    StoreError for a store that cannot be used.
    """
    file = problem.study_file
    if file is not None and file.solved:
        raise SearchError(
            f"{file.path.name} has a table [regression]; solve it by plantfit.regress, or by `plantfit run "
            f"{file.path.name}`."
        )
    stated = _stated(problem, errors, draws, store is not None)
    check_errors(problem, stated[0])
    prepared = prepare(problem, shooting=shooting, seed=seed)
    if shooting is not None and method == "auto":
        method, settings = AFTER_SHOOTING[0], {**AFTER_SHOOTING[1], **dict(settings or {})}
    budget = budget or default_budget(problem.space.dimension)
    started = time.perf_counter()
    if store is None:
        results = minimise(
            prepared.objective,
            method,
            runs=runs,
            budget=budget,
            seed=seed,
            settings=dict(settings or {}),
            progress=progress,
            stop=stop,
        )
        seconds = {"prepare": prepared.seconds, "search": time.perf_counter() - started}
        return judged(prepared.problem, results, seed=seed, spec=spec, command=command, seconds=seconds, stated=stated)
    if not isinstance(method, str):
        raise SearchError(
            "A store keeps a method by its name, so that other processes can go on with it; give method='cmaes' and "
            "settings={...}, "
            "or leave store out."
        )
    plan = Plan(problem.name, (method,), runs, budget, seed, {method: dict(settings)} if settings else {})
    opened = store if isinstance(store, Store) else Store.open(store)
    number = begin(prepared, plan, opened, None if file is None else file.text, None if file is None else file.path)
    runner.resume(opened, number, prepared.objective, to_physical=prepared.to_physical, progress=progress, stop=stop)
    return judged_in_store(
        opened, number, problem, stored_runs(opened, number), prepared, seed=seed,
        spec=spec if file is None else file.text,
        command=command, seconds={"prepare": prepared.seconds, "search": time.perf_counter() - started}, stated=stated,
    )  # fmt: skip


def _stated(problem: Problem, errors: Sequence[SharedError] | None, draws: int | None, stored: bool) -> Stated:
    """As `stated_in_file`; a stored study is opened with those of its file, so that it may state no others."""
    file = problem.study_file
    if stored and file is not None and errors is not None and (tuple(errors), draws) != (file.errors, file.draws):
        raise SearchError(
            f"{file.path.name} states other errors or draws than were given, and the stored study would "
            "be opened with those of the file; write them into the file, or leave errors or store out."
        )
    return stated_in_file(problem, errors, draws)


def estimate_at(problem: Problem, z: np.ndarray, names: Sequence[str]) -> Estimate:
    """The parameters `names` at the cube point z (d,), with the covariance that all others being free leaves them."""
    local, at = linearise(problem, z), [problem.space.names.index(n) for n in names]
    return Estimate(tuple(names), local.values[at], local.covariance[np.ix_(at, at)])
