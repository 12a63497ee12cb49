"""What one model says about the common samples: its simulation, and what it says of blocks that were left out of its
fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.finish.smoothed_descent import Rows, descend
from plantfit.trust.intervals.covariance import effective_parameters
from plantfit.trust.intervals.linearised import residual_blocks
from plantfit.trust.which_model.common_data import Series, Shared

FOLDS = 5  # blocks of each recording that are left out in turn


@dataclass(frozen=True)
class Candidate:
    """A model with `free` parameters of which the data fix `effective` ones. `simulated` (series of (n,)) by the fit
    to all fitted samples; `left_out` the same by fits that had not seen the sample's block, NaN elsewhere, None
    where no such fit was needed. `kind` "model" or "linear" (a baseline without physics). `determined` (how many, of
    how many), None where not asked for."""

    name: str
    free: int
    effective: float
    simulated: tuple[np.ndarray, ...]
    left_out: tuple[np.ndarray, ...] | None = None
    kind: Literal["model", "linear"] = "model"
    determined: tuple[int, int] | None = None
    sentence: str = ""


def folds(series: Sequence[Series]) -> list[tuple[np.ndarray, ...]]:
    """Fifths of the fitted samples of every recording, one after the other: for each fold a mask (n,) of every
    series."""
    made = [tuple(np.zeros(len(s.t), dtype=bool) for s in series) for _ in range(FOLDS)]
    for name in dict.fromkeys(s.recording for s in series):
        own = [k for k, s in enumerate(series) if s.recording == name]
        used = np.flatnonzero(np.any([series[k].fitted for k in own], axis=0))
        for fold, part in zip(made, np.array_split(used, FOLDS), strict=True):
            for k in own if len(part) else ():
                fold[k][part[0] : part[-1] + 1] = series[k].fitted[part[0] : part[-1] + 1]
    return [f for f in made if any(m.any() for m in f)]


def candidate(name: str, problem: Problem, z: np.ndarray, shared: Shared, left_out: bool) -> Candidate:
    """The candidate of a problem at its answer z (d,); with `left_out` also fitted without each fold, from the
    answer."""
    simulated = _simulated(name, problem, z, shared)
    without = _left_out(name, problem, z, shared) if left_out else None
    return Candidate(name, problem.space.dimension, effective_count(problem, z), simulated, without)


def effective_count(problem: Problem, z: np.ndarray) -> float:
    """Effective number of free parameters at z (d,)."""
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    variance = max(float(np.mean(residuals**2)), 1e-300)
    smoothing = np.zeros((len(z), len(z))) if problem.smoothing is None else problem.smoothing.matrix
    return float(np.sum(effective_parameters(jacobian, residual_blocks(problem), smoothing, variance)))


def _simulated(name: str, problem: Problem, z: np.ndarray, shared: Shared) -> tuple[np.ndarray, ...]:
    values = np.asarray(problem.space.physical(z))
    made = {n: problem.predict(values, n) for n in problem.experiments}
    found = []
    for s in shared.series:
        factor, offset = shared.factors[name][s.output]
        found.append(np.asarray(made[shared.recordings[name][s.recording]][s.output]) * factor + offset)
    return tuple(found)


def _left_out(name: str, problem: Problem, z: np.ndarray, shared: Shared) -> tuple[np.ndarray, ...]:
    """Every fitted sample as predicted by the fit without its fold."""
    rows, found = Rows(problem), tuple(np.full(len(s.t), np.nan) for s in shared.series)
    for fold in folds(shared.series):
        keep = _kept(name, problem, shared, fold)
        again = _simulated(name, problem, descend(rows, problem.smoothing, z, keep), shared)
        for to, values, mask in zip(found, again, fold, strict=True):
            to[mask] = values[mask]
    return found


def _kept(name: str, problem: Problem, shared: Shared, fold: tuple[np.ndarray, ...]) -> np.ndarray:
    """Residuals (m,) bool of the problem that are not in the fold."""
    hidden = {
        (shared.recordings[name][s.recording], s.output): mask for s, mask in zip(shared.series, fold, strict=True)
    }
    index = problem.data["index"]
    return np.concatenate([~hidden[r, o][index[r][o]] for r in problem.data["drive"] for o in problem.outputs])
