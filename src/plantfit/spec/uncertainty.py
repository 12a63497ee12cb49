"""The errors that a study file states: limits of data sheets as shared errors of signals, of the clock, of held
parameters."""

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit import units
from plantfit.errors import SpecError, UnitError
from plantfit.problem import Problem
from plantfit.spec.error_place import errors_at
from plantfit.spec.tables import SpecTable, UncertaintyTable
from plantfit.trust.stated_errors.shared_error import Kind, SharedError
from plantfit.trust.stated_errors.uncertainty_budget import Source, type_a, type_b

SIZES = ("limit", "standard", "expanded", "repeats")
KINDS = ("offset", "gain", "zero", "full scale")
SHARES = ("%", "permille", "ppm")


def errors_of(table: SpecTable, problem: Problem, path: Path) -> tuple[SharedError, ...]:
    """One for each [uncertainty.NAME]; raises SpecError and UnitError with file, table and what to do."""
    found = []
    for name, own in table.uncertainty.items():
        with errors_at(f"{path.name}, [uncertainty.{name}]"):
            found.append(_error(name, own, table, problem))
    return tuple(found)


def _error(name: str, own: UncertaintyTable, table: SpecTable, problem: Problem) -> SharedError:
    _check_size(own)
    for recording in own.recordings or ():
        if recording not in table.recording:
            raise SpecError(f"recordings names {recording!r}, which is not there{_near(recording, table.recording)}")
    kind = _kind(own, table, problem)
    if kind == "constant" and (own.recordings is not None or own.per_recording):
        raise SpecError(f"{_names(own)[0]!r} is one number for all recordings; leave out recordings and per_recording.")
    _check_span(own, kind)
    names = _names(own)
    unit = _unit(names[0], kind, problem)
    source = _source(name, own, unit, _factor(own, kind, unit, table, problem))
    relative = kind in ("gain", "clock")
    if relative and source.limit >= 1.0:
        raise SpecError(
            f"the error of the {kind} is {100 * source.limit:g} %, which is too large; for one per cent write 0.01, or "
            f'1 with unit = "%".'
        )
    recordings = None if own.recordings is None else tuple(own.recordings)
    of = "" if kind == "clock" else names[0] if len(names) == 1 else tuple(names)
    return SharedError(source, kind, of, own.span or 1.0, recordings, own.per_recording)


def _kind(own: UncertaintyTable, table: SpecTable, problem: Problem) -> Kind:
    """What the error does; what `of` names decides which kinds there are."""
    signals, names = problem.predictor.needs, _names(own)
    other = next((n for n in names if n not in signals), None)
    if other is None:
        if own.kind is None:
            raise SpecError(f"kind is missing; add how {names[0]!r} errs, one of {', '.join(map(repr, KINDS))}.")
        _check_together(own, names, problem)
        return own.kind
    if other != "clock":
        _check_constant(other, table, problem)
    what = "the clock" if other == "clock" else f"the parameter {other!r}"
    if len(names) > 1:
        raise SpecError(
            f"of names {what} together with others; only signals can share an error, so write another table for it."
        )
    if own.kind is not None:
        raise SpecError(f"kind = {own.kind!r} is only for signals, but 'of' names {what}; leave kind out.")
    return "clock" if other == "clock" else "constant"


def _names(own: UncertaintyTable) -> list[str]:
    return [own.of] if isinstance(own.of, str) else own.of


def _check_together(own: UncertaintyTable, names: list[str], problem: Problem) -> None:
    """Signals that share one number must have it in one unit, but for a gain."""
    found = {n: _unit(n, own.kind, problem) for n in names}
    if len(set(found.values())) > 1:
        units_said = ", ".join(f"{n} in {unit}" for n, unit in found.items())
        raise SpecError(
            f"signals in different units ({units_said}) cannot share one "
            f"{own.kind}; they can share a gain, or write one table for each."
        )


def _check_constant(of: str, table: SpecTable, problem: Problem) -> None:
    parameters = problem.space.parameters
    if of in table.model.constants:
        raise SpecError(
            f"{of!r} is a constant of [model], and constants have no uncertainty; make it a held parameter: "
            f"[parameters.{of}] with value and unit."
        )
    if of not in parameters:
        held = [n for n, p in parameters.items() if p.value is not None and not p.shape]
        known = [*problem.predictor.needs, "clock", *held]
        raise SpecError(f"of = {of!r} is not a signal of the model, a held parameter or the clock{_near(of, known)}")
    p = parameters[of]
    if p.tied is not None:
        raise SpecError(f"{of!r} is tied to {p.tied!r}; state the uncertainty of {problem.space.root(of)!r}.")
    if p.value is None:
        raise SpecError(
            f"{of!r} is fitted, so its uncertainty comes from the data; "
            f"hold it with [parameters.{of}] value, or leave this table out."
        )
    if p.shape:
        raise SpecError(f"{of!r} is a table; only single held numbers can have an uncertainty.")


def _check_size(own: UncertaintyTable) -> None:
    """One way to say how large the error is, with numbers that can be."""
    given = [s for s in SIZES if getattr(own, s) is not None]
    if not given:
        raise SpecError(
            "the size is missing: give limit (half width from the data sheet), standard, expanded with its k, or "
            "repeats = [...]."
        )
    if len(given) > 1:
        raise SpecError(f"it gives {' and '.join(given)}; keep one of them, as each says how large the error is.")
    size = given[0]
    value = getattr(own, size)
    if size == "repeats":
        if not np.all(np.isfinite(value)):
            raise SpecError(f"repeats = {list(value)} has values that are not finite numbers; leave these out.")
    elif not (np.isfinite(value) and value >= 0):
        better = (
            f"an uncertainty has no sign, so write {-value:g}" if -np.inf < value < 0 else "give a number of at least 0"
        )
        raise SpecError(f"{size} = {value:g} cannot be used; {better}.")
    for key, where in (("shape", "limit"), ("k", "expanded")):
        if getattr(own, key) is not None and size != where:
            raise SpecError(f"{key} can be used only with {where}, but {size} is given; leave {key} out.")
    if own.degrees_of_freedom is not None and size == "repeats":
        raise SpecError("the degrees of freedom follow from repeats; leave degrees_of_freedom out.")
    if own.shape == "normal":
        raise SpecError(
            'a normal distribution has no limit; give standard, or expanded with its k, in place of shape = "normal".'
        )


def _check_span(own: UncertaintyTable, kind: Kind) -> None:
    if kind in ("zero", "full scale") and own.span is None:
        raise SpecError(f"kind = {kind!r} needs span; give the range of the sensor, in the unit of {_names(own)[0]!r}.")
    if kind == "gain" and own.span is not None:
        raise SpecError(
            'a gain is a share of the reading, so span has no meaning; for a share of the span use kind = "full scale".'
        )
    if kind in ("clock", "constant") and own.span is not None:
        raise SpecError(f"span is only for signals, but 'of' names {_names(own)[0]!r}; leave span out.")


def _unit(of: str, kind: Kind | None, problem: Problem) -> str | None:
    """The unit of the error."""
    if kind in ("gain", "clock"):
        return "1"
    if kind == "constant":
        return problem.space.parameters[of].unit
    return next((unit for e in problem.experiments.values() if (unit := e.recording.signals[of].unit)), None)


def _factor(own: UncertaintyTable, kind: Kind, unit: str | None, table: SpecTable, problem: Problem) -> float:
    """What turns the numbers of the table into the unit of the error."""
    if kind in ("gain", "clock"):
        if own.unit is None:
            return 1.0
        if not units.compatible(own.unit, "1"):
            raise UnitError(
                f'a {kind} is relative, and {own.unit!r} is not; write unit = "%" or "ppm", or give a share without '
                f"unit."
            )
        return units.factor_offset(own.unit, "1")[0]
    if kind == "constant":
        name = _names(own)[0]
        p = problem.space.parameters[name]
        if (
            unit is not None
            and units.is_point(unit)
            and own.unit is not None
            and units.parse(own.unit) in [units.parse(s) for s in SHARES]
        ):
            raise UnitError(
                f"{name!r} is in {unit!r}, whose zero is arbitrary, so an error in {own.unit} has no size; give it "
                f"in {units.difference_of(unit)!r}."
            )
        beside = table.parameters[name].unit if name in table.parameters else None
        return _absolute(own, own.unit or beside, unit, abs(float(p.value)), "its value, which is 0")  # pyrefly: ignore[bad-argument-type]
    return _absolute(own, own.unit, unit, own.span, "the span: give span")


def _absolute(own: UncertaintyTable, given: str | None, wanted: str | None, whole: float | None, of_what: str) -> float:
    """A unit turned into that of a signal or parameter; % and ppm of anything that is not in them are shares of
    `whole`."""
    if given is None or given == wanted:
        return 1.0
    parsed = units.parse(given)
    if parsed in [units.parse(s) for s in SHARES] and not (wanted is not None and units.parse(wanted) == parsed):
        if not whole:
            raise SpecError(f"unit = {given!r} is a share of {of_what}, or give the error in {wanted or 'its unit'!r}.")
        return units.factor_offset(given, "1")[0] * whole
    if wanted is None:
        raise UnitError(
            f"unit = {given!r}, but {_names(own)[0]!r} has no unit; leave unit out, or give {_names(own)[0]!r} one."
        )
    if not units.compatible(given, wanted):
        raise UnitError(
            f"unit = {given!r} cannot be converted to {wanted!r}, the unit of {_names(own)[0]!r}; correct one of them."
        )
    return units.factor(given, wanted)  # an uncertainty is a difference: 1 degC is 1 K


def _source(name: str, own: UncertaintyTable, unit: str | None, factor: float) -> Source:
    more: dict[str, Any] = {} if own.degrees_of_freedom is None else {"degrees_of_freedom": own.degrees_of_freedom}
    if own.repeats is not None:
        return type_a(name, factor * np.asarray(own.repeats), unit)
    if own.limit is not None:
        return type_b(name, factor * own.limit, unit, own.shape or "rectangular", **more)
    if own.standard is not None:
        return type_b(name, factor * own.standard, unit, "normal", k=1.0, **more)
    return type_b(name, factor * (own.expanded or 0.0), unit, "normal", k=own.k or 2.0, **more)


def _near(name: str, known: Iterable[str]) -> str:
    """`; did you mean 'y'? There are ...`."""
    known = list(known)
    near = difflib.get_close_matches(name, known, 1)
    return f"; {f'did you mean {near[0]!r}? ' if near else ''}There are {', '.join(known)}."
