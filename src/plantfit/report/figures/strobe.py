"""A mechanism in motion on paper: drawn at several times, the path of its tip, and signals over time beside it."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

ARM, SIGNALS = [0.0, 0.36], [0.45, 1.0]  # shares of the width
GAP = 0.1  # between panels, share of the height
POINTS = 400  # of each line


class Panel(NamedTuple):
    """Signals over time that share an axis: a title with its unit, and values (N,) by name."""

    title: str
    lines: Mapping[str, np.ndarray]


def strobe_figure(
    t: np.ndarray, points: np.ndarray, at: Sequence[float], panels: Sequence[Panel], title: str = ""
) -> Figure:
    """A chain of links, drawn at the times `at` (s), faint to dark, with the path of its tip; `panels` beside it.

    t (N,) in s; points (N, k, 2) in m: x and y of k points along the chain, the last one its tip. A line has the same
    colour in every panel; `title` is that of the drawing.
    """
    t, points = np.asarray(t, dtype=float), np.asarray(points, dtype=float)
    data = [*_links(t, points, at), _path(points)]
    names = list(dict.fromkeys(name for panel in panels for name in panel.lines))
    layout = style.layout(
        460,
        showlegend=len(names) > 1,
        margin={"l": 56, "r": 14, "t": 78, "b": 44},
        hovermode="closest",
        xaxis=style.axis("x [m]", domain=ARM if panels else [0.0, 1.0]),
        yaxis=style.axis("y [m]", scaleanchor="x", scaleratio=1),
    )
    layout["legend"] = layout["legend"] | {"y": 1.06}  # over the panels' titles
    notes = [style.heading(title, ARM[0], 1.0)] if title else []
    height = (1.0 - GAP * (len(panels) - 1)) / max(len(panels), 1)
    for k, panel in enumerate(panels):
        top = 1.0 - k * (height + GAP)
        x, y = f"x{k + 2}", f"y{k + 2}"
        data += [
            _signal(t, values, name, names.index(name), x, y, first=k == _first(panels, name))
            for name, values in panel.lines.items()
        ]
        last = k == len(panels) - 1
        matches = {} if k == 0 else {"matches": "x2"}
        layout[f"xaxis{k + 2}"] = style.axis(
            "time [s]" if last else "", domain=SIGNALS, anchor=y, showticklabels=last, **matches
        )
        layout[f"yaxis{k + 2}"] = style.axis(domain=[max(0.0, top - height), top], anchor=x, nticks=6)
        notes.append(style.heading(panel.title, SIGNALS[0], top))
    return {"data": data, "layout": layout | {"annotations": notes}}


def _links(t: np.ndarray, points: np.ndarray, at: Sequence[float]) -> list[dict[str, Any]]:
    drawn = []
    for k, time in enumerate(at):
        chain = points[int(np.argmin(np.abs(t - time)))]
        drawn.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "x": style.numbers(chain[:, 0], 5),
                "y": style.numbers(chain[:, 1], 5),
                "line": {"color": style.INK, "width": 2.5},
                "marker": {"size": 5, "color": style.INK},
                "opacity": round(0.15 + 0.85 * (k + 1) / len(at), 3),
                "showlegend": False,
                "hovertemplate": f"at {time:.3g} s<extra></extra>",
            }
        )
    return drawn


def _path(points: np.ndarray) -> dict[str, Any]:
    tip = points[:, -1]
    keep = np.union1d(envelope(tip[:, 0], POINTS), envelope(tip[:, 1], POINTS))
    return {
        "type": "scatter",
        "mode": "lines",
        "x": style.numbers(tip[keep, 0], 5),
        "y": style.numbers(tip[keep, 1], 5),
        "line": {"color": style.MUTED, "width": 1, "dash": "dot"},
        "showlegend": False,
        "hoverinfo": "skip",
    }


def _signal(t: np.ndarray, values: np.ndarray, name: str, place: int, x: str, y: str, first: bool) -> dict[str, Any]:
    values = np.asarray(values, dtype=float)
    keep = envelope(values, POINTS)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": style.plain(name),
        "x": style.numbers(t[keep], 6),
        "y": style.numbers(values[keep], 5),
        "xaxis": x,
        "yaxis": y,
        "line": {"color": style.SERIES[place % len(style.SERIES)], "width": 1.5},
        "legendgroup": style.plain(name),
        "showlegend": first,
        "hovertemplate": f"{style.plain(name)}: %{{y:.4~g}}<extra></extra>",
    }


def _first(panels: Sequence[Panel], name: str) -> int:
    """The panel in which a name stands first."""
    return next(k for k, panel in enumerate(panels) if name in panel.lines)
