"""Dead times that rest on how an input goes on between its samples, which nobody stated.

An input that is held looks like half a sample of dead time more than one that goes straight from sample to sample. A
free dead time takes that up, so that the residuals of a wrong hold may be as white as those of the right one.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.models.model import Model
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look

Row = Mapping[str, Any]
LEVEL = 0.5  # of the samples that are those before them, from which on an input stays level and jumps
LIKELY = 2.0  # standard errors by which a hold fits better, from which on the other one is not spoken of


def hold_looks(problem: Problem, z: np.ndarray, rows: Sequence[Row]) -> list[Look]:
    """One for each input whose hold is not stated, where the other hold moves a dead time out of its interval and fits
    as well or better. `z` (d,) is the answer, `rows` its parameters. An input that stays level and jumps is held."""
    model = problem.model
    if not isinstance(model, Model) or problem.smoothing is not None:
        return []
    late = {
        d.input: row
        for d in model.delays
        for row in rows
        if row["name"].partition("[")[0] == d.parameter
        and row["status"] in ("determined", "weak")
        and row["low"] is not None
        and row["high"] is not None
    }
    moving = [u for u in late if u not in problem.holds_stated and _moves(problem, u)]
    if not moving:
        return []
    z = np.asarray(z, dtype=float)
    jacobian = residuals_and_jacobian(problem, z)[1]
    return [look for u in moving if (look := _look(problem, z, jacobian, u, late[u])) is not None]


def _moves(problem: Problem, u: str) -> bool:
    """Whether an input changes from sample to sample, most of the time."""
    steps = [np.diff(e.recording[u]) for e in problem.experiments.values() if np.any(e.mask("fit"))]
    return float(np.mean(np.concatenate(steps) == 0.0)) < LEVEL


def _look(problem: Problem, z: np.ndarray, jacobian: np.ndarray, u: str, row: Row) -> Look | None:
    from plantfit.problem.measure.hold_check import beside_other  # a check before the fit needs nothing of scipy

    own = "linear" if u in problem.predictor.stepping().interpolated else "previous"
    fit, at = beside_other(problem, z, jacobian, u)
    other = float(problem.space.physical(at)[problem.space.names.index(row["name"])])
    for_own = -fit.standard_errors if own == "previous" else fit.standard_errors
    if row["low"] <= other <= row["high"] or fit.better == own or for_own > LIKELY:
        return None
    values = {own: row["value"], "linear" if own == "previous" else "previous": other}
    unit = f" {row['unit']}" if row["unit"] else ""
    text = (
        f"The study does not say how {u} goes on between its samples: {row['name']} is "
        f"{values['previous']:.4g}{unit} if it is held until the next one, {values['linear']:.4g}{unit} if it goes "
        "straight to it."
    )
    first = next(iter(problem.experiments))
    t = problem.experiments[first].recording.t
    figures: dict[str, int | float | None] = {**values, "standard_errors": fit.standard_errors, "power": fit.power}
    write = "" if fit.better is None else f'hold = {{ {u} = "{fit.better}" }}'
    return Look("hold", "warning", first, u, text, float(t[0]), float(t[-1]), write, figures, other=row["name"])


__all__ = ["hold_looks"]
