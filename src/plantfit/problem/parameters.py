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
        d.name: Parameter(**{f.name: getattr(d, f.name) for f in dataclasses.fields(Declared) if f.name != "name"})
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
        raise SpaceError(
            f"Parameter {name!r} is given with shape {change.shape}, but the model has "
            f"{base.shape or 'a single number'}."
        )
    own = _in_unit(name, change, base.unit)
    given: dict[str, Any] = {
        f.name: getattr(own, f.name) for f in dataclasses.fields(Parameter) if not _unsaid(f, getattr(own, f.name))
    }
    given |= {  # what the change leaves open stays as the model has it, but for these
        "bounds": own.bounds or base.bounds,
        "scale": own.scale if own.scale != "linear" or own.bounds else base.scale,
        "value": own.value if own.value is not None else None if own.bounds is not None or own.tied else base.value,
        "unit": base.unit or own.unit,
        "limits": own.limits if own.limits is not None else _holding(base.limits, own.bounds),
    }
    return dataclasses.replace(base, **given)


def _unsaid(field: dataclasses.Field, value: Any) -> bool:
    return value is None or (isinstance(value, type(field.default)) and value == field.default)


def _in_unit(name: str, change: Parameter, unit: str | None) -> Parameter:
    """What a user says, in the unit that the model has."""
    if change.unit is None or unit is None or change.unit == unit:
        return change
    if not units.compatible(change.unit, unit):
        raise UnitError(
            f"Parameter {name!r} is given in {change.unit!r} but the model has it in {unit!r}; use a unit of that kind."
        )
    factor, offset = units.factor_offset(change.unit, unit)
    converted = lambda v: None if v is None else np.asarray(v, dtype=float) * factor + offset  # noqa: E731
    bounds, limits = change.bounds, change.limits
    return dataclasses.replace(
        change,
        bounds=(converted(bounds[0]), converted(bounds[1])) if bounds else None,
        value=converted(change.value),
        start={r: converted(v) for r, v in change.start.items()}
        if isinstance(change.start, Mapping)
        else converted(change.start),
        limits=(float(limits[0]) * factor + offset, float(limits[1]) * factor + offset) if limits else None,
        typical=None if change.typical is None else change.typical * abs(factor),
        unit=unit,
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
