"""How constants settle while a filter runs: value and two standard deviations over time, a panel for each."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

PANEL, GAP, TOP, BOTTOM = 120, 30, 40, 46  # pixels
POINTS = 600


def constants_figure(
    tracks: Sequence[Any],
    references: Mapping[str, tuple[float, float, float]] | None = None,
    label: str = "reference",
    truth: Mapping[str, float] | None = None,
) -> Figure:
    """Tracks (name, unit, t, value, low, high) of `plantfit.estimate`, one under the other on one time axis.

    `references` draw (value, low, high) of another method, by name, as a line and a zone called `label`; `truth` draws
    known values. Where a band spans more than a decade and is positive its axis is logarithmic.
    """
    height = len(tracks) * PANEL + (len(tracks) - 1) * GAP
    data: list[dict] = []
    shapes: list[dict] = []
    notes: list[dict] = []
    layout = style.layout(
        height + TOP + BOTTOM, hovermode="x", margin={"l": 56, "r": 14, "t": TOP, "b": BOTTOM}, showlegend=True
    )
    for k, track in enumerate(tracks):
        number = "" if k == 0 else str(k + 1)
        top = 1.0 - k * (PANEL + GAP) / height
        domain = [max(0.0, top - PANEL / height), top]
        keep = np.unique(np.linspace(0, len(track.t) - 1, min(len(track.t), POINTS)).round().astype(int))
        base = {
            "type": "scatter",
            "mode": "lines",
            "x": style.numbers(track.t[keep], 9),
            "xaxis": "x" + number,
            "yaxis": "y" + number,
        }
        edge = base | {"line": {"width": 0}, "showlegend": False, "hoverinfo": "skip"}
        data.append(edge | {"y": style.numbers(track.low[keep])})
        band = {"fill": "tonexty", "fillcolor": style.BANDS[0], "name": "2 standard deviations", "showlegend": k == 0}
        data.append(edge | band | {"y": style.numbers(track.high[keep])})
        line = {
            "line": {"color": style.SERIES[0], "width": 2},
            "name": "filter",
            "showlegend": k == 0,
            "hovertemplate": "%{y:.5~g}",
        }
        data.append(base | line | {"y": style.numbers(track.value[keep])})
        if references and track.name in references:
            data.append(_reference(base, track, references[track.name][0], label, k == 0))
            shapes.append(_zone(track, references[track.name], number))
        if truth and track.name in truth:
            look = {"line": {"color": style.INK, "width": 1.5, "dash": "dot"}, "name": "truth"}
            data.append(_level(base, track, truth[track.name], look, not any(d.get("name") == "truth" for d in data)))
        notes.append(style.heading(with_unit(track.name, track.unit), 0, top))
        log = np.min(track.low) > 0 and np.max(track.high) > 10 * np.min(track.low)
        scale: dict[str, Any] = {"type": "log", "dtick": 1} if log else {"nticks": 5}
        layout["yaxis" + number] = style.axis(domain=domain, **scale)
        last = k == len(tracks) - 1
        shared = {} if k == 0 else {"matches": "x"}
        layout["xaxis" + number] = style.axis(
            "time [s]" if last else "", anchor="y" + number, showticklabels=last, **shared
        )
    return {"data": data, "layout": layout | {"shapes": shapes, "annotations": notes}}


def _reference(base: dict, track: Any, value: float, label: str, first: bool) -> dict:
    look = {"line": {"color": style.SERIES[1], "width": 1.5, "dash": "dash"}, "name": style.plain(label)}
    return _level(base, track, value, look, first)


def _level(base: dict, track: Any, value: float, look: dict, first: bool) -> dict:
    ends = {"x": style.numbers(np.array([track.t[0], track.t[-1]]), 9), "y": style.numbers(np.array([value, value]))}
    return base | ends | look | {"hoverinfo": "skip", "showlegend": first}


def _zone(track: Any, reference: tuple[float, float, float], number: str) -> dict:
    box = {"x0": float(track.t[0]), "x1": float(track.t[-1]), "y0": float(reference[1]), "y1": float(reference[2])}
    return box | {
        "type": "rect",
        "layer": "below",
        "xref": "x" + number,
        "yref": "y" + number,
        "line": {"width": 0},
        "fillcolor": style.BANDS[1],
    }
