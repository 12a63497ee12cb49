"""Measured against simulated, residuals under them, inputs below; one time axis for all panels."""

from itertools import pairwise
from typing import Any

import numpy as np

from plantfit.findings import Output, Recording, array
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

OUTPUT_HEIGHT, SMALL_HEIGHT, GAP, TOP, BOTTOM = 190, 84, 34, 58, 46  # pixels
MOST_ZONES = 60  # more pieces than this are too fine to see
MARKERS_UP_TO = 150  # samples that are drawn as points


def fit_figure(recording: Recording, points: int) -> Figure:
    """All signals of one recording; at most about `points` samples of each are drawn."""
    heights = [h for _ in recording.outputs for h in (OUTPUT_HEIGHT, SMALL_HEIGHT)] + [SMALL_HEIGHT] * len(
        recording.inputs
    )
    domains = _domains(heights)
    t = array(recording.t)
    data, shapes, notes = [], [], []
    margin = {"l": 56, "r": 14, "t": TOP, "b": BOTTOM}
    layout = style.layout(
        sum(heights) + GAP * (len(heights) - 1) + TOP + BOTTOM,
        showlegend=True,
        hovermode="x",
        margin=margin,
    )
    panel = 0
    for name, output in recording.outputs.items():
        measured, simulated = array(output.measured), array(output.simulated)
        first = panel == 0
        look, residual = style.dots(measured, style.MEASURED, MARKERS_UP_TO), measured - simulated
        data.append(
            _line(
                "measured", t, measured, panel, points, style.MEASURED, 2.8, showlegend=first, legendgroup="m", **look
            )
        )
        data.append(
            _line("simulated", t, simulated, panel, points, style.SIMULATED, 1.4, showlegend=first, legendgroup="s")
        )
        data.append(
            _line("residual", t, residual, panel + 1, points, style.RESIDUAL, 1, **style.dots(residual, style.RESIDUAL))
        )
        shapes += _zones(t, output, panel, labelled=True) + _zones(t, output, panel + 1, labelled=False)
        notes.append(style.heading(with_unit(name, output.unit), 0, domains[panel][1]))
        notes.append(
            style.heading(with_unit(f"residual of {name}", output.unit), 0, domains[panel + 1][1], font=style.SMALL)
        )
        layout[_axis("yaxis", panel)] = style.axis(domain=domains[panel], nticks=6)
        layout[_axis("yaxis", panel + 1)] = style.axis(
            domain=domains[panel + 1], nticks=4, zeroline=True, zerolinecolor=style.MUTED
        )
        panel += 2
    for name, signal in recording.inputs.items():
        data.append(_line(f"input {name}", t, array(signal.values), panel, points, style.INPUT, 1.2))
        notes.append(style.heading(with_unit(f"input {name}", signal.unit), 0, domains[panel][1], font=style.SMALL))
        layout[_axis("yaxis", panel)] = style.axis(domain=domains[panel], nticks=4)
        panel += 1
    for k in range(panel):
        last = k == panel - 1
        layout[_axis("xaxis", k)] = style.axis(
            ("time [s]" if recording.timed else "row") if last else "",
            anchor=_axis("y", k),
            showticklabels=last,
            **({} if k == 0 else {"matches": "x"}),
        )
    return {"data": data, "layout": layout | {"shapes": shapes, "annotations": notes}}


def zone_count(output: Output) -> int:
    """Pieces of one output that were used alike."""
    return 1 + sum(a != b for a, b in pairwise(output.part)) if output.part else 0


def _domains(heights: list[int]) -> list[list[float]]:
    """Vertical extents from the top down, in paper coordinates."""
    total = sum(heights) + GAP * (len(heights) - 1)
    tops = [total - sum(heights[:k]) - GAP * k for k in range(len(heights))]
    return [[max(0.0, (top - height) / total), top / total] for top, height in zip(tops, heights, strict=True)]


def _line(
    name: str, t: np.ndarray, values: np.ndarray, panel: int, points: int, colour: str, width: float, **more: Any
) -> dict[str, Any]:
    keep = envelope(values, points)
    base = {
        "type": "scatter",
        "mode": "lines",
        "name": style.plain(name),
        "x": style.numbers(t[keep], 9),
        "y": style.numbers(values[keep]),
        "xaxis": _axis("x", panel),
        "yaxis": _axis("y", panel),
        "line": {"color": colour, "width": width},
        "showlegend": False,
        "hovertemplate": "%{y:.5~g}",
    }
    return base | more


def _zones(t: np.ndarray, output: Output, panel: int, labelled: bool) -> list[dict]:
    """Rectangles behind the samples used to fit and those kept for validation."""
    if not output.part or zone_count(output) > MOST_ZONES:
        return []
    part = np.array(output.part)
    starts = np.concatenate([[0], np.flatnonzero(part[1:] != part[:-1]) + 1])
    ends = np.concatenate([starts[1:], [len(t) - 1]])
    span = t[-1] - t[0]
    zones = []
    for start, end in zip(starts, ends, strict=True):
        kind = str(part[start])
        if not kind:
            continue
        zone: Figure = {
            "type": "rect",
            "layer": "below",
            "xref": _axis("x", panel),
            "yref": _axis("y", panel) + " domain",
            "x0": float(t[start]),
            "x1": float(t[end]),
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
            "fillcolor": style.FIT_ZONE if kind == "fit" else style.VALIDATION_ZONE,
        }
        if labelled and t[end] - t[start] > 0.12 * span:
            zone["label"] = {"text": kind, "textposition": "top left", "font": style.SMALL, "padding": 4}
        zones.append(zone)
    return zones


def _axis(stem: str, panel: int) -> str:
    """Plotly's name of a panel's axis: the first one has no number."""
    return stem if panel == 0 else f"{stem}{panel + 1}"
