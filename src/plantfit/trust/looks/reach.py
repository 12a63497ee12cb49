"""Outputs that the model, anywhere within its bounds, moves ten times more or less than they were recorded, or at
another level: a wrong unit, or bounds that leave the plant out."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from plantfit.errors import PlantfitError
from plantfit.models.model import Model
from plantfit.problem.evaluate.points import residuals, residuals_alone
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look
from plantfit.trust.verdict.words import interval, span, with_unit

POINTS = (24, 240)  # random points of the box, and as many as have to agree before anything is told
FEWEST = 0.5  # of them that can be simulated
FAR, AWAY = 10.0, 3.0  # times the recorded spread that an output moves, and that its level is away
BEGUN = 0.2  # of the samples: a model that runs away has not left what was recorded by then
HEARD = 3.0  # times its noise, from which on an output has a spread of its own
RARE = 0.5  # per cent of the samples at either end that tell nothing of a spread


class _Moved(NamedTuple):
    """Spread, that of the first samples, and the lowest and highest value, in the output's unit."""

    spread: float
    begun: float
    low: float
    high: float


def out_of_reach(problem: Problem, key: int = 0) -> list[Look]:
    """A warning for each fitted output whose recorded values no simulation at random points of the box (numpy's
    generator of `key`) comes near."""
    model = problem.model
    if not isinstance(model, Model) or not problem.space.dimension:
        return []
    drawn = np.random.default_rng(key).uniform(0.02, 0.98, (max(POINTS), problem.space.dimension))
    looks: list[Look] = []
    try:
        for count in POINTS:
            looks = list(_looks(problem, model, drawn[:count]))
            if not looks:
                break
    except PlantfitError:
        return []
    return looks


def _looks(problem: Problem, model: Model, points: np.ndarray) -> Iterator[Look]:
    """What is told of simulations at cube points (k, d)."""
    evaluate = residuals if getattr(model, "smooth", True) else residuals_alone
    found = [r for z in points if np.all(np.isfinite(r := np.asarray(evaluate(problem, z))))]
    if len(found) < FEWEST * len(points):
        return
    where = "recording" if len(problem.experiments) == 1 else "recordings"
    name, e = next(iter(problem.experiments.items()))
    ends = float(e.recording.t[0]), float(e.recording.t[-1])
    for output, parts in _parts(problem, found).items():
        measured = _moved([y for y, _ in parts])
        simulated = [_moved(list(one)) for one in zip(*(p for _, p in parts), strict=True)]
        kind, told = "reach", _of_spread(measured, simulated, model.outputs[output])
        if told is None:
            kind, told = "level", _of_level(measured, simulated, model.outputs[output])
        if told is not None:
            verb, text, figures = told
            text = f"At none of {len(found)} random points of the bounds does the model's {output} {verb}: {text}"
            units = f"units of {output} and of the inputs" if model.inputs else f"unit of {output}"
            text += f" in the {where}. Look at the {units}, and at the bounds."
            yield Look(kind, "warning", name, output, text, *ends, "", figures)


Parts = list[tuple[np.ndarray, list[np.ndarray]]]
"""What was measured, and every simulation of it, for each recording."""


def _parts(problem: Problem, found: list[np.ndarray]) -> dict[str, Parts]:
    """The outputs that move by more than their noise, by residuals (m,) of every simulation."""
    parts: dict[str, Parts] = {}
    heard: set[str] = set()
    start = 0
    for name, output in ((n, o) for n in problem.data["drive"] for o in problem.outputs):
        y, measured = problem.experiments[name].recording[output], problem.data["measured"][name][output]
        if not len(measured):
            continue
        rows, start = slice(start, start + len(measured)), start + len(measured)
        weight = 1.0 if problem.weights is None else np.sqrt(problem.weights.get(name, 1.0))
        unit = problem.scales[output] / weight
        parts.setdefault(output, []).append((measured, [measured + unit * r[rows] for r in found]))
        if float(np.std(measured)) > HEARD * white_part(y):
            heard.add(output)
    return {output: part for output, part in parts.items() if output in heard}


def _moved(signals: list[np.ndarray]) -> _Moved:
    """How an output moves in all recordings together."""
    begun = [v[: max(2, round(BEGUN * len(v)))] for v in signals]
    whole = np.concatenate(signals)
    low, high = np.percentile(whole, (RARE, 100.0 - RARE))
    return _Moved(_spread(signals), _spread(begun), float(low), float(high))


def _spread(signals: list[np.ndarray]) -> float:
    """The standard deviation about the mean of each recording, without the rarest values."""
    kept = [np.clip(v, *np.percentile(v, (RARE, 100.0 - RARE))) for v in signals]
    return float(np.sqrt(np.mean(np.concatenate([(v - v.mean()) ** 2 for v in kept]))))


Told = tuple[str, str, dict[str, int | float | None]]
"""What the model does not do, by which numbers, and these."""


def _of_spread(measured: _Moved, simulated: list[_Moved], unit: str | None) -> Told | None:
    """None where some simulation moves about as much as the recording."""
    spreads = [s.spread for s in simulated]
    less = max(spreads) * FAR < measured.spread
    if not less and not _more(measured, simulated):
        return None
    verb = f"move as {'much' if less else 'little'} as the recorded one"
    text = f"its standard deviation is {span(spreads, unit)} there, and {with_unit(measured.spread, unit)}"
    return verb, text, {"lowest": min(spreads), "highest": max(spreads), "recorded": measured.spread}


def _of_level(measured: _Moved, simulated: list[_Moved], unit: str | None) -> Told | None:
    """None where some simulation comes near a recorded value."""
    low, high = min(s.low for s in simulated), max(s.high for s in simulated)
    largest = max(measured.spread, *(s.spread for s in simulated))
    if max(low - measured.high, measured.low - high) < AWAY * largest:
        return None
    text = f"it is {interval(low, high, unit)} there, and {interval(measured.low, measured.high, unit)}"
    return "come to what was recorded", text, {"lowest": low, "highest": high, "recorded": measured.low}


def _more(measured: _Moved, simulated: list[_Moved]) -> bool:
    """Whether all simulations move much more than the recording, and not because they run away."""
    return all(s.spread > FAR * measured.spread and s.begun > FAR * measured.begun for s in simulated)


__all__ = ["out_of_reach"]
