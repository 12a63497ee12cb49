"""The levels, priors and drifts that a user asks for, in the units of the study."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit import units
from plantfit.errors import SpaceError, SpecError, UnitError
from plantfit.estimate.filters.filter import base_values
from plantfit.estimate.filters.noise import Level, Noise
from plantfit.problem.problem import Problem


@dataclass(frozen=True)
class Asked:
    """Levels as `Noise` takes them; `prior` and `drift` of parameters: shares on a log scale, else in their units;
    `truth` by name."""

    process: Mapping[str, Level]
    measurement: Mapping[str, Level]
    initial: Mapping[str, float]
    prior: Mapping[str, float]
    drift: Mapping[str, float]
    truth: Mapping[str, float]

    def spreads(
        self, problem: Problem, names: Sequence[str], at: Mapping[str, float]
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Prior and drift of the named parameters as the filters take them: of the logarithm, or of the logit within
        the bounds."""
        values = dict(zip(problem.space.names, base_values(problem, at).tolist(), strict=True))
        slope = {}
        for c in problem.space.coordinates:
            low, high, v = c.lower, c.upper, values[c.name]
            slope[c.name] = 1.0 if c.log else (high - low) / max((v - low) * (high - v), 1e-12 * (high - low) ** 2)
        made = ({n: v * slope[n] for n, v in given.items() if n in names} for given in (self.prior, self.drift))
        prior, drift = made
        return prior, drift


def asked(table: Any, problem: Problem) -> Asked:
    """What an [estimate] table asks for. Raises SpecError for unknown names, UnitError for units, SpaceError for
    levels that are none."""
    model, file = problem.model, problem.study_file
    place = f"{file.path.name}, [estimate" if file is not None else "[estimate"
    states, outputs = dict(model.states), dict(model.outputs)  # pyrefly: ignore[missing-attribute]
    free = {c.name: c for c in problem.space.coordinates}
    rate = {n: f"({units.difference_of(u)})/s^0.5" if u else None for n, u in states.items()}
    for kind, what, names in (
        ("process", "state", states), ("measurement", "output", outputs), ("initial", "state", states),
        ("prior", "free parameter", free), ("drift", "free parameter", free), ("truth", "free parameter", free),
    ):  # fmt: skip
        wrong = [n for n in getattr(table, kind) if n not in names]
        if wrong:
            raise SpecError(f"{place}.{kind}] names {wrong[0]!r}, which is no {what}; there are {', '.join(names)}.")
    try:
        process = {n: _level(f"{place}.process] {n}", v, rate[n]) for n, v in table.process.items()}
        measurement = {n: _level(f"{place}.measurement] {n}", v, outputs[n]) for n, v in table.measurement.items()}
        initial = {n: _number(f"{place}.initial] {n}", v, states[n]) for n, v in table.initial.items()}
        Noise(process, measurement, initial)
    except SpaceError as error:
        raise SpaceError(f"{place}]: {error}") from None
    spreads = []
    for kind in ("prior", "drift"):
        own = {}
        for n, v in getattr(table, kind).items():
            unit = "1" if free[n].log else free[n].unit
            unit = unit if kind == "prior" or unit is None else f"({units.difference_of(unit)})/s^0.5"
            own[n] = _number(f"{place}.{kind}] {n}", v, unit)
            if not (np.isfinite(own[n]) and own[n] >= 0) or (kind == "prior" and own[n] == 0):
                least = "above 0" if kind == "prior" else "of at least 0"
                raise SpecError(f"{place}.{kind}] {n} = {v!r}; give a standard deviation {least}.")
        spreads.append(own)
    truth = {n: _number(f"{place}.truth] {n}", v, free[n].unit, point=True) for n, v in table.truth.items()}
    return Asked(process, measurement, initial, spreads[0], spreads[1], truth)


def _level(place: str, value: Any, unit: str | None) -> Level:
    if isinstance(value, list | tuple):
        if len(value) != 2:
            raise SpecError(f"{place} = {value!r}; give a number, or a pair [low, high].")
        low, high = (_number(place, v, unit) for v in value)
        return low, high
    return _number(place, value, unit)


def _number(place: str, value: float | str, unit: str | None, point: bool = False) -> float:
    """A number, or a text with a unit in that of the study; a standard deviation by its size."""
    if not isinstance(value, str):
        return float(value)
    try:
        number, given = units.quantity(value)
        if unit is None:
            raise UnitError("the model has no unit for it, so give a number alone, or declare its unit.")
        return float(units.convert(number, given, unit)) if point else number * units.factor(given, unit)
    except UnitError as error:
        raise UnitError(f"{place} = {value!r}: {error}") from None
