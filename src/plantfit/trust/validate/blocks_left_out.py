"""One record cut into blocks, each left out of a fit in turn and predicted: how a structure, such as an order, is
chosen."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError
from plantfit.models.model import Model
from plantfit.optimize import minimise
from plantfit.problem.parameters import space_of
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.study.objective import objective_of
from plantfit.trust.validate.cross_validation import Choice, choose

BUDGET = 1000  # Jacobians of one block's search at most


@dataclass(frozen=True)
class Structure:
    """A candidate: a model and what a study changes of its declared parameters."""

    model: Model
    parameters: Mapping[str, Any]


@dataclass(frozen=True)
class StructureChoice:
    """`choice` by the mean RMSE over the blocks left out, `scores` (blocks,) of each candidate; `simplest`: the
    first candidate in the order given whose mean lies at most one standard error of its difference above the best's
    (Breiman, Friedman, Olshen and Stone, Classification and Regression Trees, 1984, section 3.4.3)."""

    choice: Choice
    scores: Mapping[str, np.ndarray]
    simplest: str


def blocks_left_out(
    structure: Structure, recording: Recording, blocks: int = 5, substeps: int | None = None, seed: int = 0
) -> np.ndarray:
    """RMSE (blocks,) of the model's one output on each block, fitted to all the others, in the output's unit.

    The model runs through the whole record every time; a block left out is only not compared, so that no state is lost.
    All fits share one compiled program, least squares from several starts. Raises RecordingError for fewer than two
    blocks, several outputs, and a block or a rest without a measured sample.
    """
    output = _one_output(structure.model)
    places = np.array_split(np.arange(len(recording)), blocks) if blocks > 1 else []
    if len(places) < 2:
        raise RecordingError(f"blocks_left_out: blocks is {blocks!r}; give 2 or more.")
    measured = recording[output]
    without = {}
    for k, place in enumerate(places):
        kept = measured.copy()
        kept[place] = np.nan
        if not (np.any(np.isfinite(kept)) and np.any(np.isfinite(measured[place]))):
            raise RecordingError(
                f"blocks_left_out: block {k + 1} of {blocks} or the rest "
                f"has no measured sample of {output!r}; use fewer blocks."
            )
        name = f"without_{k + 1}"
        unit = recording.signals[output].unit
        without[name] = Recording(recording.t, {**recording.signals, output: Signal(kept, unit)}, name)
    problem = Problem(structure.model, without, _apart(structure), substeps=substeps)
    budget = int(BUDGET * problem.jacobian_charge)
    found = minimise(objective_of(problem), "auto", budget=budget, seed=seed)[0]
    values = np.asarray(problem.space.physical(found.x))
    errors = [(problem.predict(values, n)[output] - measured)[place] for n, place in zip(without, places, strict=True)]
    return np.array([np.sqrt(np.nanmean(e**2)) for e in errors])


def choose_structure(
    candidates: Mapping[str, Structure],
    recording: Recording,
    blocks: int = 5,
    substeps: int | None = None,
    seed: int = 0,
) -> StructureChoice:
    """The structure that predicts blocks left out of its fit best; give `candidates` from simple to rich.

    An order, a friction law, or whether a dead time is there: whatever makes another model. See `blocks_left_out`.
    """
    scores = {name: blocks_left_out(c, recording, blocks, substeps, seed) for name, c in candidates.items()}
    choice = choose({n: s.tolist() for n, s in scores.items()})
    close = [n for n in candidates if n == choice.best or choice.gains[n][0] <= choice.gains[n][1]]
    return StructureChoice(choice, scores, close[0])


def _one_output(model: Model) -> str:
    if len(model.outputs) != 1:
        raise RecordingError(
            f"blocks_left_out: model {model.name!r} has the outputs {list(model.outputs)}; give a model with one."
        )
    return next(iter(model.outputs))


def _apart(structure: Structure) -> dict[str, Any]:
    """The free parameters with a value of its own for every block left out."""
    own = space_of(structure.model.parameters, structure.parameters, ("block",)).parameters
    return {n: replace(p, per_recording=p.value is None and p.tied is None) for n, p in own.items()}
