"""Estimates, levels of noise and what filters say of themselves, as the records of `plantfit estimate`."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.filters.beliefs import FilterRun
from plantfit.estimate.filters.maximum_likelihood import MaximumLikelihood
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.methods.agreement import Estimated
from plantfit.estimate.methods.filtered import FILTERS, innovation_size
from plantfit.estimate.methods.over_records import Runs
from plantfit.findings.results.estimated import (
    EstimatedParameter,
    EstimateOfMethod,
    FilterOfEstimate,
    InnovationSize,
    NoiseLevel,
)
from plantfit.problem.correlated.limits import RARE
from plantfit.problem.problem import GENERALISED as GENERALISED
from plantfit.problem.problem import LEAST_SQUARES as LEAST_SQUARES
from plantfit.problem.problem import Problem

LIKELIHOOD = "maximum likelihood"


def parameter_estimates(
    problem: Problem, estimates: Mapping[str, Estimated], truth: Mapping[str, float], leaning: Sequence[str]
) -> list[EstimatedParameter]:
    """Each parameter by every method; `leaning` are those that the likelihood holds at a bound."""
    rows = []
    for c in problem.space.coordinates:
        own = {}
        for method, (estimate, interval) in estimates.items():
            if c.name in estimate.names:
                i = estimate.names.index(c.name)
                error = float(estimate.standard_error[i])
                low, high = interval[c.name]
                own[method] = EstimateOfMethod(
                    value=float(estimate.values[i]), standard_error=error if error > 0 else None, low=low, high=high,
                    at_bound=method == LIKELIHOOD and c.name in leaning,
                )  # fmt: skip
        rows.append(EstimatedParameter(name=c.name, unit=c.unit, truth=truth.get(c.name), estimates=own))
    return rows


def noise_levels(
    problem: Problem, noise: Noise, found: MaximumLikelihood | None, made: frozenset[str]
) -> list[NoiseLevel]:
    """Levels in force; `made` are those that were proposed."""
    units_of, rows = noise.parameters(problem.model), []  # pyrefly: ignore[bad-argument-type]
    sides: dict[Literal["process", "measurement"], Mapping[str, Any]] = {
        "process": noise.process,
        "measurement": noise.measurement,
    }
    for kind, levels in sides.items():
        for name, value in levels.items():
            key = f"{kind} {name}"
            free = found is not None and key in found.interval
            leaning = free and key in found.at_bound  # pyrefly: ignore[missing-attribute]
            low, high = found.interval[key] if free and not leaning else (None, None)  # pyrefly: ignore[missing-attribute]
            how = "at a bound" if leaning else "found" if free else "left out" if key in made else "given"
            rows.append(
                NoiseLevel(
                    kind=kind,
                    name=name,
                    unit=_unit(units_of[key].unit),
                    value=float(value),
                    low=low,
                    high=high,
                    how=how,
                )
            )
    return rows


def _unit(unit: str | None) -> str | None:
    """A/s^0.5 in place of (A)/s^0.5."""
    return unit if unit is None else re.sub(r"^\((\w+)\)", r"\1", unit)


def filter_findings(method: str, runs: Runs) -> FilterOfEstimate:
    """What a filter says of its innovations."""
    every, test = list(runs.runs.values()), innovation_size(runs)
    size = InnovationSize(
        mean=test.mean, low=test.low, high=test.high, p=test.p_value, consistent=test.consistent, sentence=test.sentence
    )  # fmt: skip
    likelihood = float(sum(r.log_likelihood for r in every))
    return FilterOfEstimate(
        method=FILTERS[method], nis=size, memory=innovation_memory(every), chance=memory_by_chance(every),
        log_likelihood=likelihood,
    )  # fmt: skip


def memory_by_chance(runs: Sequence[FilterRun]) -> dict[str, float | None]:
    """How large `innovation_memory` is by chance in 1 % of the recordings with white innovations, by output."""
    found: dict[str, float | None] = {}
    for i, name in enumerate(runs[0].plant.model.outputs):
        count = sum(int(np.isfinite(r.y[:, i]).sum()) for r in runs)
        found[name] = RARE / np.sqrt(count) if count else None
    return found


def innovation_memory(runs: Sequence[FilterRun]) -> dict[str, float | None]:
    """Correlation of neighbouring whitened innovations, by output; 0 where there are too few."""
    found: dict[str, float | None] = {}
    for i, name in enumerate(runs[0].plant.model.outputs):
        pairs, power, count = 0.0, 0.0, 0
        for r in runs:
            seen = np.isfinite(r.y[:, i])
            white = r.told["white"][r.rank, i][seen]
            pairs, power, count = (
                pairs + float(white[1:] @ white[:-1]),
                power + float(white @ white),
                count + len(white),
            )
        found[name] = pairs / power if power > 0 and count > 10 else 0.0
    return found
