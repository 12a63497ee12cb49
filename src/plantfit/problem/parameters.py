"""The parameters of a problem: what the model declares, changed by what the user says."""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit import units
from plantfit.errors import SpaceError, UnitError
from plantfit.models.model import Declared
from plantfit.space import Parameter, Space


def space_of(declared: Sequence[Declared], changes: Mapping[str, Any] | None, recordings: Sequence[str]) -> Space:
    """A space in the model's units; `changes` map names to `Parameter`, (low, high) or a number to hold."""
    merged = {
        d.name: Parameter(d.bounds, d.unit, d.scale, d.value, sentence=d.sentence, shape=d.shape, limits=d.limits, typical=d.typical)
        for d in declared
    }
    for name, change in (changes or {}).items():
        if name not in merged:
            close = difflib.get_close_matches(name, merged, 1)
            guess = f"; did you mean {close[0]!r}?" if close else "."
            raise SpaceError(f"The model has no parameter {name!r}{guess} It has {sorted(merged)}.")
        merged[name] = _changed(name, merged[name], change)
    return Space(merged, recordings)


def _changed(name: str, base: Parameter, change: Any) -> Parameter:
    if isinstance(change, int | float):
        return dataclasses.replace(base, value=float(change))
    if not isinstance(change, Parameter):
        if not isinstance(change, tuple | list | np.ndarray) or len(change) != 2:
            raise SpaceError(
                f"Parameter {name!r} is given as {change!r}; give (low, high), a number to hold, or "
                "Parameter((low, high), per_recording=True) for more."
            )
        low, high = change
        return dataclasses.replace(base, bounds=(low, high), value=None, limits=_holding(base.limits, (low, high)))
    if change.shape and change.shape != base.shape:
        raise SpaceError(f"Parameter {name!r} is given with shape {change.shape}, but the model has {base.shape or 'a single number'}.")
    bounds, value, start, limits, typical = change.bounds, change.value, change.start, change.limits, change.typical
    if change.unit is not None and base.unit is not None and change.unit != base.unit:
        if not units.compatible(change.unit, base.unit):
            raise UnitError(
                f"Parameter {name!r} is given in {change.unit!r} but the model has it in {base.unit!r}; use a unit of that kind."
            )
        factor, offset = units.factor_offset(change.unit, base.unit)
        converted = lambda v: None if v is None else np.asarray(v, dtype=float) * factor + offset  # noqa: E731
        bounds = (converted(bounds[0]), converted(bounds[1])) if bounds else None
        value, start = converted(value), converted(start)
        limits = (float(limits[0]) * factor + offset, float(limits[1]) * factor + offset) if limits else None
        typical = None if typical is None else typical * abs(factor)
    held = value if value is not None else (None if bounds is not None or change.tied else base.value)
    if bounds is not None and value is not None:
        held = value
    return Parameter(
        bounds=bounds or base.bounds,
        unit=base.unit or change.unit,
        scale=change.scale if change.scale != "linear" or change.bounds else base.scale,
        value=held,
        tied=change.tied,
        per_recording=change.per_recording,
        start=start,
        sentence=change.sentence or base.sentence,
        shape=base.shape,
        smooth=change.smooth,
        limits=limits if limits is not None else _holding(base.limits, bounds),
        typical=typical if typical is not None else base.typical,
    )


def _holding(limits: tuple[float, float] | None, bounds: Any) -> tuple[float, float] | None:
    """The model's limits, widened to bounds that the user gave beyond them: the user knows this plant."""
    if limits is None or bounds is None or not all(_numeric(b) for b in bounds):
        return limits  # what is no number is refused later, by name
    return min(limits[0], float(np.min(bounds[0]))), max(limits[1], float(np.max(bounds[1])))


def _numeric(bound: Any) -> bool:
    try:
        return np.asarray(bound, dtype=float).size > 0
    except (TypeError, ValueError):
        return False
