"""The part of the findings record on recordings that disagree, and the parameters' rows that allow for it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings import Heterogeneity
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.trust.heterogeneity.agreement import compared
from plantfit.trust.heterogeneity.refitted import of_all, refitted, work
from plantfit.trust.heterogeneity.widened import Row, widened
from plantfit.trust.intervals.first_values import first_value_effects
from plantfit.trust.intervals.linearised import Local, residual_blocks

TIMES, FLOOR = 1.0, 1000.0  # of the search's evaluations, and what is always allowed
ROUNDS = 4  # of steps that a refit takes at least


def heterogeneity_findings(
    problem: Problem, z: np.ndarray, local: Local, rows: Sequence[Row], spent: float
) -> tuple[list[Row], Heterogeneity | None]:
    """The rows at the answer z (d,), wider where recordings disagree, and the section "heterogeneity".

    The section is None where there is nothing to test: one recording, no parameter that recordings share, no linearised
    problem (tables, over 60 coordinates). The refits take at most the evaluations that the search `spent`, or 1000;
    with too few nothing is tested.
    """
    rows = [{**row, "by_noise": None, "scatter": None} for row in rows]
    shared = any(c.recording is None for c in problem.space.coordinates)
    names, allowed = list(problem.data["drive"]), max(TIMES * spent, FLOOR)
    if len(names) < 2 or not shared or local.linear is None:
        return rows, None
    if ROUNDS * work(problem, len(names)) > allowed:
        return rows, Heterogeneity.model_validate(
            {**_EMPTY, "state": "left", "allowed": allowed, "recordings": [{"name": n} for n in names]}
        )
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    begins = first_value_effects(problem, z, residual_blocks(problem))
    each, taken = refitted(problem, z, residuals, jacobian, begins, allowed)
    record = compared(problem, of_all(problem, local, rows, residuals), each)
    kept = {k: v for k, v in record.items() if k not in ("name", "verdict")}
    section = Heterogeneity.model_validate(
        {**_EMPTY, **kept, "state": "tested", "evaluations": taken, "allowed": allowed}
    )
    return widened(problem, residuals, jacobian, local, rows, record), section


def withdrawn(rows: Sequence[Row]) -> list[str]:
    """Parameters that are determined by the noise of the recordings, and not when these disagree."""
    return [
        r["name"]
        for r in rows
        if r["by_noise"] and r["by_noise"]["status"] == "determined" and r["status"] != "determined"
    ]


_EMPTY: dict[str, Any] = {
    "state": "", "evaluations": 0.0, "agree": None, "level": None, "unit": None, "recordings": [], "parameters": [],
    "together": None,
    "apart": [], "either": [],
}  # fmt: skip
