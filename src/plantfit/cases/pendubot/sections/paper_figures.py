"""Figures 3 to 7 of the paper with our numbers, and the gap of every run to the optimum."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.cases.pendubot.study_runs import CLOSE, MethodRuns
from plantfit.cases.shared.panels import signals_figure as panels_figure
from plantfit.recording.record import Recording
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.comparison.costs import colours, means_figure
from plantfit.report.figures.style import Figure
from plantfit.space import Space
from plantfit.study.comparing.statistics import normal_interval

POINTS = 1200  # of a drawn signal
ZOOM = (5.0, 6.6)  # s, as in the paper's figure 5
ANSWERS = 250  # runs of a method whose answers are drawn, at even distances: a thousand are no denser to the eye
SMALLEST = 1e-9  # gap below which runs are drawn at it


def trajectory_figure(recording: Recording) -> Figure:
    """The recorded angles over time beside their references (figure 3 shows the poses as drawings)."""
    data = []
    for name, colour in (("theta1", style.SERIES[0]), ("theta2", style.SERIES[1])):
        for signal, dash, label in ((f"{name}_ref", "dash", f"{name}, reference"), (name, "solid", f"{name}, encoder")):
            data.append(_line(recording.t, np.degrees(recording[signal]), label, colour, dash))
    return {"data": data, "layout": _time_layout(300, "angle [deg]")}


def signals_figure(recording: Recording) -> Figure:
    """Figure 4: angle, rate, acceleration and torque over time."""
    rows = (
        ("theta", "angle [rad]"),
        ("omega", "rate [rad/s]"),
        ("alpha", "acceleration [rad/s^2]"),
        ("tau", "torque [N m]"),
    )
    data, layout = [], style.layout(640, showlegend=True)
    for k, (kind, title) in enumerate(rows):
        low = 1 - (k + 1) / len(rows) + 0.02
        layout[f"yaxis{k + 1 if k else ''}"] = style.axis(title, domain=[low, low + 0.2])
        for joint in (1, 2):
            name = f"{kind}{joint}"
            if name in recording.signals:
                line = _line(recording.t, recording[name], f"joint {joint}", style.SERIES[joint - 1])
                data.append(line | {"yaxis": f"y{k + 1 if k else ''}", "showlegend": k == 0})
    layout["xaxis"] = style.axis("time [s]", anchor="y4")
    return {"data": data, "layout": layout}


def overlay_figure(
    recording: Recording, torques: Mapping[str, np.ndarray], zoom: tuple[float, float] | None = None
) -> Figure:
    """Figure 5: the torque measured and by the best parameters of every method, over all time or in a zoom (s)."""
    t = recording.t
    part = np.ones(len(t), bool) if zoom is None else (t >= zoom[0]) & (t <= zoom[1])
    data = [_line(t[part], recording["tau1"][part], "measured", style.MEASURED) | {"opacity": 0.55}]
    palette = colours(list(torques))
    for name, torque in torques.items():
        data.append(
            _line(t[part], torque[part], name, palette[name][0], ("solid", "dash", "dot", "dashdot")[len(data) % 4])
        )
    headings = [] if zoom is None else [style.heading(f"{zoom[0]:g} to {zoom[1]:g} s", 0, 1.02)]
    return {"data": data, "layout": _time_layout(320, "torque of joint 1 [N m]", headings)}


def residual_figure(
    recording: Recording, torques: Mapping[str, np.ndarray], against: str, zoom: tuple[float, float]
) -> Figure:
    """In a zoom (s): the measured torque less that named `against`, and below every other one less it."""
    part, palette = (recording.t >= zoom[0]) & (recording.t <= zoom[1]), colours(list(torques))
    base = torques[against][part]
    others = {n: (torque[part] - base, palette[n][0], 1.4) for n, torque in torques.items() if n != against}
    measured = {f"measured less {against}": (recording["tau1"][part] - base, style.MEASURED, 1.0)}
    return panels_figure(recording.t[part], [("torque [N m]", measured), (f"less {against} [N m]", others)])


def bars_figure(title: str, values: Mapping[str, np.ndarray]) -> Figure:
    """Figures 6 and 7: means with their 95 % intervals, mean +- 1.96 SEM."""
    return means_figure(title, {n: (float(np.mean(v)), normal_interval(v)) for n, v in values.items()})


def parameters_figure(runs: Sequence[MethodRuns], space: Space, truth: Mapping[str, float]) -> Figure:
    """Answers as shares of the bounds, `ANSWERS` runs of a method at most, the best of each and the truth marked."""
    names, lower, upper = space.names, space.lower, space.upper
    palette, data = colours([r.label for r in runs]), []
    for k, r in enumerate(runs):
        share = (r.answers - lower) / (upper - lower)
        drawn = share[:: max(1, -(-len(share) // ANSWERS))]
        place = np.arange(len(names)) + 0.22 * (k - (len(runs) - 1) / 2)
        jitter = 0.07 * np.sin(np.arange(len(drawn)) * 2.399)  # even, and the same each time
        x = (place[None, :] + jitter[:, None]).ravel()
        colour = palette[r.label][0]
        data.append(_dots(x, drawn.ravel(), style.plain(r.label), {"color": colour, "size": 5, "opacity": 0.5}))
        best = {"color": colour, "size": 10, "symbol": "diamond", "line": {"color": style.INK, "width": 1}}
        data.append(_dots(place, share[r.best], f"{style.plain(r.label)}, best run", best))
    true = (np.array([truth[n] for n in names]) - lower) / (upper - lower)
    data.append(
        _dots(
            np.arange(len(names)), true, "truth of the rig", {"color": style.INK, "size": 22, "symbol": "line-ew-open"}
        )
    )
    layout = style.layout(380, showlegend=True)
    layout["xaxis"] = style.axis(tickvals=list(range(len(names))), ticktext=[style.plain(n) for n in names])
    layout["yaxis"] = style.axis("share of the way from the lower to the upper bound", range=[-0.03, 1.03])
    return {"data": data, "layout": layout}


def gap_figure(runs: Sequence[MethodRuns]) -> Figure:
    """The gaps of every method, sorted: the share of its runs that ended at or below."""
    palette, data = colours([r.label for r in runs]), []
    for r in runs:
        y = np.sort(np.maximum(r.gap, SMALLEST))
        x = 100 * np.arange(1, len(y) + 1) / len(y)
        shown = np.unique(np.linspace(0, len(y) - 1, min(len(y), 200)).astype(int))
        line = {"color": palette[r.label][0], "dash": palette[r.label][2], "width": 2}
        data.append({"type": "scatter", "mode": "lines", "name": style.plain(r.label), "x": style.numbers(x[shown], 4)}
                    | {"y": style.numbers(y[shown]), "line": line})  # fmt: skip
    layout = style.layout(320, showlegend=True)
    layout["xaxis"] = style.axis("runs of the method, best first [%]", range=[0, 101])
    layout["yaxis"] = style.axis("relative gap of the RMSE to the optimum", type="log", exponentformat="power")
    layout["shapes"] = [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": CLOSE, "y1": CLOSE,
                         "line": {"color": style.WARNING, "width": 1.2, "dash": "dash"}}]  # fmt: skip
    return {"data": data, "layout": layout}


def _line(t: np.ndarray, y: np.ndarray, name: str, colour: str, dash: str = "solid") -> dict[str, Any]:
    kept = envelope(y, POINTS)
    look = {"color": colour, "width": 1.4, "dash": dash}
    base = {"type": "scatter", "mode": "lines", "name": style.plain(name), "line": look}
    return base | {"x": style.numbers(t[kept]), "y": style.numbers(y[kept], 5)}


def _dots(x: np.ndarray, y: np.ndarray, name: str, marker: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "marker": marker,
        "x": style.numbers(x, 5),
        "y": style.numbers(y, 5),
    }


def _time_layout(height: int, title: str, annotations: Sequence[dict[str, Any]] = ()) -> dict[str, Any]:
    layout = style.layout(height, showlegend=True, annotations=list(annotations))
    layout["xaxis"], layout["yaxis"] = style.axis("time [s]"), style.axis(title)
    return layout
