"""How an input goes on between its samples, where nobody stated it: dead times that rest on it, and residuals that
straight lines explain.

An input that is held looks like half a sample of dead time more than one that goes straight from sample to sample. A
free dead time takes that up, so that the residuals of a wrong hold may be as white as those of the right one. Without
one it moves the other parameters, and what it leaves is told as something that the plant lacks.

Of several inputs that go straight the clearest is found first, and the next one where straight lines join its samples
already.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from plantfit.models.model import Model
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look
from plantfit.simulate.steps.grid import Held
from plantfit.trust.verdict.words import some

if TYPE_CHECKING:
    from plantfit.problem.measure.hold_check import Straight

Row = Mapping[str, Any]
LEVEL = 0.5  # of the samples that are those before them, from which on an input stays level and jumps
LIKELY = 2.0  # standard errors by which the held input fits better, from which on straight lines are not spoken of
# what straight lines gain over what they gain if nothing else is wrong; a late clock gains (2 n - 1) times as much by n
# half samples
ALONE = (0.5, 2.0)


def hold_looks(problem: Problem, z: np.ndarray, rows: Sequence[Row], white: bool) -> list[Look]:
    """One for each input whose hold is not stated, so that it is held, where straight lines between its samples move a
    dead time out of its interval and fit as well or better; and, unless residuals are `white`, where they fit better
    by as much as they do if nothing else is wrong. These come first, the clearest ahead of those that were found beside
    it, and all have one line to write, which keeps the holds that are stated.

    `z` (d,) is the answer, `rows` its parameters. An input that stays level and jumps is held for sure.
    """
    model = problem.model
    if not isinstance(model, Model) or problem.smoothing is not None:
        return []
    known = [r for r in rows if r["status"] in ("determined", "weak") and None not in (r["low"], r["high"])]
    late = {
        u: [
            row
            for row in known
            if any(d.input == u and row["name"].partition("[")[0] == d.parameter for d in model.delays)
        ]
        for u in model.inputs
        if u not in problem.holds_stated and _moves(problem, u)
    }
    asked = {u: own for u, own in late.items() if own or not white}
    if not asked:
        return []
    from plantfit.problem.measure.hold_check import beside_linear  # a check before the fit needs nothing of scipy

    now, at = problem, np.asarray(z, dtype=float)
    residuals, jacobian = residuals_and_jacobian(problem, at)
    straight: dict[str, Look] = {}
    told: dict[str, Look] = {}
    while asked:
        beside = {u: beside_linear(now, at, residuals, jacobian, u) for u in asked}
        looks = {u: _look(problem, at, beside[u], list(straight), own, known) for u, own in asked.items()}
        told = {u: look for u, look in looks.items() if look is not None}
        sure = [u for u in told if beside[u].fit.better == Held.LINEAR]
        if not sure:
            break
        clearest = max(sure, key=lambda u: beside[u].fit.standard_errors)
        straight[clearest] = told.pop(clearest)
        _, now, at, residuals = beside[clearest]
        del asked[clearest]
    write = _line(problem, model.inputs, straight)
    return [*(replace(look, write=write) for look in straight.values()), *told.values()]


def _line(problem: Problem, inputs: Iterable[str], straight: Mapping[str, Any]) -> str:
    """The line that holds these inputs as straight lines and those that are stated as they are."""
    linear = {*straight, *problem.predictor.stepping().interpolated}
    named = [u for u in inputs if u in straight or u in problem.holds_stated]
    rows = ", ".join(f'{u} = "{Held.LINEAR if u in linear else Held.PREVIOUS}"' for u in named)
    return f"hold = {{ {rows} }}"


def _moves(problem: Problem, u: str) -> bool:
    """Whether an input changes from sample to sample, most of the time."""
    steps = np.concatenate([np.diff(e.recording[u]) for e in problem.experiments.values() if np.any(e.mask("fit"))])
    return len(steps) > 0 and float(np.mean(steps == 0.0)) < LEVEL


def _look(
    problem: Problem,
    z: np.ndarray,
    beside: "Straight",
    found: Sequence[str],
    late: Sequence[Row],
    known: Sequence[Row],
) -> Look | None:
    """Of the dead times `late` of an input the one that its hold moves most from z (d,), in widths of its interval;
    without any, of the parameters `known`. `found`: inputs that go straight already."""
    fit, u = beside.fit, beside.fit.input
    if not late and not (fit.better == Held.LINEAR and ALONE[0] <= fit.standard_errors / fit.power <= ALONE[1]):
        return None
    held, straight = (
        dict(zip(problem.space.names, problem.space.physical(x).tolist(), strict=True)) for x in (z, beside.at)
    )

    def moved(row: Row) -> float:
        return abs(straight[row["name"]] - held[row["name"]]) / max(row["high"] - row["low"], 1e-300)

    row = max(late or known, key=moved, default=None)
    inside = row is None or (
        row["low"] - row["value"] <= straight[row["name"]] - held[row["name"]] <= row["high"] - row["value"]
    )
    if late and (inside or fit.standard_errors < -LIKELY):
        return None
    figures: dict[str, int | float | None] = {
        "previous": None, "linear": None, "standard_errors": fit.standard_errors, "power": fit.power,
        "explained": 1.0 - fit.cost_linear / fit.cost_previous, "noise": _over_noise(problem, beside.residuals),
    }  # fmt: skip
    text = f"The study does not say how {u} goes on between its samples: "
    text += f"beside those of {some(found)}, " if found else ""
    if row is None or inside:
        name, left = None, "then left" if found else "left"
        text += f"straight lines explain {100 * (figures['explained'] or 0.0):.2g} % of what is {left}."
    else:
        name = row["name"]
        unit = f" {row['unit']}" if row["unit"] else ""
        figures |= {"previous": held[name], "linear": straight[name]}
        text += (
            f"{name} is {held[name]:.4g}{unit} if it is held until the next one, "
            f"{straight[name]:.4g}{unit} if it goes straight to it."
        )
    first = next(iter(problem.experiments))
    t = problem.experiments[first].recording.t
    return Look("hold", "warning", first, u, text, float(t[0]), float(t[-1]), "", figures, other=name)


def _over_noise(problem: Problem, residuals: np.ndarray) -> float | None:
    """The most that residuals (m,) of an output in a recording are, in times of their noise from sample to sample."""
    from plantfit.trust.intervals.linearised import named_blocks  # a check before the fit needs nothing of scipy

    over = [
        float(np.sqrt(np.mean(own**2))) / noise
        for own in (residuals[block.rows] for _, _, block in named_blocks(problem))
        if (noise := white_part(own)) > 0
    ]
    return max(over, default=None)


__all__ = ["hold_looks"]
