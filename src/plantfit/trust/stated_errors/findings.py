"""The part of the findings record on stated errors: budgets of readings, and what they add to the interval of every
parameter."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.uncertainty import StatedUncertainty, Uncertainty
from plantfit.problem.measure.long_run import NORMAL
from plantfit.problem.problem import Problem
from plantfit.trust.stated_errors.parameter_uncertainty import (
    ParameterUncertainty,
    coverage_factors,
    propagate,
    propagate_by_monte_carlo,
)
from plantfit.trust.stated_errors.reading_budgets import reading_budgets
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.stated_errors.uncertainty_budget import MANY

Row = Mapping[str, Any]


def uncertainty_findings(
    problem: Problem, z: np.ndarray, rows: Sequence[Row], errors: Sequence[SharedError], draws: int | None, seed: int
) -> tuple[list[dict[str, Any]], Uncertainty | None]:
    """The rows of the parameters, each with "uncertainty", and the section "uncertainty" of the findings.

    Both are None without errors. Linear without `draws`, else by so many refits.
    """
    if not errors:
        return [{**row, "uncertainty": None} for row in rows], None
    found = propagate_by_monte_carlo(problem, z, errors, draws, seed) if draws else propagate(problem, z, errors)
    section = Uncertainty(
        method="monte carlo" if draws else "linear",
        draws=draws or None,
        seed=seed if draws else None,
        budgets=reading_budgets(problem, errors),
    )
    places = {n: i for i, n in enumerate(found.names)}
    stated = [_of_row(row, found, places.get(row["name"]), errors) for row in rows]
    return [{**row, "uncertainty": s and s.plain()} for row, s in zip(rows, stated, strict=True)], section


def _of_row(
    row: Row, found: ParameterUncertainty, at: int | None, errors: Sequence[SharedError]
) -> StatedUncertainty | None:
    """What is uncertain of one parameter; None where it has no standard error, and for held ones of which nothing is
    stated."""
    if at is None:
        return _of_constant(row, [e for e in errors if e.constant == row["name"]])
    if row["standard_error"] is None or not found.combined[at] > 0:
        return None
    degrees = float(found.degrees_of_freedom[at])
    steps, value = row.get("by_steps") or 0.0, float(found.values[at])
    reach = NORMAL * steps
    return StatedUncertainty(
        noise=float(np.hypot(found.random[at], steps)),
        shared=float(found.shared[at]),
        sources={n: float(s[at]) for n, s in found.systematic.items()},
        combined=float(np.hypot(found.combined[at], steps)),
        low=float(value - np.hypot(value - found.low[at], reach)),
        high=float(value + np.hypot(found.high[at] - value, reach)),
        degrees_of_freedom=None if degrees > MANY else degrees,
    )


def _of_constant(row: Row, errors: Sequence[SharedError]) -> StatedUncertainty | None:
    """A held value has the uncertainty that was stated of it."""
    if not errors:
        return None
    parts = {e.source.name: e.source.standard for e in errors}
    shared = float(np.sqrt(sum(s**2 for s in parts.values())))
    few = sum(e.source.standard**4 / e.source.degrees_of_freedom for e in errors)
    degrees = shared**4 / few if few > 0 else np.inf
    reach = float(coverage_factors(np.array([degrees]))[0]) * shared
    return StatedUncertainty(
        noise=0.0,
        shared=shared,
        sources=dict(parts),
        combined=shared,
        low=row["value"] - reach,
        high=row["value"] + reach,
        degrees_of_freedom=None if degrees > MANY else float(degrees),
    )
