"""What a user declares beside the text of equations, brought to one form and checked."""

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from keyword import iskeyword
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.models.model import Declared
from plantfit.models.parts.tables import Table
from plantfit.models.text.functions import CALLS, CONSTANTS
from plantfit.models.text.suggest import suggest
from plantfit.models.text.table_text import read_table

# play and friction are read as functions only where they are called
RESERVED = frozenset({*CONSTANTS, *CALLS, "t", "delay"})

_QUANTITY = re.compile(r"\s*(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)(?P<unit>.*)", re.DOTALL)
_PARAMETER_KEYS = tuple(f.name for f in fields(Declared) if f.name != "name")


@dataclass(frozen=True)
class Constant:
    """A number with a unit; None means that the unit is not known."""

    value: float
    unit: str | None


@dataclass(frozen=True)
class Declarations:
    """Names of a model, by kind. `initial` holds a number or an expression for every state, `parameters` those of
    tables too."""

    model: str
    inputs: Mapping[str, str | None]
    states: Mapping[str, str | None]
    initial: Mapping[str, float | str]
    outputs: Mapping[str, str | None]
    parameters: Mapping[str, Declared]
    constants: Mapping[str, Constant]
    tables: Mapping[str, Table]

    def names(self) -> set[str]:
        return {*self.inputs, *self.states, *self.outputs, *self.parameters, *self.constants}


def declare(
    model: str, inputs: Any, states: Any, outputs: Any, parameters: Any, constants: Any, tables: Any = None
) -> Declarations:
    """Check and unify declarations. Raises ModelError that names the entry."""
    where = f"Model {model!r}"
    given = {
        "inputs": _table(where, "inputs", inputs),
        "states": _table(where, "states", states),
        "outputs": _table(where, "outputs", outputs),
        "parameters": _table(where, "parameters", parameters),
        "constants": _table(where, "constants", constants),
        "tables": _table(where, "tables", tables),
    }
    _check_names(where, given)
    split = {name: _state(where, name, value) for name, value in given["states"].items()}
    signals = {*given["inputs"], *given["states"], *given["outputs"], "t"}
    read = {n: read_table(where, n, v, signals) for n, v in given["tables"].items()}
    plain = {n: _parameter(where, n, v) for n, v in given["parameters"].items()}
    return Declarations(
        model,
        {n: _unit(where, "input", n, v) for n, v in given["inputs"].items()},
        {n: unit for n, (unit, _) in split.items()},
        {n: initial for n, (_, initial) in split.items()},
        {n: _unit(where, "output", n, v) for n, v in given["outputs"].items()},
        {n: p if n in read else _single(where, p) for n, p in plain.items()}
        | {n: _table_parameter(where, table, plain.get(n, Declared(n))) for n, table in read.items()},
        {n: _constant(where, n, v) for n, v in given["constants"].items()},
        read,
    )


def _table(where: str, kind: str, given: Any) -> dict[str, Any]:
    """A mapping as it is; a list of names (or declarations) as names without unit."""
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, Iterable) and not isinstance(given, str):
        return {
            (entry.name if isinstance(entry, Declared) else entry): (entry if isinstance(entry, Declared) else None)
            for entry in given
        }
    raise ModelError(f"{where}: {kind} are {given!r}; write a table of names and units, with an entry such as u = 'V'.")


def _check_names(where: str, tables: Mapping[str, Mapping[str, Any]]) -> None:
    seen: dict[str, str] = {}
    for kind, table in tables.items():
        for name in table:
            if not isinstance(name, str) or not name.isidentifier() or iskeyword(name):
                raise ModelError(
                    f"{where}: {kind} have the name {name!r}; use letters, "
                    "digits and _, not a digit first, and no Python keyword."
                )
            if name != unicodedata.normalize("NFKC", name):
                plain = unicodedata.normalize("NFKC", name)
                raise ModelError(
                    f"{where}: the name {name!r} in {kind} has letters with a simpler form; write {plain!r}."
                )
            if name in RESERVED:
                raise ModelError(
                    f"{where}: {kind} have the name {name!r}, which equations use themselves; choose another name."
                )
            if name in seen and {seen[name], kind} not in ({"states", "outputs"}, {"parameters", "tables"}):
                raise ModelError(
                    f"{where}: {name!r} is declared in {seen[name]} and in {kind}; give each its own name."
                )
            seen[name] = kind


def _unit(where: str, kind: str, name: str, value: Any) -> str | None:
    if isinstance(value, Mapping):
        _check_keys(where, kind, name, value, ("unit",))
        value = value.get("unit")
    if value is None or isinstance(value, str):
        return value
    raise ModelError(f"{where}: the unit of {kind} {name!r} is {value!r}; write a string such as 'V', or None.")


def _state(where: str, name: str, value: Any) -> tuple[str | None, float | str]:
    initial: Any = 0.0
    if isinstance(value, Mapping):
        _check_keys(where, "state", name, value, ("unit", "initial"))
        initial = value.get("initial", 0.0)
        value = value.get("unit")
    if not isinstance(initial, str):
        initial = _number(where, f"the initial value of state {name!r}", initial)
    return _unit(where, "state", name, value), initial


def _parameter(where: str, name: str, value: Any) -> Declared:
    if isinstance(value, Declared):
        if value.name != name:
            raise ModelError(f"{where}: parameter {name!r} has a declaration for {value.name!r}; use one name.")
        return _checked(where, value)
    if value is None or isinstance(value, str):
        return Declared(name, unit=value)
    if not isinstance(value, Mapping):
        raise ModelError(
            f"{where}: parameter {name!r} is {value!r}; write a table "
            "with entries such as unit = 'V' and bounds = [0, 1]."
        )
    _check_keys(where, "parameter", name, value, _PARAMETER_KEYS)
    return _checked(where, Declared(name, **value))


def _checked(where: str, p: Declared) -> Declared:
    what = f"parameter {p.name!r}"
    if p.scale not in ("linear", "log"):
        raise ModelError(f"{where}: {what} has scale {p.scale!r}; use 'linear' or 'log'.")
    if p.value is not None:
        p = replace(p, value=_numbers(where, f"the value of {what}", p.value))
    if p.bounds is not None:
        if isinstance(p.bounds, str) or not isinstance(p.bounds, Iterable) or len(tuple(p.bounds)) != 2:
            raise ModelError(f"{where}: {what} has bounds {p.bounds!r}; write two numbers, (low, high).")
        low, high = (_numbers(where, f"a bound of {what}", b) for b in p.bounds)
        p = replace(p, bounds=(low, high))
    if p.limits is not None:
        if isinstance(p.limits, str) or not isinstance(p.limits, Iterable) or len(tuple(p.limits)) != 2:
            raise ModelError(
                f"{where}: {what} has limits {p.limits!r}; write two "
                "numbers, (low, high), infinite where there is no limit."
            )
        p = replace(p, limits=tuple(p.limits))
    _unit(where, "parameter", p.name, p.unit)
    return p


def _table_parameter(where: str, table: Table, p: Declared) -> Declared:
    """The values of a table: what `parameters` say about them, in the table's unit and shape."""
    if p.unit is not None and table.unit is not None and p.unit != table.unit:
        raise ModelError(
            f"{where}: table {p.name!r} is in {table.unit!r} but its parameter in {p.unit!r}; give one unit."
        )
    for what, value in _given_numbers(p):
        if _shape(value) not in ((), table.shape):
            nodes = " x ".join(map(str, table.shape))
            raise ModelError(
                f"{where}: table {p.name!r} has {nodes} nodes but {what} "
                f"{value!r}; give one for each node, or one for all."
            )
    over = " and ".join(table.over)
    return replace(p, unit=table.unit or p.unit, shape=table.shape, sentence=p.sentence or f"table over {over}")


def _single(where: str, p: Declared) -> Declared:
    """A parameter that is no table, checked to be one number."""
    arrays = [what for what, value in _given_numbers(p) if _shape(value) != ()]
    if p.shape or arrays:
        what = arrays[0] if arrays else f"the shape {p.shape}"
        raise ModelError(
            f"{where}: parameter {p.name!r} has {what} of an array but "
            "is no table; declare it in tables or give one number."
        )
    return p


def _given_numbers(p: Declared) -> list[tuple[str, Any]]:
    return [
        (what, value)
        for what, value in (("a value", p.value), *(("a bound", b) for b in p.bounds or ()))
        if value is not None
    ]


def _shape(numbers: Any) -> tuple[int, ...] | None:
    """The shape of nested tuples, None for rows of different lengths."""
    try:
        return np.shape(numbers)
    except ValueError:
        return None


def _constant(where: str, name: str, value: Any) -> Constant:
    if not isinstance(value, str):
        return Constant(_number(where, f"constant {name!r}", value), None)
    match = _QUANTITY.fullmatch(value)
    if match is None:
        raise ModelError(f"{where}: constant {name!r} is {value!r}; write a number and a unit, as in '9.81 m/s^2'.")
    return Constant(_number(where, f"constant {name!r}", match["number"]), match["unit"].strip())


def _number(where: str, what: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ModelError(f"{where}: {what} is {value!r}; write a finite number.")
    return number


def _numbers(where: str, what: str, value: Any) -> Any:
    """A finite number, or nested tuples of them."""
    if isinstance(value, list | tuple | np.ndarray):
        return tuple(_numbers(where, what, v) for v in value)
    return _number(where, what, value)


def _check_keys(where: str, kind: str, name: str, value: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in value:
        if key not in known:
            hint = suggest(str(key), known)
            raise ModelError(
                f"{where}: {kind} {name!r} has the key {key!r}, which is not known.{hint} Known are {', '.join(known)}."
            )
