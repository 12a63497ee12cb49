"""How often 95 % intervals hold the truth, over records of a virtual rig: side by side, each record with values of
its own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from plantfit.fitting import Answer, fit
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.optimize import minimise
from plantfit.problem import Experiment, Problem
from plantfit.space import Parameter
from plantfit.spec import load
from plantfit.study.objective import objective_of
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.stated_errors.parameter_uncertainty import propagate
from plantfit.trust.stated_errors.shared_error import SharedError

TOGETHER = 25  # records of one problem: all are simulated at once, and no dense matrix grows large


def scores(
    model: Model | LinearModel,
    experiment: Callable[[int], Experiment],
    truth: Mapping[str, float],
    seeds: Sequence[int],
    parameters: Mapping[str, Parameter] | None = None,
) -> dict[str, np.ndarray]:
    """(value - truth) / standard error of every parameter in `truth`, (seeds,) each.

    The first record is fitted by a whole search over the box, the others from where that one ended, with the weights
    that it found.
    """
    return _scores(
        fit(Problem(model, experiment(seeds[0]), parameters)), experiment, truth, seeds, parameters or {}, ()
    )


def study_scores(
    study: Callable[[int], Path], truth: Mapping[str, float], seeds: Sequence[int]
) -> dict[str, np.ndarray]:
    """The same of study files of one recording, with the combined standard uncertainty where a file states errors of
    its instruments."""
    first = load(study(seeds[0]))
    answer = fit(first.problem, budget=first.plan.budget, seed=first.plan.seed)

    def experiment(seed: int) -> Experiment:
        return next(iter(load(study(seed)).problem.experiments.values()))

    return _scores(answer, experiment, truth, seeds, first.problem.space.parameters, first.errors)


def _scores(
    first: Answer,
    experiment: Callable[[int], Experiment],
    truth: Mapping[str, float],
    seeds: Sequence[int],
    parameters: Mapping[str, Parameter],
    errors: Sequence[SharedError],
) -> dict[str, np.ndarray]:
    own = {n: replace(parameters.get(n, Parameter()), per_recording=True, start=v) for n, v in first.values.items()}
    found: dict[str, list[float]] = {n: [] for n in truth}
    for part in np.array_split(np.array(seeds), max(1, round(len(seeds) / TOGETHER))):
        records = {f"seed {s}": experiment(int(s)) for s in part}
        problem = Problem(first.problem.model, records, own, scales=first.problem.scales)
        problem = problem.with_simulator(first.problem.predictor.stepping())
        start = problem.space.start
        assert start is not None
        objective, budget = objective_of(problem, start[None, :]), int(200 * problem.jacobian_charge)
        z = minimise(objective, "least_squares", budget=budget, settings={"agree": 1})[0].x
        local = linearise(problem, z)
        error = propagate(problem, z, errors).combined if errors else local.standard_error
        for at, c in enumerate(problem.space.coordinates):
            if c.parameter in found:
                found[c.parameter].append((local.values[at] - truth[c.parameter]) / error[at])
    return {n: np.array(z) for n, z in found.items()}


def held(z: np.ndarray) -> float:
    """Share of the 95 % intervals that hold the truth."""
    return float(np.mean(np.abs(z) <= 1.96))
