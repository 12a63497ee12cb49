"""Intervals that allow for the steps in which inputs were read.

A speed made of an encoder's counts, or a voltage of a coarse converter, is the plant's input and an error of less than a step. The model is
driven by both, so that this error is carried through the plant and moves its parameters; residuals hardly show it. How much it moves them
is told by other readings of the same motion: the input as a smooth curve, read in the same steps that lie elsewhere, 16 times over a step
(`recording/signals/unrounded.py`). The squares of the moves of the least-squares answer, to first order, are the variance that steps add.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from plantfit.findings.parameters import Determined
from plantfit.models.model import Model
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look
from plantfit.recording.looks.rounded import rounded_step
from plantfit.recording.signals.unrounded import reread
from plantfit.trust.intervals.linearised import Local, named_blocks
from plantfit.trust.intervals.parameter_rows import judged
from plantfit.trust.intervals.ranges import Range

NORMAL = 1.959963984540054
PLACES = 16  # of the steps, at which readings are made
NOTICED = 1.05  # times a standard error from which on steps are allowed for
TOLD = 1.25  # times it from which on they are spoken of
RCOND = 1e-12  # of the largest singular value: directions below are open

Row = dict[str, Any]


@dataclass(frozen=True)
class InputSteps:
    """Steps of an input in one recording. `size` is in the model's unit, times seconds where the input is a speed made of counts."""

    recording: str
    signal: str
    kind: Literal["counted", "rounded"]
    size: float
    told: bool  # by the study, not seen in the readings


def input_steps(problem: Problem) -> list[InputSteps]:
    """The inputs that were read in steps: those of which the recordings say so, and those that look rounded."""
    model = problem.model
    if not isinstance(model, Model) or not problem.in_time:
        return []
    found = []
    for name, e in problem.experiments.items():
        for u in model.inputs if not e.steady else ():
            size = e.counted.get(u, e.rounded.get(u))
            if size is not None:
                found += [InputSteps(name, u, "counted" if u in e.counted else "rounded", size, True)] if size > 0 else []
            elif (seen := rounded_step(e.recording[u])) is not None:
                found.append(InputSteps(name, u, "rounded", seen, False))
    return found


def allowing_for_steps(problem: Problem, z: np.ndarray, local: Local, rows: Sequence[Row]) -> tuple[list[Row], list[Look]]:
    """The rows of the parameters at the answer z (d,), wider where steps of inputs move them, and a look at every such input.

    "by_steps" of a row is the standard uncertainty by the steps alone. Where they widen no interval by a twentieth, nothing changes and no
    row has one; where none by a quarter, there are no looks.
    """
    plain = [{**row, "by_steps": None} for row in rows]
    steps = input_steps(problem)
    places = {n: i for i, n in enumerate(problem.space.names)}
    if not steps or not any(_bounded(row) for row in rows):
        return plain, []
    moved = moves(problem, z, local, steps)
    wider = [_wider(row, problem, local, places[row["name"]], moved) if row["name"] in places else row for row in plain]
    times = max(w["standard_error"] / row["standard_error"] for w, row in zip(wider, rows, strict=True) if _bounded(row))
    return wider if times > NOTICED else plain, step_looks(problem, steps) if times > TOLD else []


def claimed(determined: Determined | None, rows: Sequence[Row]) -> Determined | None:
    """The section "determined" without what it says, by the noise alone, of parameters that steps move more than the noise does."""
    moved = {row["name"] for row in rows if row["by_steps"] and 2.0 * row["by_steps"] ** 2 > row["standard_error"] ** 2}
    if determined is None or not moved:
        return determined
    kept = [c for c in determined.combinations if not moved & set(c.weights)]
    count = determined.count - len(determined.combinations) + len(kept)
    only_if = {n: other for n, other in determined.only_if.items() if n not in moved and other.known not in moved}
    return determined.model_copy(update={"combinations": kept, "count": count, "directions": count, "only_if": only_if})


def moves(problem: Problem, z: np.ndarray, local: Local, steps: Sequence[InputSteps]) -> np.ndarray:
    """By how much steps move the values (d,), root mean square, in their units; parameters that a bound holds do not move."""
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    j = np.where([b is None for b in local.at_bound], jacobian / norms, 0.0)
    smoothing = 0.0 if problem.smoothing is None else problem.smoothing.matrix / norms[:, None] / norms[None, :]
    solve = -np.linalg.pinv(j.T @ j + smoothing, rcond=RCOND, hermitian=True) @ j.T / norms[:, None]
    recordings = {n: e.recording for n, e in problem.experiments.items()}
    rows: dict[str, list[slice]] = {}
    for name, _, block in named_blocks(problem):
        rows.setdefault(name, []).append(block.rows)
    squares = np.zeros(len(z))
    for signal in dict.fromkeys(s.signal for s in steps):
        read = {
            s.recording: reread(recordings[s.recording], signal, s.size, PLACES, s.kind == "counted") for s in steps if s.signal == signal
        }
        for k in range(PLACES):
            there = np.asarray(problem.with_recordings(recordings | {n: r[k] for n, r in read.items()}).unsmoothed.residuals(z))
            for own in rows.values():  # each recording errs by itself
                squares += sum(solve[:, at] @ (there[at] - residuals[at]) for at in own) ** 2 / PLACES
    return np.sqrt(squares) * problem.space.slopes(z)


def step_looks(problem: Problem, steps: Sequence[InputSteps]) -> list[Look]:
    """What is to be said of inputs in steps: how many steps there are in their movement, and in a sample."""
    return [_look(problem, s) for s in steps]


def _look(problem: Problem, s: InputSteps) -> Look:
    recording = problem.experiments[s.recording].recording
    values, t = recording[s.signal], recording.t
    own = recording.signals[s.signal].unit
    unit = f" {own}" if own not in (None, "", "1") else ""
    values = values[np.isfinite(values)]
    each = np.abs(values) * float(np.median(np.diff(t))) / s.size if s.kind == "counted" else np.abs(np.diff(values)) / s.size
    whole = float(np.sum(each)) if s.kind == "counted" else float(np.ptp(values)) / s.size
    usual = float(np.median(each[each > 0])) if np.any(each > 0) else 0.0
    ends = float(t[0]), float(t[-1])
    figures: dict[str, int | float | None] = {"step": s.size, "steps": whole, "steps_a_sample": usual}
    if s.kind == "counted":
        text = (
            f"{s.signal} is made of counts: {whole:.0f} of them in {s.recording}, {usual:.3g} a sample while it moves. Where they lie "
            f"moves what hangs on the path by about {100 * np.sqrt(1 / 6) / max(whole, 1.0):.2g} %, and residuals do not show it."
        )
        return Look("counted", "info", s.recording, s.signal, text, *ends, "", figures)
    text = (
        f"{s.signal} was read in steps of {s.size:.4g}{unit}, a share of {1 / max(whole, 1.0):.2g} of its range"
        f"{'' if s.told else ', or so it looks'}. A plant is driven by what was there, not by what was read."
    )
    return Look("rounded", "info", s.recording, s.signal, text, *ends, "" if s.told else f"rounded = {{ {s.signal} = 0 }}", figures)


def _bounded(row: Row) -> bool:
    return bool(row["standard_error"]) and row["status"] in ("determined", "weak") and not row.get("open")


def _wider(row: Row, problem: Problem, local: Local, at: int, moved: np.ndarray) -> Row:
    """The row with a standard error, an interval and a status that hold for what steps add, and what that is."""
    if not _bounded(row) or not np.isfinite(moved[at]):
        return row
    coordinate, by_steps, value = problem.space.coordinates[at], float(moved[at]), row["value"]
    least, most = coordinate.limits
    low = float(max(least, value - np.hypot(value - row["low"], NORMAL * by_steps)))
    high = float(min(most, value + np.hypot(row["high"] - value, NORMAL * by_steps)))
    status = row["status"]
    if status == "determined":
        status = judged(coordinate, value, Range(low, high), local.linear is None or local.linear.sound)
    return {
        **row, "standard_error": float(np.hypot(row["standard_error"], by_steps)), "low": low, "high": high,
        "status": "weak" if status == "flat" else status, "by_steps": by_steps,
    }  # fmt: skip


__all__ = ["InputSteps", "allowing_for_steps", "input_steps", "moves", "step_looks"]
