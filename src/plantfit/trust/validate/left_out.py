"""Recordings left out of a fit and predicted from the others, on one compiled problem."""

from collections.abc import Mapping

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.problem.problem import Problem
from plantfit.trust.finish.smoothed_descent import Rows, descend


def left_out_recordings(problem: Problem, z: np.ndarray, along: Mapping[str, float] | None = None) -> dict[str, float]:
    """By recording the RMS of its scaled residuals when all others alone were fitted, from the answer z (d,).

    Coordinates of the left-out recording's own are put on the line through its two neighbours by `along`, a number for
    each recording (an opening, a load), also beyond the ends. Entries of shared tables that only the left-out recording
    determines must be held by smoothing, or they would keep what they learned from it. Raises ModelError without
    `along` where it is needed.
    """
    own = {n: [i for i, c in enumerate(problem.space.coordinates) if c.recording == n] for n in problem.data["drive"]}
    if along is None and any(own.values()):
        name = problem.space.coordinates[next(i for places in own.values() for i in places)].parameter
        raise ModelError(
            f"left_out_recordings: {name!r} is per recording; give along = {{recording: number}} to interpolate it."
        )
    if len(own) < 3:
        raise ModelError(f"left_out_recordings: there are {len(own)} recordings; give three or more.")
    rows, found = Rows(problem), {}
    where = _places(problem)
    for name in own:
        keep = np.ones(sum(map(len, where.values())), dtype=bool)
        keep[where[name]] = False
        fitted = descend(rows, problem.smoothing, z, keep)
        if along is not None:
            fitted[own[name]] = _on_line(name, own, along, fitted)
        found[name] = float(np.sqrt(np.mean(rows.residuals(fitted)[where[name]] ** 2)))
    return found


def _places(problem: Problem) -> dict[str, np.ndarray]:
    """Places of each recording's residuals."""
    counts = {n: sum(map(len, outputs.values())) for n, outputs in problem.data["index"].items()}
    return {
        n: e - counts[n] + np.arange(counts[n]) for n, e in zip(counts, np.cumsum(list(counts.values())), strict=True)
    }


def _on_line(name: str, own: Mapping[str, list[int]], along: Mapping[str, float], z: np.ndarray) -> np.ndarray:
    """Own coordinates (q,) from the two other recordings nearest on both sides, or the two nearest at an end."""
    others = sorted((n for n in own if n != name), key=lambda n: along[n])
    k = int(np.clip(np.searchsorted([along[n] for n in others], along[name]), 1, len(others) - 1))
    a, b = others[k - 1], others[k]
    share = (along[name] - along[a]) / (along[b] - along[a])
    return np.clip((1.0 - share) * z[own[a]] + share * z[own[b]], 0.0, 1.0)
