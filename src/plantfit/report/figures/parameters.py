"""Where each parameter lies inside its bounds, how sure that is, and which parameters only act together."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plantfit.findings import Combination, Parameter, Run
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import interval, plus_minus, significant, unit_label

ROW = 50  # pixels
AGREES = 1.01  # a run within 1 % of the lowest cost found the same fit


def interval_figure(parameters: Sequence[Parameter], runs: Sequence[Run]) -> Figure:
    """One row per parameter from its lower to its upper bound, on its own linear or log scale."""
    shown = drawable(parameters)
    rows = {p.name: len(shown) - 1 - k for k, p in enumerate(shown)}
    sure = [(*_clipped(p), rows[p.name]) for p in shown if p.low is not None and p.high is not None]
    wide = [
        (*_reach(p, p.uncertainty.low, p.uncertainty.high), rows[p.name]) for p in shown if p.uncertainty is not None
    ]
    data = [
        _lines("bounds", [(0.0, 1.0, rows[p.name]) for p in shown], style.TRACK, 8, showlegend=False, hoverinfo="skip"),
        *([_lines("95 % interval with stated errors", wide, style.WARNING, 3)] if wide else []),
        _lines("95 % interval" + (" by noise" if wide else ""), sure, style.SIMULATED, 8),
        _values(shown, rows),
        *_runs(shown, runs, rows),
    ]
    layout = style.layout(
        ROW * len(shown) + 80, showlegend=True, hovermode="closest", margin={"l": 40, "r": 14, "t": 62, "b": 10}
    )
    layout["xaxis"] = style.axis(range=[-0.02, 1.02], showgrid=False, showticklabels=False)
    layout["yaxis"] = style.axis(
        range=[-0.7, len(shown) - 0.4],
        showgrid=False,
        tickvals=list(rows.values()),
        ticktext=[style.plain(p.name) for p in shown],
        tickfont={"size": 13, "color": style.INK},
        ticklabelstandoff=6,
    )
    layout["annotations"] = [note for p in shown for note in _bound_labels(p, rows[p.name])]
    return {"data": data, "layout": layout}


def drawable(parameters: Sequence[Parameter]) -> list[Parameter]:
    """Parameters with a value and both bounds; fixed ones have no place to be drawn at."""
    unknown = ("fixed", "not visited")
    return [
        p
        for p in parameters
        if None not in (p.value, p.lower_bound, p.upper_bound) and p.status not in unknown and _width(p) > 0
    ]


def position(parameter: Parameter, value: float) -> float:
    """Place of a value between the bounds, 0 to 1 inside them, on the parameter's scale."""
    low, high = float(parameter.lower_bound or 0), float(parameter.upper_bound or 0)
    if parameter.scale == "log" and low > 0:
        return float("-inf") if value <= 0 else float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low)


def weight_figure(combination: Combination) -> Figure:
    """Bars of the weights with which parameters act together."""
    names, weights = list(combination.weights)[::-1], np.array(list(combination.weights.values())[::-1], dtype=float)
    colours = [style.SIMULATED if w >= 0 else style.INPUT for w in weights]
    reach = 1.1 * max(np.nanmax(np.abs(weights), initial=0.0), 1e-3)
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": style.numbers(weights, 4),
        "y": [style.plain(n) for n in names],
        "marker": {"color": colours},
        "width": 0.55,
        "hovertemplate": "%{y}: %{x:.3f}<extra></extra>",
    }
    layout = style.layout(28 * len(names) + 86, margin={"l": 40, "r": 14, "t": 26, "b": 44})
    layout["xaxis"] = style.axis(
        "weight in the combination", range=[-reach, reach], zeroline=True, zerolinecolor=style.MUTED, nticks=7
    )
    layout["yaxis"] = style.axis(type="category", showgrid=False, tickfont={"size": 13, "color": style.INK})
    return {"data": [bars], "layout": layout}


def _width(p: Parameter) -> float:
    return float(p.upper_bound or 0) - float(p.lower_bound or 0)


def _clipped(p: Parameter) -> tuple[float, float]:
    return _reach(p, p.low, p.high)


def _reach(p: Parameter, low: float | None, high: float | None) -> tuple[float, float]:
    return tuple(float(np.clip(position(p, float(v or 0)), 0, 1)) for v in (low, high))  # pyrefly: ignore[bad-return]


def _lines(name: str, pieces: list[tuple[float, float, int]], colour: str, width: int, **more: Any) -> dict[str, Any]:
    x = [v for low, high, _ in pieces for v in (low, high, None)]
    y = [v for _, _, row in pieces for v in (row, row, None)]
    base = {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": {"color": colour, "width": width}}
    return base | {"hoverinfo": "skip"} | more


def _values(shown: Sequence[Parameter], rows: dict[str, int]) -> dict:
    texts = [
        f"{p.name} = {plus_minus(p.value, p.standard_error)} {unit_label(p.unit)}; 95 % interval "
        f"{interval(p.low, p.high)}"
        for p in shown
    ]
    return {
        "type": "scatter",
        "mode": "markers",
        "name": "value",
        "x": [float(np.clip(position(p, float(p.value or 0)), 0, 1)) for p in shown],
        "y": [rows[p.name] for p in shown],
        "marker": {
            "symbol": "line-ns-open",
            "size": 18,
            "color": [style.WARNING if p.at_bound else style.INK for p in shown],
            "line": {"width": 3},
        },
        "text": [style.plain(text) for text in texts],
        "hovertemplate": "%{text}<extra></extra>",
    }


def _runs(shown: Sequence[Parameter], runs: Sequence[Run], rows: dict[str, int]) -> list[dict]:
    """Every run's value a little above the row, those that reached the lowest cost apart from the others."""
    costs = [r.cost for r in runs if r.cost is not None]
    best = min(costs, default=0.0)
    near = [r for r in runs if r.cost is not None and r.cost <= AGREES * best]
    far = [r for r in runs if r.cost is None or r.cost > AGREES * best]
    looks = [("runs at the lowest cost", near, "circle", 0.36), ("other runs", far, "circle-open", 0.36)]
    return [_dots(name, group, symbol, lift, shown, rows) for name, group, symbol, lift in looks if group]


def _dots(
    name: str, runs: Sequence[Run], symbol: str, lift: float, shown: Sequence[Parameter], rows: dict[str, int]
) -> dict:
    dots = [(p, r, value) for p in shown for r in runs if (value := r.parameters.get(p.name)) is not None]
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": [float(f"{np.clip(position(p, value), 0, 1):.5g}") for p, _, value in dots],
        "y": [rows[p.name] + lift for p, _, _ in dots],
        "marker": {"symbol": symbol, "size": 6, "color": style.RESIDUAL, "opacity": 0.75},
        "text": [
            style.plain(f"{r.method} run {r.run}: {p.name} = {significant(value)} {unit_label(p.unit)}")
            for p, r, value in dots
        ],
        "hovertemplate": "%{text}<extra></extra>",
    }


def _bound_labels(p: Parameter, row: int) -> list[dict]:
    """Both bounds under the ends of the row, the unit and the scale with the upper one."""
    tail = f" {unit_label(p.unit)}" if unit_label(p.unit) else ""
    low, high = (
        significant(p.lower_bound),
        significant(p.upper_bound) + tail + (", log scale" if p.scale == "log" else ""),
    )
    place = {"xref": "x", "yref": "y", "yanchor": "top", "yshift": -5, "font": style.SMALL}
    return [style.heading(low, 0, row, **place), style.heading(high, 1, row, **(place | {"xanchor": "right"}))]
