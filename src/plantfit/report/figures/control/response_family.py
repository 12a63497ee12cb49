"""Step responses of several controllers, one panel each: a family of plants as faint lines, one plant on top, the
reference."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

PANEL, GAP, TOP, BOTTOM = 170, 46, 60, 46  # pixels
POINTS = 300


class Panel(NamedTuple):
    """A title, times (N,) in s, the reference (N,), responses of the family (n, N) and the one on top (N,)."""

    title: str
    t: np.ndarray
    reference: np.ndarray
    family: np.ndarray
    on_top: np.ndarray


def response_figure(
    panels: Sequence[Panel], output: str, top: str = "true plant", family: str = "family of models"
) -> Figure:
    """Panels two in a row, their axes around the levels of the reference; `output` names these axes, `top` and
    `family` the lines."""
    rows = -(-len(panels) // 2)
    height = rows * PANEL + (rows - 1) * GAP
    layout = style.layout(height + TOP + BOTTOM, showlegend=True, margin={"l": 56, "r": 14, "t": TOP, "b": BOTTOM})
    data: list[dict[str, Any]] = []
    notes: list[dict[str, Any]] = []
    levels = np.concatenate([p.reference for p in panels])
    room = 0.5 * (float(np.ptp(levels)) or 1.0)  # around the levels; a start far off is cut
    span = [float(levels.min() - room), float(levels.max() + room)]
    layout["legend"] = {**layout["legend"], "y": 1.0 + 20.0 / height}
    for k, panel in enumerate(panels):
        row, column, number = k // 2, k % 2, "" if k == 0 else str(k + 1)
        upper = 1.0 - row * (PANEL + GAP) / height
        left = 0.0 if column == 0 else 0.53
        keep = np.unique(np.linspace(0, len(panel.t) - 1, min(len(panel.t), POINTS)).round().astype(int))
        base = {"type": "scatter", "mode": "lines", "xaxis": "x" + number, "yaxis": "y" + number, "hoverinfo": "skip"}
        faint = _joined(panel.t[keep], panel.family[:, keep])
        first = {"showlegend": k == 0}
        data.append(
            base
            | faint
            | first
            | {"name": style.plain(family), "opacity": 0.45, "line": {"color": style.SERIES[0], "width": 1}}
        )
        line = {"x": style.numbers(panel.t[keep]), "y": style.numbers(panel.on_top[keep]), "hoverinfo": "x+y"}
        data.append(base | line | first | {"name": style.plain(top), "line": {"color": style.SERIES[1], "width": 2}})
        steps = (
            {"x": style.numbers(panel.t), "y": style.numbers(panel.reference)}
            if len(panel.t) <= POINTS
            else _corners(panel)
        )
        look = {"color": style.INK, "width": 1.2, "dash": "dot", "shape": "hv"}
        data.append(base | steps | first | {"name": "reference", "line": look})
        notes.append(style.heading(panel.title, left, upper))
        layout["yaxis" + number] = style.axis(
            output if column == 0 else "",
            domain=[max(0.0, upper - PANEL / height), upper],
            range=span,
            anchor="x" + number,
        )
        last = k >= len(panels) - 2
        layout["xaxis" + number] = style.axis(
            "time [s]" if last else "", domain=[left, left + 0.47], anchor="y" + number
        )
    return {"data": data, "layout": layout | {"annotations": notes}}


def _joined(t: np.ndarray, family: np.ndarray) -> dict[str, Any]:
    """All lines of a family as one trace, parted by gaps."""
    x = np.concatenate([np.r_[t, np.nan] for _ in family])
    y = np.concatenate([np.r_[row, np.nan] for row in family])
    return {"x": style.numbers(x), "y": style.numbers(y, 4)}


def _corners(panel: Panel) -> dict[str, Any]:
    places = np.unique(np.r_[0, np.flatnonzero(np.diff(panel.reference)) + 1, len(panel.t) - 1])
    return {"x": style.numbers(panel.t[places]), "y": style.numbers(panel.reference[places])}
