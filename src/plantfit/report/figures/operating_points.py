"""Tables of parameters: the value at every node with its 95 % interval."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from plantfit.findings import OperatingTable, array
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import interval, significant, unit_label, with_unit

HEIGHT = 340  # pixels
SIDE, SPREAD = 0.1, 0.6  # of the least distance between nodes: from line to line, and of all lines together
_DASHES = ("solid", "dash", "dot", "dashdot")


class Line(NamedTuple):
    """Values (n,) over nodes (n,), with intervals (n,) and states (n,)."""

    name: str
    nodes: np.ndarray
    values: np.ndarray
    low: np.ndarray
    high: np.ndarray
    status: tuple[str, ...]


def table_figure(tables: Sequence[OperatingTable]) -> Figure:
    """One table of one or more recordings: a line for each, over two signals for each node of the first signal."""
    lines = [line for table in tables for line in _lines(table)]
    first = tables[0]
    gap = min((b - a for a, b in pairwise(lines[0].nodes)), default=1.0)
    data = [trace for k, line in enumerate(lines) for trace in _drawn(line, k, gap * _offset(k, len(lines)), first)]
    if any(s == "flat" for line in lines for s in line.status):
        data.append(_key("not determined", style.MUTED, "circle-open"))
    if any(s == "not visited" for line in lines for s in line.status):
        data.append(_key("not visited", style.MUTED, "x-thin-open"))
    if any(s == "at bound" for line in lines for s in line.status):
        data.append(_key("on a bound", style.WARNING, "diamond"))
    layout = style.layout(
        HEIGHT, showlegend=len(data) > 2, hovermode="closest", margin={"l": 56, "r": 14, "t": 40, "b": 44}
    )
    layout["legend"] = layout["legend"] | {"x": 0, "xanchor": "left"}
    layout["xaxis"] = style.axis(with_unit(first.over[-1], first.over_units[-1]))
    layout["yaxis"] = style.axis(with_unit(first.name, first.unit), range=_range(lines))
    return {"data": data, "layout": layout}


def _lines(table: OperatingTable) -> Iterator[Line]:
    inner = array(table.nodes[-1])
    numbers = [array(v).reshape(-1, len(inner)) for v in (table.values, table.low, table.high)]
    for k in range(len(numbers[0])):
        status = tuple(table.status[k * len(inner) : (k + 1) * len(inner)])
        values, low, high = (v[k] for v in numbers)
        yield Line(_line_name(table, k), inner, values, low, high, status)


def _line_name(table: OperatingTable, k: int) -> str:
    own = table.recording or ""
    if len(table.nodes) == 1:
        return own or table.name
    unit = unit_label(table.over_units[0])
    node = f"{table.over[0]} = {significant(table.nodes[0][k])}{' ' + unit if unit else ''}"
    return f"{own}, {node}" if own else node


def _offset(k: int, count: int) -> float:
    """Place of a line beside the node, in distances between nodes."""
    return (k - 0.5 * (count - 1)) * min(SIDE, SPREAD / max(count - 1, 1))


def _drawn(line: Line, k: int, shift: float, table: OperatingTable) -> list[dict[str, Any]]:
    colour, dash = style.SERIES[k % len(style.SERIES)], _DASHES[k // len(style.SERIES) % len(_DASHES)]
    x, group = line.nodes + shift, f"line {k}"
    known = np.array([s not in ("flat", "not visited") for s in line.status])
    through = {
        "type": "scatter",
        "mode": "lines",
        "name": style.plain(line.name),
        "legendgroup": group,
        "x": style.numbers(x),
        "y": style.numbers(np.where(known, line.values, np.nan)),
        "line": {"color": colour, "width": 1.5, "dash": dash},
        "hoverinfo": "skip",
    }
    looks = (
        (("determined", "weak", "fixed"), colour, "circle"),
        (("flat",), style.MUTED, "circle-open"),
        (("not visited",), style.MUTED, "x-thin-open"),
        (("at bound",), style.WARNING, "diamond"),
    )
    return [
        through,
        *(
            _points(line, x, kinds, look, symbol, group, table)
            for kinds, look, symbol in looks
            if {*kinds} & {*line.status}
        ),
    ]


def _points(
    line: Line, x: np.ndarray, kinds: Sequence[str], colour: str, symbol: str, group: str, table: OperatingTable
) -> dict[str, Any]:
    at = [k for k, status in enumerate(line.status) if status in kinds]
    above, below = (np.nan_to_num(v[at]) for v in (line.high - line.values, line.values - line.low))
    return {
        "type": "scatter",
        "mode": "markers",
        "showlegend": False,
        "legendgroup": group,
        "x": style.numbers(x[at]),
        "y": style.numbers(line.values[at]),
        "error_y": {
            "type": "data",
            "symmetric": False,
            "array": style.numbers(above),
            "arrayminus": style.numbers(below),
            "color": style.TRACK if colour == style.MUTED else colour,
            "thickness": 1.5,
            "width": 4,
        },
        "marker": {"color": colour, "symbol": symbol, "size": 7},
        "text": [style.plain(_words(line, k, table)) for k in at],
        "hovertemplate": "%{text}<extra></extra>",
    }


def _words(line: Line, k: int, table: OperatingTable) -> str:
    unit = f" {unit_label(table.unit)}" if unit_label(table.unit) else ""
    over = f" {unit_label(table.over_units[-1])}" if unit_label(table.over_units[-1]) else ""
    if line.status[k] == "not visited":
        return (
            f"{line.name}, {table.over[-1]} = {significant(float(line.nodes[k]))}{over}: not visited, so not measured"
        )
    sure = "" if np.isnan(line.low[k]) else f"; 95 % interval {interval(float(line.low[k]), float(line.high[k]))}"
    where = f"{table.over[-1]} = {significant(float(line.nodes[k]))}{over}"
    return f"{line.name}, {where}: {significant(float(line.values[k]))}{unit}{sure} ({line.status[k]})"


def _key(name: str, colour: str, symbol: str) -> dict[str, Any]:
    """An entry of the legend without points."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": [None],
        "y": [None],
        "marker": {"color": colour, "symbol": symbol, "size": 7},
    }


def _range(lines: Sequence[Line]) -> list[float] | None:
    """All values and the intervals of what is determined; wide bars of what is not run out of the figure."""
    known = [v for line in lines for v, s in zip(line.values, line.status, strict=True) if s != "not visited"]
    known += [
        v
        for line in lines
        for ends in (line.low, line.high)
        for v, s in zip(ends, line.status, strict=True)
        if s not in ("flat", "at bound", "not visited")
    ]
    finite = [float(v) for v in known if np.isfinite(v)]
    if not finite:
        return None
    low, high = min(finite), max(finite)
    margin = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return [low - margin, high + margin]
