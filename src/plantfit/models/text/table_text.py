"""Tables as a study file or a call writes them, brought to `Table`."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.models.parts.tables import Table
from plantfit.models.text.suggest import suggest

_KEYS = ("over", "nodes", "unit")
_RANGE = ("from", "to", "count")
_MANY = 10_000


def read_table(where: str, name: str, given: Any, signals: Collection[str]) -> Table:
    """A `Table` from {"over": ["y"], "nodes": [[0, 10, 20]], "unit": "s"}, or as it is.

    `signals` are the names that it may be over. Raises ModelError that names the entry.
    """
    table = given if isinstance(given, Table) else _from_mapping(where, name, given)
    if table.name != name:
        raise ModelError(f"{where}: table {name!r} has a declaration for {table.name!r}; use one name.")
    for signal in table.over:
        if signal not in signals:
            hint = f"{suggest(signal, signals)} Known are {', '.join(sorted(signals))}."
            raise ModelError(f"{where}: table {name!r} is over {signal!r}, which is no signal.{hint}")
    return table


def read_nodes(where: str, given: Any) -> tuple[float, ...]:
    """Nodes from a list of numbers or {"from", "to", "count"} (evenly spread, ends included)."""
    if isinstance(given, Mapping):
        if set(given) != set(_RANGE):
            raise ModelError(
                f"{where} are {dict(given)!r}; write {{from = 0, to = 20, count = 10}} or a list of numbers."
            )
        count = given["count"]
        if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= _MANY:
            raise ModelError(f"{where} have count {count!r}; write a whole number from 2 to {_MANY}.")
        first, last = (_number(where, given[key]) for key in ("from", "to"))
        return tuple(np.linspace(first, last, count).tolist())
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise ModelError(f"{where} are {given!r}; write a list of numbers or {{from = 0, to = 20, count = 10}}.")
    return tuple(_number(where, v) for v in given)


def _from_mapping(where: str, name: str, given: Any) -> Table:
    if not isinstance(given, Mapping):
        raise ModelError(
            f"{where}: table {name!r} is {given!r}; write a table "
            "with over = ['y'], nodes = [[0, 10, 20]] and unit = 's'."
        )
    for key in given:
        if key not in _KEYS:
            raise ModelError(
                f"{where}: table {name!r} has the key {key!r}, which is not known.{suggest(str(key), _KEYS)} Known are "
                f"{', '.join(_KEYS)}."
            )
    for key in ("over", "nodes"):
        if key not in given:
            raise ModelError(
                f"{where}: table {name!r} has no {key!r}; add it, as in over = ['y'], nodes = [[0, 10, 20]]."
            )
    over = given["over"]
    over = (over,) if isinstance(over, str) else tuple(over) if isinstance(over, list | tuple) else (over,)
    if not all(isinstance(s, str) for s in over):
        raise ModelError(
            f"{where}: table {name!r} is over {given['over']!r}; write names of signals, as in ['y'] or ['y', 'u']."
        )
    unit = given.get("unit")
    if unit is not None and not isinstance(unit, str):
        raise ModelError(
            f"{where}: the unit of table {name!r} is {unit!r}; write a string such as 's', or leave it out."
        )
    nodes = [read_nodes(f"{where}: the nodes of table {name!r}", axis) for axis in _axes(given["nodes"], len(over))]
    return Table(name, over, tuple(nodes), unit)


def _axes(nodes: Any, count: int) -> list[Any]:
    """One entry for each signal; over one signal the outer list may be left out."""
    if isinstance(nodes, np.ndarray):
        nodes = nodes.tolist()
    one = (
        isinstance(nodes, Mapping)
        or not isinstance(nodes, list | tuple)
        or not any(isinstance(n, list | tuple | Mapping) for n in nodes)
    )
    return [nodes] if count == 1 and one else list(nodes) if isinstance(nodes, list | tuple) else [nodes]


def _number(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ModelError(f"{where} have {value!r}; write finite numbers.")
    return float(value)
