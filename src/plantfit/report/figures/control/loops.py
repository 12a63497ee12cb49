"""Loops of a family of plants: responses, inputs, sensitivities and Nyquist curves of two tunings side by side."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.findings.results.tuned_controller import LoopWishes
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

PANEL, GAP, TOP, BOTTOM = 230, 50, 66, 46  # pixels
WIDEST = 6.0  # steps from the set point that a figure of responses shows at most, but for bands
Curves = Mapping[str, Any]


def panels(count: int) -> list[tuple[float, float]]:
    """Where so many columns lie, from 0 to 1."""
    width = (1.0 - 0.06 * (count - 1)) / count
    return [(k * (width + 0.06), k * (width + 0.06) + width) for k in range(count)]


def band(
    x: np.ndarray, bands: Mapping[str, np.ndarray], axes: Mapping[str, str], first: bool, plants: str
) -> list[dict[str, Any]]:
    """The 5 to 95 % band, its middle and the best fit."""
    xs, base = style.numbers(x), {"type": "scatter", "mode": "lines", **axes, "hoverinfo": "skip"}
    edge = base | {"x": xs, "y": style.numbers(bands["low"]), "line": {"width": 0}, "showlegend": False}
    fill = base | {
        "x": xs,
        "y": style.numbers(bands["high"]),
        "line": {"width": 0},
        "fill": "tonexty",
        "fillcolor": style.BANDS[0],
    }
    middle = base | {
        "x": xs,
        "y": style.numbers(bands["middle"]),
        "line": {"color": style.SERIES[0], "width": 1.6},
        "hoverinfo": "x+y",
    }
    best = base | {
        "x": xs,
        "y": style.numbers(bands["best"]),
        "line": {"color": style.SERIES[1], "width": 1.6, "dash": "dash"},
    }
    named = ((fill, f"90 % of {plants}"), (middle, "their median"), (best | {"hoverinfo": "x+y"}, "best fit"))
    return [edge, *(trace | {"name": name, "showlegend": first} for trace, name in named)]


def _span(bands: list[Mapping[str, np.ndarray]]) -> list[float]:
    """An axis around bands."""
    ends = np.concatenate([b[k] for b in bands for k in ("low", "high", "best")])
    low, high = float(np.nanmin(ends)), float(np.nanmax(ends))
    room = 0.06 * (high - low or 1.0)
    return [low - room, high + room]


def loop_figure(found: Mapping[str, Curves], wishes: LoopWishes, output: str, input_: str, plants: str) -> Figure:
    """Output and input after a step of the set point, then of load: one column for each tuning."""
    columns, height = panels(len(found)), 2 * PANEL + GAP
    layout = style.layout(height + TOP + BOTTOM, showlegend=True, margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM})
    data, notes = [], []
    cut = PANEL / height
    start, level = wishes.set_point - wishes.step, wishes.set_point
    room = 0.5 * abs(wishes.step)
    seen = [c["y"][k] for c in found.values() for k in ("low", "high")]
    low, high = (float(f([np.nanquantile(v, q) for v in seen])) for f, q in ((min, 0.0), (max, 1.0)))
    # seen whole, if it stays near
    inner = np.concatenate([c["y"][k] for c in found.values() for k in ("middle", "best")])
    near = inner[np.isfinite(inner) & (np.abs(inner - level) < WIDEST * abs(wishes.step))]
    ends = [max(low, min(start, level) - 2 * room), min(high, max(start, level) + 2 * room)]
    span = [min([ends[0], *near]) - 0.1 * room, max([ends[1], *near]) + 0.2 * room]
    for k, (name, c) in enumerate(found.items()):
        for row, (key, unit) in enumerate((("y", output), ("u", input_))):
            number = str(2 * k + row + 1) if k or row else ""
            axes = {"xaxis": "x" + number, "yaxis": "y" + number}
            data += band(c["t"], c[key], axes, k == 0 and row == 0, plants)
            if row == 0:
                line = {"color": style.INK, "width": 1.2, "dash": "dot"}
                steps = {
                    "x": [0.0, float(c["t"][-1])],
                    "y": [level, level],
                    "line": line,
                    "name": "set point",
                    "showlegend": k == 0,
                }
                data.append({"type": "scatter", "mode": "lines", **axes, "hoverinfo": "skip"} | steps)
                notes.append(style.heading(f"tuned on {name}", columns[k][0], 1.0))
            upper = 1.0 - row * (PANEL + GAP) / height
            more: dict[str, Any] = {"range": span if row == 0 else _span([o["u"] for o in found.values()])}
            if k:
                more["showticklabels"] = False
            layout["yaxis" + number] = style.axis(
                unit if k == 0 else "", domain=[max(0.0, upper - cut), upper], anchor="x" + number, **more
            )
            layout["xaxis" + number] = style.axis(
                "time [s]" if row else "", domain=list(columns[k]), anchor="y" + number
            )
    layout["legend"] = {**layout["legend"], "y": 1.0 + 22.0 / height}
    return {"data": data, "layout": layout | {"annotations": notes}}


def sensitivity_figure(found: Mapping[str, Curves], ms: float, plants: str) -> Figure:
    """|S| over frequency with the limit that was asked for."""
    columns = panels(len(found))
    layout = style.layout(PANEL + TOP + BOTTOM, showlegend=True, margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM})
    data, notes = [], []
    highest = max([ms, *(float(np.nanmax(c["sensitivity"]["high"])) for c in found.values())])
    for k, (name, c) in enumerate(found.items()):
        number = "" if k == 0 else str(k + 1)
        axes = {"xaxis": "x" + number, "yaxis": "y" + number}
        data += band(c["w"], c["sensitivity"], axes, k == 0, plants)
        ends = [float(c["w"][0]), float(c["w"][-1])]
        limit = {
            "x": ends,
            "y": [ms, ms],
            "name": f"Ms = {ms:g}",
            "showlegend": k == 0,
            "line": {"color": style.INK, "dash": "dot", "width": 1.2},
        }
        data.append({"type": "scatter", "mode": "lines", **axes, "hoverinfo": "skip"} | limit)
        notes.append(style.heading(f"tuned on {name}", columns[k][0], 1.0))
        top = min(1.15 * highest, 4.0 * ms)
        layout["yaxis" + number] = style.axis("|S|" if k == 0 else "", anchor="x" + number, range=[0.0, top])
        layout["xaxis" + number] = style.log_axis(
            "frequency [rad/s]", c["w"], domain=list(columns[k]), anchor="y" + number
        )
    layout["legend"] = {**layout["legend"], "y": 1.0 + 22.0 / PANEL}
    return {"data": data, "layout": layout | {"annotations": notes}}


def nyquist_figure(found: Mapping[str, Curves], ms: float) -> Figure:
    """Open loops near -1 with the circle in which none may come: its radius is 1/Ms."""
    columns, height = panels(len(found)), 330
    layout = style.layout(height + TOP + BOTTOM, showlegend=True, margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM})
    data, notes = [], []
    for k, (name, c) in enumerate(found.items()):
        number = "" if k == 0 else str(k + 1)
        base = {"type": "scatter", "mode": "lines", "xaxis": "x" + number, "yaxis": "y" + number, "hoverinfo": "skip"}
        near = [np.where((abs(z.real) < 4) & (abs(z.imag) < 4), z, np.nan) for z in c["nyquist"]]
        first = [style.numbers(part(near[0]), 4) for part in (np.real, np.imag)]
        x, y = (np.concatenate([np.r_[v, np.nan] for v in (part(z) for z in near)]) for part in (np.real, np.imag))
        lines = {
            "x": style.numbers(x, 4),
            "y": style.numbers(y, 4),
            "opacity": 0.5,
            "line": {"color": style.SERIES[0], "width": 1},
        }
        data.append(base | lines | {"name": "L of some of the plants", "showlegend": k == 0})
        best = {"x": first[0], "y": first[1], "line": {"color": style.SERIES[1], "width": 1.8}}
        data.append(base | best | {"name": "best fit", "showlegend": k == 0})
        turn = np.linspace(0, 2 * np.pi, 121)
        circle = {"x": style.numbers(-1 + np.cos(turn) / ms), "y": style.numbers(np.sin(turn) / ms)}
        data.append(
            base
            | circle
            | {"line": {"color": style.INK, "dash": "dot", "width": 1.2}, "name": f"Ms = {ms:g}", "showlegend": k == 0}
        )
        data.append(
            base
            | {
                "mode": "markers",
                "x": [-1],
                "y": [0],
                "marker": {"color": style.INK, "size": 5},
                "name": "-1",
                "showlegend": False,
            }
        )
        notes.append(style.heading(f"tuned on {name}", columns[k][0], 1.0))
        layout["xaxis" + number] = style.axis(
            "real part", domain=list(columns[k]), anchor="y" + number, range=[-2.4, 0.8]
        )
        layout["yaxis" + number] = style.axis(
            "imaginary part" if k == 0 else "",
            anchor="x" + number,
            range=[-2.0, 0.8],
            scaleanchor="x" + number,
            scaleratio=1,
        )
    layout["legend"] = {**layout["legend"], "y": 1.0 + 22.0 / height}
    return {"data": data, "layout": layout | {"annotations": notes}}
