"""How much the signals of a fitted plant move, by which effects inside it are scaled."""

from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Drive


@dataclass(frozen=True)
class Size:
    """Of a signal over all recordings: its `spread` (rms about zero) and that of its `rate`, both the largest of any
    recording; its `mean`, and its `deviation` about a round number near that, the `reference`."""

    spread: float
    rate: float
    reference: float
    deviation: float


def sizes_of(problem: Problem, z: np.ndarray) -> dict[str, Size]:
    """Of every state at the cube point z (d,), every input and time "t"."""
    assert isinstance(problem.model, Model)
    values = np.asarray(problem.space.physical(z))
    paths: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for name, e in problem.experiments.items():
        t = e.recording.t
        paths.setdefault("t", []).append((t, t))
        for u in problem.model.inputs:
            paths.setdefault(u, []).append((t, np.asarray(e.recording[u], dtype=float)))
        drive = problem.whole_drives[name]
        if not isinstance(drive, Drive):
            continue
        found = problem.compiled["trajectories"](problem.space.tree(values, name), drive)
        for s in problem.model.states:
            x = np.asarray(found[s], dtype=float)[: len(t)]
            paths.setdefault(s, []).append((t, np.broadcast_to(x, t.shape) if x.ndim == 0 else x))
    return {s: _size(own, s == "t") for s, own in paths.items()}


def _size(paths: list[tuple[np.ndarray, np.ndarray]], time: bool) -> Size:
    spread = rate = 0.0
    for t, x in paths:
        size = max(float(np.sqrt(np.mean(x**2))), 1e-9)
        spread = max(spread, size)
        rate = max(
            rate, float(np.sqrt(np.mean(np.gradient(x, t[: len(x)]) ** 2))), size / max(float(np.ptp(t)), 1e-300)
        )
    every = np.concatenate([x for _, x in paths])
    every = every[np.isfinite(every)]
    middle = float(np.min(every) if time else np.mean(every)) if len(every) else 0.0
    deviation = max(float(np.std(every)) if len(every) else 0.0, 1e-9 * spread)
    reference = round_number(middle, deviation)
    return Size(
        spread,
        rate,
        reference,
        max(float(np.sqrt(np.mean((every - reference) ** 2))) if len(every) else 0.0, deviation),
    )


def round_number(value: float, deviation: float) -> float:
    """The multiple of 1, 10, 0.1, ... next to a value, whose steps are at most the deviation."""
    step = 10.0 ** np.floor(np.log10(deviation))
    return float(f"{round(value / step) * step:.12g}")
