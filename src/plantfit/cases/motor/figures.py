"""Figures of the motor's page."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.report.figures import style
from plantfit.report.figures.style import Figure


def along_figure(constant: np.ndarray, e1: np.ndarray, e2: np.ndarray, truth: float) -> Figure:
    """Root mean squares of both errors along a flat curve, over Kb; the truth marked."""
    data = []
    for k, (name, values) in enumerate((("e1 [rad/s]", e1), ("e2 [V]", e2))):
        base = {"type": "scatter", "mode": "lines", "name": name, "line": {"color": style.SERIES[k], "width": 2}}
        data.append(base | {"x": style.numbers(constant), "y": style.numbers(values)})
    layout = style.layout(300, showlegend=True)
    layout["xaxis"] = style.log_axis("Kb = Kt [V s/rad]", constant)
    layout["yaxis"] = style.log_axis("root mean square of an error", np.concatenate([e1, e2]))
    layout["shapes"] = [{"type": "line", "yref": "paper", "x0": truth, "x1": truth, "y0": 0, "y1": 1,
                         "line": {"color": style.WARNING, "width": 1.2, "dash": "dash"}}]  # fmt: skip
    note = {
        "yref": "paper",
        "y": 0.02,
        "yanchor": "bottom",
        "xanchor": "right",
        "showarrow": False,
        "font": style.SMALL,
        "text": "truth ",
    }
    layout["annotations"] = [note | {"x": float(np.log10(truth))}]
    return {"data": data, "layout": layout}


def ratios_figure(
    names: Sequence[str], clouds: Mapping[str, np.ndarray], points: Mapping[str, np.ndarray], intervals: Any
) -> Figure:
    """Answers over the truth (1 is right) on a log axis: `clouds` (runs, d), `points` (d,), `intervals` low, value,
    high (d,) each."""
    data, places = [], np.arange(len(names))
    for k, (name, many) in enumerate(clouds.items()):
        jitter = 0.12 * np.sin(np.arange(len(many)) * 2.399) + 0.14 * (k - (len(clouds) - 1) / 2) - 0.12
        x = (places[None, :] + jitter[:, None]).ravel()
        data.append(_dots(x, many.ravel(), name, {"color": style.SERIES[k], "size": 5, "opacity": 0.6}))
    for k, (name, one) in enumerate(points.items()):
        data.append(_dots(places, one, name, {"color": style.SERIES[len(clouds) + k], "size": 10, "symbol": "diamond"}))
    low, value, high = intervals
    bars = {
        "type": "data",
        "symmetric": False,
        "array": style.numbers(high - value),
        "arrayminus": style.numbers(value - low),
    }
    seen = _dots(
        places + 0.22, value, "with a current channel, 95 %", {"color": style.INK, "size": 7, "symbol": "square"}
    )
    data.append(seen | {"error_y": bars | {"thickness": 1.5, "width": 5, "color": style.INK}})
    layout = style.layout(380, showlegend=True)
    layout["xaxis"] = style.axis(tickvals=places.tolist(), ticktext=[style.plain(n) for n in names], showgrid=False)
    layout["yaxis"] = style.axis("answer over truth", type="log", tickformat="~g", dtick=1)
    layout["shapes"] = [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1,
                         "line": {"color": style.WARNING, "width": 1.2, "dash": "dash"}}]  # fmt: skip
    return {"data": data, "layout": layout}


def _dots(x: np.ndarray, y: np.ndarray, name: str, marker: dict[str, Any]) -> dict[str, Any]:
    look = {"mode": "markers", "name": style.plain(name), "marker": marker}
    return {"type": "scatter", **look, "x": style.numbers(x, 5), "y": style.numbers(y, 5)}
