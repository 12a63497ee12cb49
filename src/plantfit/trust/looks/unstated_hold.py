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
LIKELY = 2.0  # standard errors by which the held input fits better, from which on straight lines are not spoken of


def hold_looks(problem: Problem, z: np.ndarray, rows: Sequence[Row]) -> list[Look]:
    """One for each input whose hold is not stated, so that it is held, where straight lines between its samples move a
    dead time out of its interval and fit as well or better.

    `z` (d,) is the answer, `rows` its parameters. An input that stays level and jumps is held for sure.
    """
    model = problem.model
    if not isinstance(model, Model) or problem.smoothing is not None:
        return []
    late = {
        u: [
            row
            for row in rows
            if any(d.input == u and row["name"].partition("[")[0] == d.parameter for d in model.delays)
            and row["status"] in ("determined", "weak")
            and None not in (row["low"], row["high"])
        ]
        for u in model.inputs
        if u not in problem.holds_stated and _moves(problem, u)
    }
    if not any(late.values()):
        return []
    z = np.asarray(z, dtype=float)
    jacobian = residuals_and_jacobian(problem, z)[1]
    looks = (_look(problem, z, jacobian, u, own) for u, own in late.items() if own)
    return [look for look in looks if look is not None]


def _moves(problem: Problem, u: str) -> bool:
    """Whether an input changes from sample to sample, most of the time."""
    steps = np.concatenate([np.diff(e.recording[u]) for e in problem.experiments.values() if np.any(e.mask("fit"))])
    return len(steps) > 0 and float(np.mean(steps == 0.0)) < LEVEL


def _look(problem: Problem, z: np.ndarray, jacobian: np.ndarray, u: str, late: Sequence[Row]) -> Look | None:
    """Of the dead times `late` of the input the one that its hold moves most, in widths of its interval."""
    from plantfit.problem.measure.hold_check import beside_linear  # a check before the fit needs nothing of scipy

    fit, at = beside_linear(problem, z, jacobian, u)
    straight = dict(zip(problem.space.names, problem.space.physical(at).tolist(), strict=True))

    def moved(row: Row) -> float:
        return abs(straight[row["name"]] - row["value"]) / max(row["high"] - row["low"], 1e-300)

    row = max(late, key=moved)
    name, held, other = row["name"], row["value"], straight[row["name"]]
    if row["low"] <= other <= row["high"] or fit.standard_errors < -LIKELY:
        return None
    unit = f" {row['unit']}" if row["unit"] else ""
    text = (
        f"The study does not say how {u} goes on between its samples: {name} is {held:.4g}{unit} if it is held until "
        f"the next one, {other:.4g}{unit} if it goes straight to it."
    )
    first = next(iter(problem.experiments))
    t = problem.experiments[first].recording.t
    figures: dict[str, int | float | None] = {
        "previous": held, "linear": other, "standard_errors": fit.standard_errors, "power": fit.power
    }  # fmt: skip
    write = "" if fit.better is None else f'hold = {{ {u} = "linear" }}'
    return Look("hold", "warning", first, u, text, float(t[0]), float(t[-1]), write, figures, other=name)


__all__ = ["hold_looks"]
