"""Inputs that were read in steps or with noise: those of which the recordings say so, those that look so, and what is
to be said of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from plantfit.models.model import Model
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look
from plantfit.recording.looks.noisy import reading_noise
from plantfit.recording.looks.rounded import rounded_step

Kind = Literal["counted", "rounded", "noisy"]
HEARD = 0.3  # times the noise of an output, from which on steps are spoken of before a fit


@dataclass(frozen=True)
class Misreading:
    """Steps or noise of an input in one recording. `size` is in the model's unit, times seconds where the input is a
    speed made of counts; of noise the standard deviation."""

    recording: str
    signal: str
    kind: Kind
    size: float
    told: bool  # by the study, not seen in the readings


def misreadings(problem: Problem) -> list[Misreading]:
    """The inputs that were read in steps or with noise: those of which the recordings say so, and those that look so.

    Where noise is seen, it is much of what steps would be taken for, and they are not looked for.
    """
    model = problem.model
    if not isinstance(model, Model) or not problem.in_time:
        return []
    found = []
    for name, e in problem.experiments.items():
        for u in model.inputs if not e.steady else ():
            found += _of_input(name, e, u)
    return found


def _of_input(name: str, e: Experiment, u: str) -> list[Misreading]:
    every: dict[Kind, Mapping[str, float]] = {"counted": e.counted, "rounded": e.rounded, "noisy": e.noisy}
    told = {k: own[u] for k, own in every.items() if u in own}
    found = [Misreading(name, u, k, size, True) for k, size in told.items() if size > 0]
    if not told and (noise := reading_noise(e.recording[u])) is not None:
        return [Misreading(name, u, "noisy", noise, False)]
    if not told.keys() & {"counted", "rounded"} and (seen := rounded_step(e.recording[u])) is not None:
        found.append(Misreading(name, u, "rounded", seen, False))
    return found


def misread(e: Experiment, s: Misreading) -> float:
    """The error (rms) of single readings of an input that is even within its steps."""
    if s.kind == "noisy":
        return s.size
    return (
        s.size / np.sqrt(12.0)
        if s.kind == "rounded"
        else s.size / float(np.median(np.diff(e.recording.t))) / np.sqrt(6.0)
    )


def telling(problem: Problem, steps: Sequence[Misreading]) -> list[Misreading]:
    """Those steps that may move parameters beside the noise of the outputs, as far as it can be told before a fit; all
    that were told.

    A step is an error that stays for as long as a reading does; the plant is taken to follow its input over the range
    of both.
    """
    return [s for s in steps if s.told or s.kind == "counted" or _beside_noise(problem, s) > HEARD]


def _beside_noise(problem: Problem, s: Misreading) -> float:
    """The error of readings at an output, averaged as long as one reading stays, over the noise that is averaged as
    long."""
    e = problem.experiments[s.recording]
    u = e.recording[s.signal]
    u = u[np.isfinite(u)]
    stays = 1.0 if s.kind == "noisy" else len(u) / (1.0 + np.count_nonzero(np.diff(u)))
    error = misread(e, s) * np.sqrt(stays) / max(float(np.ptp(u)), 1e-300)
    found = 0.0
    for y in (e.recording[o] for o in problem.outputs):
        y = y[np.isfinite(y)]
        if len(y) > 2:
            found = max(found, error * float(np.ptp(y)) / max(white_part(y), 1e-300))
    return found


def misreading_looks(problem: Problem, steps: Sequence[Misreading], left: float | None = None) -> list[Look]:
    """What is to be said of inputs in steps: how many steps there are in their movement, and in a sample.

    `left` is the share of the residuals' mean square that the steps may be, None where there are no residuals yet. What
    readings in steps mean is said once.
    """
    first = next((s for s in steps if s.kind == "rounded"), None)
    return [_look(problem, s, left, s is first) for s in steps]


def _look(problem: Problem, s: Misreading, left: float | None, first: bool) -> Look:
    recording = problem.experiments[s.recording].recording
    values, t = recording[s.signal], recording.t
    own = recording.signals[s.signal].unit
    unit = f" {own}" if own not in (None, "", "1") else ""
    values = values[np.isfinite(values)]
    each = (
        np.abs(values) * float(np.median(np.diff(t))) / s.size
        if s.kind == "counted"
        else np.abs(np.diff(values)) / s.size
    )
    whole = float(np.sum(each)) if s.kind == "counted" else float(np.ptp(values)) / s.size
    usual = float(np.median(each[each > 0])) if np.any(each > 0) else 0.0
    figures: dict[str, int | float | None] = {
        "step": s.size,
        "steps": whole,
        "steps_a_sample": usual,
        "told": int(s.told),
        "left": left,
    }
    place = s.recording, s.signal
    ends = float(t[0]), float(t[-1])
    if s.kind == "counted":
        text = (
            f"{s.signal} is made of counts: {whole:.0f} of them in {s.recording}, "
            f"{usual:.3g} a sample while it moves; where they lie moves what hangs "
            f"on the path by about {100 * np.sqrt(1 / 6) / max(whole, 1.0):.2g} %."
        )
        return Look("counted", "info", *place, text, *ends, "", figures)
    seen = "" if s.told else ", or so it looks"
    if s.kind == "noisy":
        text = (
            f"{s.signal} was read with noise of {s.size:.3g}{unit}, {100 / max(whole, 1.0):.2g} % of its range{seen}. "
            "A plant is driven by what was there, not by what was read."
        )
        if not s.told:
            text += f" If the plant got what is recorded, write {as_exact(s.signal)}."
        return Look("noisy", "info", *place, text, *ends, "", figures)
    text = f"{s.signal} was read in steps of {s.size:.4g}{unit}, {100 / max(whole, 1.0):.2g} % of its range{seen}." + (
        " A plant is driven by what was there, not by what was read." if first else ""
    )
    if not s.told:
        text += f" If {s.signal} was commanded and not measured, write {as_commanded(s.signal)}."
    return Look("rounded", "info", *place, text, *ends, "", figures)


def as_commanded(signal: str) -> str:
    """The line of the study file that says that an input was commanded."""
    return f"rounded = {{ {signal} = 0 }}"


def as_exact(signal: str) -> str:
    """The line of the study file that says that an input was read without noise."""
    return f"noisy = {{ {signal} = 0 }}"


__all__ = ["Misreading", "as_commanded", "as_exact", "misread", "misreading_looks", "misreadings", "telling"]
