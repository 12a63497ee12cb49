"""`minimise`: every method, population or host, behind one call."""

import hashlib
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from plantfit.errors import SearchError
from plantfit.optimize.contract import Host, Objective, Population, RunResult
from plantfit.optimize.loop.checkpoint import Checkpoint
from plantfit.optimize.loop.host_loop import run_host
from plantfit.optimize.loop.population_loop import plain_settings, run_population
from plantfit.optimize.loop.progress import Progress
from plantfit.optimize.loop.request import Plan
from plantfit.optimize.registry import make, name_of


def minimise(
    objective: Objective,
    method: str | Population | Host = "auto",
    *,
    runs: int = 1,
    budget: int = 1000,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    target: float | None = None,
    stagnation: int | None = None,
    first_run: int = 0,
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Callable[[Checkpoint], None] | None = None,
    resume: Checkpoint | None = None,
    stop: Callable[[], bool] | None = None,
) -> list[RunResult]:
    """Seeded runs of a method on an objective, each with the same budget of evaluations.

    Runs are numbered first_run, first_run + 1, ...; a run depends on (seed, number) and not on the
    runs beside it. A run ends at its budget (never exceeded; a generation that would not fit is not
    started), when its best cost is at most `target`, after `stagnation` evaluations without a better
    point (population methods), or by the method's own rule.
    `stop` is polled; when it returns true, runs under way come back with status interrupted and runs not
    yet begun are missing from the list. `checkpoint` receives the exact middle of the search about every
    half second (population methods) or after each run (host methods); `resume` goes on from one with the
    same bits. Raises SearchError for settings, needs or budgets that cannot work.
    """
    name = method if isinstance(method, str) else name_of(method)
    chosen = make(method, **(settings or {})) if isinstance(method, str) else method
    if not isinstance(method, str) and settings:
        raise SearchError(
            f"Settings {sorted(settings)} were given beside a ready method {name!r}; put them into the method."
        )
    for what, value, low in (("runs", runs, 1), ("budget", budget, 1), ("seed", seed, 0), ("first_run", first_run, 0)):
        _whole(what, value, low)
    if stagnation is not None:
        _whole("stagnation", stagnation, 1)
    if target is not None and math.isnan(target):
        raise SearchError("The target cost is not a number; give a finite cost or none.")
    _check_objective(objective)
    identity = _identity(name, chosen, objective, runs, first_run, budget, seed, target, stagnation)
    if resume is not None and resume.identity != identity:
        raise SearchError(
            f"The checkpoint belongs to another search ({resume.identity}), not to {identity}; start the search anew."
        )
    plan = Plan(
        objective, name, identity, runs, first_run, budget, seed, target, stagnation, progress, checkpoint, resume, stop
    )
    extra: dict[str, Any] = {}
    if hasattr(chosen, "choose"):
        chosen, reason = chosen.choose(objective, budget)
        extra = {"reason": reason}
    check_needs(name, chosen, objective)
    if hasattr(chosen, "run"):
        return run_host(plan, chosen, extra)  # pyrefly: ignore[bad-argument-type]
    return run_population(plan, chosen, extra)  # pyrefly: ignore[bad-argument-type]


def _whole(what: str, value: Any, low: int) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < low or value >= 2**31:
        raise SearchError(f"{what} is {value!r}; give a whole number of at least {low} and below 2147483648.")


def _check_objective(objective: Objective) -> None:
    d = objective.dimension
    if d < 1:
        raise SearchError("There is nothing to search: the problem has no free parameter; free at least one.")
    if objective.start is None:
        return
    start = np.asarray(objective.start)
    if start.ndim != 2 or start.shape[1] != d or not np.all(np.isfinite(start)):
        raise SearchError(f"Warm starts have shape {start.shape}; give finite cube points of shape (k, {d}).")


def check_needs(name: str, method: Population | Host, objective: Objective) -> None:
    """Raise SearchError when the method needs what the objective does not offer."""
    needs = method.needs
    if needs.gradient and objective.value_and_gradient is None:
        raise SearchError(
            f"Method {name!r} needs a gradient, but the problem has none; choose 'cmaes', 'pso' or 'auto'."
        )
    if needs.residuals and objective.residuals_and_jacobian is None:
        raise SearchError(
            f"Method {name!r} needs residuals, but the problem has none; choose 'lbfgsb', 'cmaes' or 'auto'."
        )
    if needs.raw_box and (objective.lower is None or objective.upper is None):
        raise SearchError(
            f"Method {name!r} reads the bounds in units, but the problem does not give them; choose another method."
        )


def _identity(name: str, method: Any, objective: Objective, *numbers: Any) -> str:
    starts = b"" if objective.start is None else np.ascontiguousarray(objective.start, dtype=float).tobytes()
    digest = hashlib.sha256(starts).hexdigest()[:8]
    labels = ("runs", "first_run", "budget", "seed", "target", "stagnation")
    counts = " ".join(f"{label}={value}" for label, value in zip(labels, numbers, strict=True))
    return f"{name} {plain_settings(method)} dimension={objective.dimension} {counts} starts={digest}"
