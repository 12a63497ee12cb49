"""Sensitivity of groups of parameters side by side: bars with intervals, or points on a log axis where values span
decades."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

WIDE = 30.0  # ratio of values from which bars from zero would hide the small ones
LOOKS = (*style.SERIES, style.INK, style.MUTED)


def sensitivity_figure(title: str, series: Mapping[str, Mapping[str, tuple[float, float]]]) -> Figure:
    """`series`: label -> group -> (value, half width of its interval); groups on the horizontal axis, a colour for
    each label."""
    groups = list(dict.fromkeys(g for values in series.values() for g in values))
    every = np.array([v for values in series.values() for v, _ in values.values()])
    positive = every[np.isfinite(every) & (every > 0)]
    log = len(positive) == len(every) and len(positive) > 0 and positive.max() > WIDE * positive.min()
    shown = [
        _points(k, n, v, groups, len(series)) if log else _bars(k, n, v) for k, (n, v) in enumerate(series.items())
    ]
    layout = style.layout(330, showlegend=len(series) > 1, barmode="group", bargap=0.35)
    if log:
        ticks = {
            "tickvals": list(range(len(groups))),
            "ticktext": [style.plain(g) for g in groups],
            "range": [-0.5, len(groups) - 0.5],
        }
        layout["xaxis"] = style.axis(showgrid=False, **ticks)
    else:
        layout["xaxis"] = style.axis(type="category")
    layout["yaxis"] = style.log_axis(title, every) if log else style.axis(title, rangemode="tozero")
    return {"data": shown, "layout": layout}


def _bars(k: int, label: str, values: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    height, half = np.array(list(values.values()), dtype=float).reshape(-1, 2).T
    trace = {
        "type": "bar",
        "name": style.plain(label),
        "marker": {"color": LOOKS[k % len(LOOKS)]},
        "hovertemplate": "%{y:.4~g}",
    }
    return trace | {"x": [style.plain(g) for g in values], "y": style.numbers(height), "error_y": _ends(half, half)}


def _points(
    k: int, label: str, values: Mapping[str, tuple[float, float]], groups: list[str], count: int
) -> dict[str, Any]:
    """Points beside each other within a group; an interval that reaches 0 ends where the axis does."""
    height, half = np.array(list(values.values()), dtype=float).reshape(-1, 2).T
    place = np.array([groups.index(g) for g in values]) + 0.5 * ((k + 0.5) / count - 0.5)
    marker = {"color": LOOKS[k % len(LOOKS)], "size": 8}
    trace = {
        "type": "scatter",
        "mode": "markers",
        "name": style.plain(label),
        "marker": marker,
        "hovertemplate": "%{y:.4~g}",
    }
    return trace | {
        "x": style.numbers(place),
        "y": style.numbers(height),
        "error_y": _ends(half, np.minimum(half, 0.9 * height)),
    }


def _ends(up: np.ndarray, down: np.ndarray) -> dict[str, Any]:
    look = {"type": "data", "symmetric": False, "thickness": 1.2, "width": 3}
    return look | {"array": style.numbers(up), "arrayminus": style.numbers(down)}
