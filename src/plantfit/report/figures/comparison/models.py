"""Several models over one measured output: all of them in one panel, the residuals of each below, on one time axis."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plantfit.findings.results.models_compared import ModelSeries
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

TOP_PANEL, PANEL, GAP, TOP, BOTTOM = 260, 96, 30, 64, 46  # pixels
MARKERS_UP_TO = 150  # samples that are drawn as points
REACH = 0.999  # of the residuals that their axes show


def overlay_figure(drawn: ModelSeries, names: Sequence[str], points: int) -> Figure:
    """One series of a comparison; residuals share one scale, so that they can be compared by eye."""
    t, measured = np.array(drawn.t, dtype=float), np.array(drawn.measured, dtype=float)
    simulated = {n: np.array(drawn.simulated[n], dtype=float) for n in names}
    heights = [TOP_PANEL] + [PANEL] * len(names)
    total = sum(heights) + GAP * len(names)
    tops = [total - sum(heights[:k]) - GAP * k for k in range(len(heights))]
    domains = [[max(0.0, (top - height) / total), top / total] for top, height in zip(tops, heights, strict=True)]
    layout = style.layout(
        total + TOP + BOTTOM, showlegend=True, hovermode="x", margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM}
    )
    look = style.dots(measured, style.MEASURED, MARKERS_UP_TO)
    data = [_line("measured", t, measured, 0, points, style.MEASURED, 2.6, showlegend=True, **look)]
    notes = [style.heading(with_unit(drawn.output, drawn.unit), 0, domains[0][1])]
    errors = [np.abs(measured - y) for y in simulated.values()]
    known = np.concatenate([e[np.isfinite(e)] for e in errors]) if errors else np.zeros(0)
    reach = 1.1 * float(np.quantile(known, REACH)) if len(known) and np.any(known > 0) else 1.0
    for k, (name, y) in enumerate(simulated.items()):
        colour = style.SERIES[k % len(style.SERIES)]
        data.append(_line(name, t, y, 0, points, colour, 1.4, showlegend=True))
        data.append(
            _line(f"residual of {name}", t, measured - y, k + 1, points, colour, 1, **style.dots(measured - y, colour))
        )
        text = with_unit(f"residual of {name}", drawn.unit)
        notes.append(style.heading(text, 0, domains[k + 1][1], font=style.SMALL))
        layout[f"yaxis{k + 2}"] = style.axis(
            domain=domains[k + 1], nticks=4, range=[-reach, reach], zeroline=True, zerolinecolor=style.MUTED
        )
    layout["yaxis"] = style.axis(domain=domains[0], nticks=6)
    for k in range(len(heights)):
        last, number = k == len(heights) - 1, str(k + 1) if k else ""
        layout["xaxis" + number] = style.axis(
            ("time [s]" if drawn.timed else "row") if last else "",
            anchor="y" + number,
            showticklabels=last,
            **({} if k == 0 else {"matches": "x"}),
        )
    layout["legend"] = {**layout["legend"], "y": 1.0 + 8.0 / total}
    return {"data": data, "layout": layout | {"shapes": _zones(t, drawn.part, len(heights)), "annotations": notes}}


def _line(
    name: str, t: np.ndarray, values: np.ndarray, panel: int, points: int, colour: str, width: float, **more: Any
) -> dict[str, Any]:
    keep, number = envelope(values, points), str(panel + 1) if panel else ""
    base = {
        "type": "scatter", "mode": "lines", "name": style.plain(name), "x": style.numbers(t[keep], 9),
        "y": style.numbers(values[keep]),
        "xaxis": "x" + number, "yaxis": "y" + number, "line": {"color": colour, "width": width}, "showlegend": False,
        "hovertemplate": "%{y:.5~g}",
    }  # fmt: skip
    return base | more


def _zones(t: np.ndarray, part: Sequence[str], panels: int) -> list[dict[str, Any]]:
    """Shades behind fitted and unseen samples, where they are few pieces."""
    kinds = np.array(part)
    starts = np.concatenate([[0], np.flatnonzero(kinds[1:] != kinds[:-1]) + 1])
    if len(starts) > 60 or len(t) < 2:
        return []
    ends = np.concatenate([starts[1:], [len(t) - 1]])
    zones = []
    for panel in range(panels):
        number = str(panel + 1) if panel else ""
        for start, end in zip(starts, ends, strict=True):
            kind = str(kinds[start])
            if not kind:
                continue
            zone: Figure = {
                "type": "rect", "layer": "below", "xref": "x" + number, "yref": f"y{number} domain",
                "x0": float(t[start]),
                "x1": float(t[end]), "y0": 0, "y1": 1, "line": {"width": 0},
                "fillcolor": style.FIT_ZONE if kind == "fit" else style.VALIDATION_ZONE,
            }  # fmt: skip
            if panel == 0 and t[end] - t[start] > 0.12 * (t[-1] - t[0]):
                text = "fitted" if kind == "fit" else "unseen"
                zone["label"] = {"text": text, "textposition": "top left", "font": style.SMALL, "padding": 4}
            zones.append(zone)
    return zones
