"""How the search went: best cost against evaluations, and the final costs side by side."""

from collections.abc import Sequence

import numpy as np

from plantfit.findings import Run, array
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

BAND_FROM = 5  # runs of a method from which a median and quartiles mean something
MOST_LINES = 60  # runs drawn one by one
MOST_STEPS = 200  # improvements drawn per run
GRID_POINTS = 80


def convergence_figure(runs: Sequence[Run]) -> Figure:
    """Best cost so far of every run, and per method of 5 runs or more the median inside its quartiles."""
    lines = len(runs) <= MOST_LINES
    data = []
    for k, method in enumerate(methods(runs)):
        own = [r for r in runs if r.method == method and r.history.cost]
        many = len(own) >= BAND_FROM
        colour, band = style.SERIES[k % 6], style.BANDS[k % 6]
        if many:
            data += _quartiles(own, method, colour, band)
        if lines or not many:
            data += [
                _run_line(r, colour, faint=many, legend=not many and j == 0) for j, r in enumerate(own[:MOST_LINES])
            ]
    costs = np.concatenate([array(r.history.cost) for r in runs] or [np.array([])])
    counts = np.concatenate([array(r.history.evaluations) for r in runs] or [np.array([])])
    layout = style.layout(340, showlegend=True, hovermode="closest")
    layout["xaxis"], layout["yaxis"] = style.log_axis("evaluations", counts), style.log_axis("best cost so far", costs)
    return {"data": data, "layout": layout}


def waterfall_figure(runs: Sequence[Run]) -> Figure:
    """Final costs sorted from the lowest; a flat step means that many runs found the same minimum."""
    ended = sorted((r for r in runs if r.cost is not None), key=lambda r: float(r.cost or 0))
    names = methods(runs)
    data = []
    for k, method in enumerate(names):
        places = [(rank, r) for rank, r in enumerate(ended, start=1) if r.method == method]
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": style.plain(method),
                "x": [rank for rank, _ in places],
                "y": style.numbers(np.array([r.cost for _, r in places], dtype=float)),
                "marker": {"size": 8, "color": style.SERIES[k % 6]},
                "text": [style.plain(f"{r.method} run {r.run}") for _, r in places],
                "hovertemplate": "%{text}: %{y:.5~g}<extra></extra>",
            }
        )
    layout = style.layout(260, showlegend=len(names) > 1, hovermode="closest")
    layout["xaxis"] = style.axis(
        "runs, sorted by final cost", tickformat="d", nticks=10, range=[0.5, len(ended) + 0.5], showgrid=False
    )
    layout["yaxis"] = style.log_axis("final cost", np.array([r.cost for r in ended], dtype=float))
    return {"data": data, "layout": layout}


def methods(runs: Sequence[Run]) -> list[str]:
    """Names of the methods in order of appearance."""
    return list(dict.fromkeys(r.method for r in runs))


def cost_at(evaluations: np.ndarray, cost: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Best cost (g,) after `grid` (g,) evaluations: a step function, NaN before the first one, held after the last."""
    place = np.searchsorted(evaluations, grid, side="right") - 1
    return np.where(place < 0, np.nan, cost[np.maximum(place, 0)])


def _quartiles(runs: Sequence[Run], method: str, colour: str, band: str) -> list[dict]:
    histories = [(array(r.history.evaluations), array(r.history.cost)) for r in runs]
    first, last = max(e[0] for e, _ in histories), max(e[-1] for e, _ in histories)
    grid = np.geomspace(max(first, 1.0), max(last, first, 1.0), GRID_POINTS)
    curves = np.stack([cost_at(e, c, grid) for e, c in histories])
    low, middle, high = np.nanquantile(curves, [0.25, 0.5, 0.75], axis=0)
    base = {
        "type": "scatter",
        "mode": "lines",
        "x": style.numbers(grid, 5),
        "legendgroup": style.plain(method),
        "hoverinfo": "skip",
    }
    edge = base | {"line": {"width": 0}, "showlegend": False}
    name = style.plain(f"{method}: median of {len(runs)}, quartiles")
    return [
        edge | {"y": style.numbers(low, 5)},
        edge | {"y": style.numbers(high, 5), "fill": "tonexty", "fillcolor": band},
        base
        | {"y": style.numbers(middle, 5), "name": name, "line": {"color": colour, "width": 2.5}, "hoverinfo": "all"}
        | {"hovertemplate": "%{x:.4~g} evaluations: %{y:.5~g}<extra></extra>"},
    ]


def _run_line(run: Run, colour: str, faint: bool, legend: bool) -> dict:
    evaluations, cost = array(run.history.evaluations), array(run.history.cost)
    keep = np.unique(np.linspace(0, len(cost) - 1, min(len(cost), MOST_STEPS)).astype(int))
    return {
        "type": "scatter",
        "mode": "lines",
        "x": style.numbers(evaluations[keep]),
        "y": style.numbers(cost[keep]),
        "name": style.plain(run.method),
        "legendgroup": style.plain(run.method),
        "showlegend": legend,
        "opacity": 0.4 if faint else 0.9,
        "line": {"color": colour, "width": 1 if faint else 1.8, "shape": "hv"},
        "text": style.plain(f"{run.method} run {run.run}"),
        "hovertemplate": "%{text}: %{x:.4~g} evaluations, %{y:.5~g}<extra></extra>",
    }
