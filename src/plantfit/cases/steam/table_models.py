"""Models of the steam chamber's tables: constants, tables of each opening, tables that openings share."""

from collections.abc import Mapping

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.steam.problems import dynamic_problem, static_problem, steps_from_rest, tables_from_static
from plantfit.models.library.steam_chamber import steam_chamber
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.space import Parameter
from plantfit.trust.finish.smoothed_descent import Rows, descend
from plantfit.trust.finish.smoothing_strength import by_reml
from plantfit.trust.validate.left_out import left_out_recordings
from plantfit.trust.validate.model_comparison import ModelComparison, by_criteria

TABLES = ("k", "A1", "A2")
PRESSURES = {"from": 0, "to": 20, "count": 6}  # bar, of the shared surface
OPENINGS = (10.0, 20.0, 30.0, 50.0, 70.0, 100.0)  # %, of the shared surface: closer where the gain changes fast
Answer = tuple[Problem, np.ndarray]


def smoothed_problem(recordings: Mapping[str, Recording], smooth: float | str = "reml") -> Problem:
    """The dynamic task with smoothed tables."""
    own = {n: Parameter(per_recording=True, smooth=smooth) for n in TABLES} | {"Td": Parameter(per_recording=True)}
    return Problem(steam_chamber(), steps_from_rest(recordings), own, substeps=1, name="smoothed")


def shared_problem(recordings: Mapping[str, Recording], *, surface: bool, smooth: float | str | None = None) -> Problem:
    """One set of tables for all openings, over the pressure or (`surface`) over pressure and opening; Td of each
    opening.

    Searched and smoothed by logarithms: over the openings the gain changes sixfold.
    """
    shared = {n: Parameter(scale="log", smooth=smooth) for n in TABLES} | {"Td": Parameter(per_recording=True)}
    model = steam_chamber(PRESSURES, list(OPENINGS)) if surface else steam_chamber()
    return Problem(model, steps_from_rest(recordings), shared, substeps=1, name="surface" if surface else "shared")


def answers(recordings: Mapping[str, Recording]) -> dict[str, Answer]:
    """Every model at its answer, by local searches from the constants of the static task, which start as the paper
    does."""
    static = static_problem(recordings)
    assert static.space.start is not None
    z = descend(Rows(static), None, static.space.start)
    constants = dict(zip(static.space.names, np.asarray(static.space.physical(z)).tolist(), strict=True))
    own, smoothed = dynamic_problem(recordings), smoothed_problem(recordings)
    start = tables_from_static(own, constants)
    found: dict[str, Answer] = {
        "constants of each opening": (static, z),
        "tables of each opening": (own, descend(Rows(own), None, start)),
    }
    chosen = by_reml(smoothed, start)
    found["tables of each opening, smoothed"] = chosen.problem, chosen.z
    shared = shared_problem(recordings, surface=False)
    found["tables over pressure, shared"] = shared, descend(Rows(shared), None, _shared_start(shared, constants))
    surface = shared_problem(recordings, surface=True, smooth="reml")
    chosen = by_reml(surface, _shared_start(surface, constants))
    found["surface over pressure and opening, smoothed"] = chosen.problem, chosen.z
    return found


def compared(found: Mapping[str, Answer]) -> tuple[ModelComparison, dict[str, dict[str, float]]]:
    """The models by their criteria, and the error (bar) on each opening that its fit had not seen, for shared
    tables."""
    blind = {n: left_out_recordings(p, z, _openings(p)) for n, (p, z) in found.items() if p.separable is None}
    total = {n: float(np.sqrt(np.mean(np.square(list(errors.values()))))) for n, errors in blind.items()}
    return by_criteria(found, total), blind


def opening_of(name: str) -> float:
    """40.0 of "opening40"."""
    return float(name.removeprefix("opening"))


def _openings(problem: Problem) -> dict[str, float]:
    return {n: opening_of(n) for n in problem.data["drive"]}


def _shared_start(problem: Problem, constants: Mapping[str, float]) -> np.ndarray:
    """A cube point (d,) from the constants of the openings: between them over a surface, their median over pressure
    alone."""
    openings, values = _openings(problem), []
    for c in problem.space.coordinates:
        known = [constants[f"{c.parameter}[{n}]"] for n in openings]
        if c.recording is not None:
            values.append(constants[c.name])
        elif len(c.index) == 2:
            values.append(float(np.interp(OPENINGS[c.index[1]], list(openings.values()), known)))
        else:
            values.append(float(np.median(known)))
    return np.clip(problem.space.cube(values), 0.001, 0.999)
