"""Figures 2 to 8 of the paper with our numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.steam.dynamic_runs import MethodRuns
from plantfit.findings.results.methods_compared import Quartiles
from plantfit.problem.problem import Problem
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.comparison.costs import colours, distribution_figure
from plantfit.report.figures.comparison.curves import quartiles_figure
from plantfit.report.figures.style import Figure
from plantfit.rig.steam_chamber import NODES, OPENINGS, TABLES
from plantfit.study.comparing.profiles import best_costs, grid_of, quartiles

POINTS = 900  # of a drawn signal
SMOOTHED = 21  # samples of the moving mean over errors
UNITS = {"k": "bar/%", "A1": "s", "A2": "s²"}
SCALE = ((0.0, "#10305c"), (0.35, "#2a7a9b"), (0.7, "#7cc4a0"), (1.0, "#f6efb2"))


def box_figure(methods: Sequence[MethodRuns], lines: Mapping[str, float]) -> Figure:
    """Figure 3: final costs of all runs of each method; `lines` are costs drawn across."""
    found = distribution_figure({m.label: np.sort(m.costs).tolist() for m in methods}, lines)
    found["layout"]["yaxis"]["title"]["text"] = "final cost C [bar²]"
    found["layout"]["height"] = 460
    return found


def convergence_figure(methods: Sequence[MethodRuns]) -> Figure:
    """Figure 4: median best cost over evaluations, inside its quartiles."""
    curves = {}
    for m in methods:
        grid = grid_of(m.runs)  # pyrefly: ignore[bad-argument-type]  # a result has what it reads of a record
        low, middle, high = quartiles(best_costs(m.runs, grid))  # pyrefly: ignore[bad-argument-type]
        shown = np.isfinite(high)
        at, low, middle, high = (v[shown].tolist() for v in (grid, low, middle, high))
        curves[m.label] = Quartiles(at=at, low=low, median=middle, high=high)
    found = quartiles_figure(curves, {m.label: len(m.runs) for m in methods}, "evaluations of the cost", "evaluations")
    found["layout"]["yaxis"]["title"]["text"] = "best cost C so far [bar²]"
    found["layout"]["height"] = 400
    return found


def fit_figure(
    problem: Problem, answers: Mapping[str, np.ndarray], name: str, zoom: tuple[float, float] | None = None
) -> Figure:
    """Figure 5: pressure of one opening, measured and by the best answer of each method, whole or in a zoom (s)."""
    recording = problem.experiments[name].recording
    t = recording.t
    part = np.ones(len(t), bool) if zoom is None else (t >= zoom[0]) & (t <= zoom[1])
    data = [
        _line(t[part], recording["y"][part], "measured", {"color": style.MEASURED, "width": 1.0}) | {"opacity": 0.8}
    ]
    palette = colours(list(answers))
    for k, (label, z) in enumerate(answers.items()):
        y = problem.predict(problem.space.physical(z), name)["y"]
        data.append(_line(t[part], y[part], label, {"color": palette[label][0], "dash": _dash(k), "width": 1.6}))
    layout = _layout(330, "time [s]", "pressure [bar]")
    if zoom is not None:
        measured = recording["y"][part]
        layout["yaxis"]["range"] = [float(np.nanmin(measured)) - 0.1, float(np.nanmax(measured)) + 0.1]
    return {"data": data, "layout": layout}


def error_figure(problem: Problem, answers: Mapping[str, np.ndarray]) -> Figure:
    """Figure 6: absolute errors summed over the openings whose record still runs, moving mean over 2 s."""
    palette, data = colours(list(answers)), []
    longest = max((e.recording for e in problem.experiments.values()), key=len)
    for k, (label, z) in enumerate(answers.items()):
        total = np.zeros(len(longest))
        for name, e in problem.experiments.items():
            y = problem.predict(problem.space.physical(z), name)["y"]
            total[1 : len(y)] += np.abs(y - e.recording["y"])[1:]
        shown = np.convolve(total[1:], np.ones(SMOOTHED) / SMOOTHED, mode="valid")
        at = longest.t[1 + SMOOTHED // 2 :][: len(shown)]
        kept = envelope(shown, POINTS)
        data.append(_line(at[kept], shown[kept], label, {"color": palette[label][0], "dash": _dash(k), "width": 1.4}))
    layout = _layout(340, "time [s]", "sum of absolute errors [bar]")
    layout["yaxis"] |= {"type": "log", "dtick": "D2", "tickformat": "~g"}
    ends = sorted({float(e.recording.t[-1]) for e in problem.experiments.values()})[:-1]
    line = {"color": style.MUTED, "width": 0.8, "dash": "dot"}
    layout["shapes"] = [
        {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": x, "x1": x, "line": line} for x in ends
    ]
    return {"data": data, "layout": layout}


def surfaces_figure(tables: Mapping[str, Mapping[str, np.ndarray]], settled: np.ndarray) -> Figure:
    """Figures 2 and 7: k, A1, A2 (opening, node) by who found them, one colour scale for each parameter.

    `settled` (openings,) is the highest pressure (bar) of each record: above that line nothing was measured.
    """
    names, data, notes = list(tables), [], []
    layout = style.layout(640, margin={"l": 62, "r": 70, "t": 40, "b": 50})
    width, height = 1.0 / len(names), 1.0 / len(TABLES)
    for r, parameter in enumerate(TABLES):
        low, high = (f(np.concatenate([tables[n][parameter].ravel() for n in names])) for f in (np.min, np.max))
        for c, name in enumerate(names):
            k = r * len(names) + c + 1
            x, y = f"x{k}" if k > 1 else "x", f"y{k}" if k > 1 else "y"
            bar = {"len": height * 0.86, "y": 1 - (r + 0.46) * height, "thickness": 10, "x": 1.005,
                   "tickfont": style.SMALL, "nticks": 5,
                   "title": {"text": f"{parameter} [{UNITS[parameter]}]", "font": style.SMALL},
                   "outlinewidth": 0}  # fmt: skip
            data.append({
                "type": "heatmap", "z": [style.numbers(row, 4) for row in tables[name][parameter].T],
                "x": list(OPENINGS),
                "y": style.numbers(NODES, 4), "xaxis": x, "yaxis": y, "zmin": float(low), "zmax": float(high),
                "colorscale": SCALE,
                "showscale": c == 0, "colorbar": bar, "hovertemplate":
                f"{parameter} = %{{z}} {UNITS[parameter]} at %{{x}} %, %{{y}} bar<extra>{style.plain(name)}</extra>",
            })  # fmt: skip
            data.append(_line(np.array(OPENINGS, float), settled, "", {"color": "#ffffff", "width": 1.6, "dash": "dot"})
                        | {"xaxis": x, "yaxis": y, "hoverinfo": "skip"})  # fmt: skip
            last, first = r == len(TABLES) - 1, c == 0
            layout[f"xaxis{k if k > 1 else ''}"] = style.axis(
                "opening [%]" if last else "",
                domain=[c * width + 0.008, (c + 1) * width - 0.008],
                anchor=y,
                showticklabels=last,
                range=[5, 105],
            )
            layout[f"yaxis{k if k > 1 else ''}"] = style.axis(
                "pressure [bar]" if first else "", domain=[1 - (r + 1) * height + 0.03, 1 - r * height - 0.01],
                anchor=x,
                showticklabels=first, range=[-1.1, 21.1],
            )  # fmt: skip
            if r == 0:
                notes.append(style.heading(name, c * width + 0.008, 1.0))
    return {"data": data, "layout": layout | {"annotations": notes}}


def delays_figure(
    delays: Mapping[str, np.ndarray], intervals: Mapping[str, tuple[float, float]], truth: np.ndarray
) -> Figure:
    """Figure 8: delays (openings,) in s by method; `intervals` are those of "exact", by opening."""
    palette, data = colours(list(delays)), []
    for k, (label, values) in enumerate(delays.items()):
        shift = 1.1 * (k - (len(delays) - 1) / 2)
        marker = {
            "color": palette[label][0],
            "size": 8,
            "symbol": ("circle", "square", "diamond", "triangle-up", "x", "cross")[k % 6],
        }
        trace: Figure = {
            "type": "scatter", "mode": "markers", "name": style.plain(label), "x": [u + shift for u in OPENINGS],
            "y": style.numbers(np.asarray(values), 5), "marker": marker,
        }  # fmt: skip
        if k == len(delays) - 1 and intervals:
            ends = np.array([intervals[n] for n in intervals])
            trace["error_y"] = {"type": "data", "symmetric": False, "array": style.numbers(ends[:, 1] - values, 4),
                                "arrayminus": style.numbers(values - ends[:, 0], 4), "thickness": 1.5,
                                "width": 4}  # fmt: skip
        data.append(trace)
    data.append({"type": "scatter", "mode": "markers", "name": "truth of the rig", "x": list(OPENINGS),
                 "y": style.numbers(truth, 5),
                 "marker": {"color": style.INK, "size": 22, "symbol": "line-ew-open"}})  # fmt: skip
    layout = _layout(360, "valve opening [%]", "dead time Td [s]")
    layout["xaxis"] |= {"tickvals": list(OPENINGS)}
    return {"data": data, "layout": layout}


def _dash(k: int) -> str:
    return ("solid", "dash", "dot", "dashdot", "longdash")[k % 5]


def _line(x: np.ndarray, y: np.ndarray, name: str, line: Mapping[str, Any]) -> dict[str, Any]:
    kept = envelope(np.asarray(y), POINTS)
    base = {"type": "scatter", "mode": "lines", "name": style.plain(name), "line": dict(line), "showlegend": bool(name)}
    return base | {"x": style.numbers(np.asarray(x)[kept]), "y": style.numbers(np.asarray(y)[kept], 5)}


def _layout(height: int, x: str, y: str) -> dict[str, Any]:
    layout = style.layout(height, showlegend=True)
    layout["xaxis"], layout["yaxis"] = style.axis(x), style.axis(y)
    return layout
