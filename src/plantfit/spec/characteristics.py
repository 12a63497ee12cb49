"""Tables of a model whose nodes and values stand in a file: a known characteristic, as a cell's voltage over its charge
or a valve's flow over its stroke."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plantfit.errors import SpecError, UnitError
from plantfit.spec.error_place import errors_at
from plantfit.spec.recordings import named_file
from plantfit.spec.tables import ParameterTable, SpecTable, TableTable

if TYPE_CHECKING:
    from plantfit.recording.readers.columns import Table


def with_characteristics(table: SpecTable, path: Path, files: Mapping[str, Path]) -> SpecTable:
    """The study's tables with the nodes and values of the files that [model.tables] names, which lie beside `path` or
    where `files` says.

    Values that [parameters] does not mention are held at those of the file; where it gives bounds, a search begins at
    them. Raises SpecError, RecordingError and UnitError.
    """
    tables, parameters = dict(table.model.tables), dict(table.parameters)
    for name, t in tables.items():
        file = t.file
        if file is None:
            continue
        with errors_at(f"{path.name}, [model.tables.{name}]"):
            own = parameters.get(name, ParameterTable())
            over = [t.over] if isinstance(t.over, str) else t.over
            t = t.model_copy(update={"unit": t.unit or own.unit})
            axes, values = _read(name, over, t, table, files.get(file) or named_file(file, path))
            if own.value is not None:
                raise SpecError(f"its values stand in {file!r} and in [parameters.{name}]; leave one of them out.")
            told = {"sentence": own.sentence or f"table over {' and '.join(over)}, from {file}"}
            if own.start is None and own.tied is None:
                told |= {"value" if own.bounds is None else "start": values}
            parameters[name] = own.model_copy(update=told)
        tables[name] = t.model_copy(update={"nodes": axes})
    return table.model_copy(
        update={"model": table.model.model_copy(update={"tables": tables}), "parameters": parameters}
    )


def _read(name: str, over: Sequence[str], t: TableTable, table: SpecTable, file: Path) -> tuple[list[list[float]], Any]:
    """Nodes of each signal in `over`, and values (nested tuples)."""
    from plantfit.recording.readers.any_format import table as columns_of  # polars, only where a file is named

    units = _units(table)
    if unknown := [s for s in over if s not in units]:
        raise SpecError(f"over names {unknown[0]!r}, which the model does not declare; it declares {', '.join(units)}.")
    units[name] = t.unit
    found = columns_of(file)
    wanted = _columns(found, t, [*over, name])
    columns = [
        _numbers(found, c, s, units[s], "under [model]" if s != name else f"under [model.tables.{name}]")
        for c, s in zip(wanted, [*over, name], strict=True)
    ]
    if len(over) == 1:
        order = np.argsort(columns[0], kind="stable")
        nodes, values = columns[0][order], columns[1][order]
        if len(twice := np.flatnonzero(np.diff(nodes) == 0.0)):
            raise SpecError(
                f"{found.where(int(order[twice[0] + 1]))}: {over[0]} = {nodes[twice[0]]:g} stands in two rows; "
                "leave one of them, or their mean."
            )
        if len(nodes) < 2:
            raise SpecError(f"{found.source} has {len(nodes)} row; a table needs two nodes or more.")
        return [nodes.tolist()], tuple(values.tolist())
    return _grid(found, over, columns)


def _units(table: SpecTable) -> dict[str, str | None]:
    """Units of the signals that a table may be over."""
    m = table.model
    states = {n: s if isinstance(s, str) else s.unit for n, s in m.states.items()}
    return {**m.inputs, **states, **m.outputs, "t": "s"}


def _columns(found: "Table", t: TableTable, names: Sequence[str]) -> list[str | int]:
    """Which columns hold the signals and the values."""
    if t.columns is not None:
        if len(t.columns) != len(names):
            raise SpecError(f"columns needs {len(names)} names, of {', '.join(names)}; it has {len(t.columns)}.")
        return list(t.columns)
    known = {text for c in found.columns for text in (c.header, c.name)}
    if all(n in known for n in names):
        return list(names)
    headers = ", ".join(c.header for c in found.columns)
    if len(found.columns) == len(names):
        return list(range(len(names)))
    raise SpecError(
        f"{found.source} has the columns {headers}. Say which of them are {', '.join(names)}: "
        f'columns = ["...", ...], in this order.'
    )


def _numbers(found: "Table", wanted: str | int, purpose: str, need: str | None, where: str) -> np.ndarray:
    """A column (n,) in the unit that is needed, which is declared `where` it says."""
    from plantfit.recording.readers.numbers import casted, numbers
    from plantfit.units import convert

    column = found.column(wanted, purpose)
    if len(words := casted(found, column.cells).text):
        row = int(words[0])
        raise SpecError(
            f"{found.where(row)}, column {column.header!r}: {str(column.cells[row])!r} is not a number; correct it."
        )
    values, _ = numbers(found, column, purpose)
    if len(missing := np.flatnonzero(~np.isfinite(values))):
        raise SpecError(
            f"{found.where(int(missing[0]))}, column {column.header!r}: there is no number; fill or delete that row."
        )
    if column.unit is None:
        return values
    if need is None:
        raise UnitError(
            f"{found.source}: column {column.header!r} is in {column.unit}, and the model's {purpose} has no unit; "
            f"declare its unit {where}, and the column is converted."
        )
    with errors_at(f"{found.source}, column {column.header!r}"):
        return np.asarray(convert(values, column.unit, need))


def _grid(found: "Table", over: Sequence[str], columns: Sequence[np.ndarray]) -> tuple[list[list[float]], Any]:
    """Nodes of two signals and the values at every pair of them, one row of the file for each."""
    (first, i), (second, j) = (np.unique(c, return_inverse=True) for c in columns[:2])
    values = np.full((len(first), len(second)), np.nan)
    for row, (a, b) in enumerate(zip(i, j, strict=True)):
        if np.isfinite(values[a, b]):
            raise SpecError(
                f"{found.where(row)}: {over[0]} = {first[a]:g} with {over[1]} = {second[b]:g} stands in two rows; "
                "leave one of them, or their mean."
            )
        values[a, b] = columns[2][row]
    if len(gaps := np.argwhere(np.isnan(values))):
        a, b = gaps[0]
        raise SpecError(
            f"{found.source} has no row for {over[0]} = {first[a]:g} with {over[1]} = {second[b]:g}. A table over two "
            f"signals needs a value for every pair of its {len(first)} and {len(second)} nodes."
        )
    if min(values.shape) < 2:
        alone = over[0] if len(first) < 2 else over[1]
        raise SpecError(
            f"{found.source} has one value of {alone} alone; a table needs two nodes or more of each signal."
        )
    return [first.tolist(), second.tolist()], tuple(tuple(row) for row in values.tolist())
