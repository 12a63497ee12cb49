"""Final costs of methods side by side: distributions, means with intervals, sorted runs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.findings.results.methods_compared import MethodRuns, SortedCosts
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

VIOLIN_FROM = 20  # runs from which a density means something
WIDE = 30.0  # ratio of costs from which an axis is logarithmic
CLOSE = 1.5  # ratio of means below which bars from zero would look alike
MARKERS_UP_TO = 60
DASHES = ("solid", "dash", "dot", "dashdot")


def colours(methods: Sequence[str]) -> dict[str, tuple[str, str, str]]:
    """Line colour, band colour and dash of each method."""
    return {m: (style.SERIES[k % 6], style.BANDS[k % 6], DASHES[k // 6 % 4]) for k, m in enumerate(methods)}


def distribution_figure(costs: Mapping[str, Sequence[float]], lines: Mapping[str, float]) -> Figure:
    """Final costs by method: violin (or box, for few runs and for costs over decades) with the runs as points;
    `lines` are named costs drawn across."""
    every = np.concatenate([np.array(own, dtype=float) for own in costs.values()])
    log = _wide(every)
    palette = colours(list(costs))
    layout = style.layout(390, violingap=0.25, boxgap=0.5)
    layout["xaxis"] = style.categories(list(costs))
    layout["yaxis"] = _cost_axis(every)
    layout["shapes"], layout["annotations"] = _across(lines, log)
    return {
        "data": [_distribution(m, np.array(own, dtype=float), palette[m], log) for m, own in costs.items()],
        "layout": layout,
    }


def _distribution(method: str, values: np.ndarray, colour: tuple[str, str, str], log: bool) -> dict[str, Any]:
    name = style.plain(method)
    trace = {
        "name": name,
        "x": [name] * len(values),
        "y": style.numbers(values, 8),
        "fillcolor": colour[1],
        "line": {"color": colour[0], "width": 1.5},
        "marker": {"color": colour[0], "size": 6, "opacity": 0.7},
        "jitter": 0.5,
        "hoverinfo": "y",
    }
    if log or len(values) < VIOLIN_FROM:
        return trace | {"type": "box", "boxpoints": "all", "pointpos": 0}
    shape = {
        "box": {"visible": True, "width": 0.12},
        "spanmode": "hard",
        "scalemode": "width",
        "points": "all",
        "pointpos": 0,
    }
    return trace | shape | {"type": "violin", "width": 0.8, "jitter": 0.3, "hoveron": "points"}


def means_figure(title: str, means: Mapping[str, tuple[float, tuple[float, float]]]) -> Figure:
    """Means with 95 % intervals (not finite where there is none): bars from zero, or points on an own scale where
    bars would look alike."""
    palette = colours(list(means))
    shown = {m: own for m, own in means.items() if np.isfinite(own[0])}
    values = np.array([mean for mean, _ in shown.values()])
    bars = (
        len(values) > 0 and values.min() >= 0 and (values.max() == values.min() or values.max() > CLOSE * values.min())
    )
    data = []
    for m, (mean, interval) in shown.items():
        low, high = interval if np.isfinite(interval[0]) else (mean, mean)
        colour = palette[m][0]
        error = {
            "type": "data",
            "symmetric": False,
            "array": [high - mean],
            "arrayminus": [mean - low],
            "thickness": 1.5,
        }
        hover = f"{style.plain(m)}: %{{y:.6~g}}<extra></extra>"
        base = {"x": [style.plain(m)], "y": style.numbers(np.array([mean])), "hovertemplate": hover}
        if bars:
            look = {
                "type": "bar",
                "marker": {"color": palette[m][1], "line": {"color": colour, "width": 1.5}},
                "width": 0.6,
            }
        else:
            look = {"type": "scatter", "mode": "markers", "marker": {"color": colour, "size": 9}}
        data.append(base | look | {"error_y": error | {"width": 6, "color": style.INK if bars else colour}})
    layout = style.layout(270, annotations=[style.heading(title, 0, 1.02)])
    layout["xaxis"] = style.categories(list(shown), range=[-0.6, len(shown) - 0.4])
    layout["yaxis"] = style.axis(tickformat="~g", nticks=6, **({"rangemode": "tozero"} if bars else {}))
    return {"data": data, "layout": layout}


def sorted_figure(methods: Sequence[MethodRuns]) -> Figure:
    """Final costs of each method, sorted: the share of its runs that ended at or below a cost."""
    palette = colours([m.name for m in methods])
    data = []
    for m in methods:
        colour, _, dash = palette[m.name]
        few = len(_sorted(m).cost) <= MARKERS_UP_TO
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers" if few else "lines",
                "name": style.plain(m.name),
                "x": style.numbers(100 * np.array(_sorted(m).rank), 4),
                "y": style.numbers(np.array(_sorted(m).cost), 8),
                "line": {"color": colour, "width": 2, "dash": dash},
                "marker": {"size": 5},
                "hovertemplate": "%{x:.3~g} % of runs at or below %{y:.6~g}<extra>" + style.plain(m.name) + "</extra>",
            }
        )
    every = np.concatenate([np.array(_sorted(m).cost, dtype=float) for m in methods])
    layout = style.layout(300, showlegend=len(methods) > 1, hovermode="closest")
    layout["xaxis"] = style.axis("runs of the method, best first [%]", range=[0, 101])
    layout["yaxis"] = _cost_axis(every)
    return {"data": data, "layout": layout}


def _sorted(method: MethodRuns) -> SortedCosts:
    return method.sorted or SortedCosts(rank=[], cost=[])


def _wide(costs: np.ndarray) -> bool:
    return len(costs) > 0 and bool(costs.min() > 0 and costs.max() > WIDE * costs.min())


def _cost_axis(costs: np.ndarray) -> dict[str, Any]:
    return style.log_axis("final cost", costs) if _wide(costs) else style.axis("final cost", tickformat="~g")


def _across(lines: Mapping[str, float], log: bool) -> tuple[list[dict], list[dict]]:
    """Horizontal lines at named costs; on a logarithmic axis plotly places shapes by the cost and texts by its
    logarithm."""
    line = {"color": style.WARNING, "width": 1.2, "dash": "dash"}
    shapes = [
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": line} for y in lines.values()
    ]
    base = {"xref": "paper", "x": 1, "xanchor": "right", "yanchor": "bottom", "showarrow": False, "font": style.SMALL}
    return shapes, [
        base | {"text": style.plain(name), "y": float(np.log10(y)) if log else y} for name, y in lines.items()
    ]
