"""Bode diagram of the open loop over a family of plants, and the root locus of the best fit: two tunings side by
side."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.report.figures import style
from plantfit.report.figures.control.loops import BOTTOM, GAP, PANEL, TOP, Curves, band, panels
from plantfit.report.figures.style import Figure

LOWEST, HIGHEST = 1e-3, 1e3  # of a loop's gain
DAMPING = 0.5  # the line of this damping ratio is drawn into a root locus
TURN = np.linspace(0.0, np.pi, 91)


def bode_figure(found: Mapping[str, Curves], plants: str) -> Figure:
    """Gain and phase of L over frequency."""
    columns, height = panels(len(found)), 2 * PANEL + GAP
    layout = style.layout(height + TOP + BOTTOM, showlegend=True, margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM})
    data, notes, cut = [], [], PANEL / height
    phases = np.concatenate([c["phase"][k] for c in found.values() for k in ("low", "high")])
    lowest = max(-720.0, 90.0 * np.floor(float(np.nanmin(phases)) / 90.0))
    highest = 90.0 * np.ceil(float(np.nanmax(phases)) / 90.0)
    for k, (name, c) in enumerate(found.items()):
        notes.append(style.heading(f"tuned on {name}", columns[k][0], 1.0))
        for row, key in enumerate(("gain", "phase")):
            number = str(2 * k + row + 1) if k or row else ""
            axes = {"xaxis": "x" + number, "yaxis": "y" + number}
            bands = {n: np.clip(v, LOWEST / 10, HIGHEST * 10) for n, v in c[key].items()} if row == 0 else c[key]
            data += band(c["w"], bands, axes, k == 0 and row == 0, plants)
            line = {"x": [float(c["w"][0]), float(c["w"][-1])], "y": [1.0, 1.0] if row == 0 else [-180.0, -180.0]}
            look = {"color": style.INK, "dash": "dot", "width": 1.2}
            told = {"name": "gain 1, phase -180 deg", "showlegend": k == 0 and row == 0, "line": look}
            data.append({"type": "scatter", "mode": "lines", **axes, "hoverinfo": "skip"} | line | told)
            upper = 1.0 - row * (PANEL + GAP) / height
            more: dict[str, Any] = {"domain": [max(0.0, upper - cut), upper], "anchor": "x" + number}
            if row == 0:
                size = style.log_axis("|L|" if k == 0 else "", np.array([LOWEST, HIGHEST]), **more)
                layout["yaxis" + number] = size | {"range": [float(np.log10(LOWEST)), float(np.log10(HIGHEST))]}
            else:
                layout["yaxis" + number] = style.axis(
                    "phase [deg]" if k == 0 else "", range=[lowest, highest], dtick=90, **more
                )
            title = "frequency [rad/s]" if row else ""
            layout["xaxis" + number] = style.log_axis(title, c["w"], domain=list(columns[k]), anchor="y" + number)
    layout["legend"] = {**layout["legend"], "y": 1.0 + 22.0 / height}
    return {"data": data, "layout": layout | {"annotations": notes}}


def locus_figure(found: Mapping[str, Curves]) -> Figure:
    """Poles in the z plane with the unit circle and a line of equal damping; those at the gain that there is stand
    out."""
    columns, height = panels(len(found)), 330
    layout = style.layout(height + TOP + BOTTOM, showlegend=True, margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM})
    data, notes = [], []
    damped = np.exp(-DAMPING / np.sqrt(1.0 - DAMPING**2) * TURN) * np.exp(1j * TURN)
    for k, (name, c) in enumerate(found.items()):
        number = "" if k == 0 else str(k + 1)
        poles = np.asarray(c["locus"])
        middle = len(poles) // 2
        base = {
            "type": "scatter",
            "xaxis": "x" + number,
            "yaxis": "y" + number,
            "hoverinfo": "skip",
            "showlegend": k == 0,
        }
        for values, told, look in (
            (np.exp(2j * TURN), "unit circle", {"color": style.INK, "width": 1.2}),
            (
                np.r_[damped, np.nan, np.conj(damped)],
                f"damping ratio {DAMPING:g}",
                {"color": style.MUTED, "width": 1, "dash": "dot"},
            ),
        ):
            data.append(base | {"mode": "lines", "name": told, "line": look} | _plane(values))
        data.append(base | {"mode": "markers", "name": "gain a tenth to ten times",
                            "marker": {"size": 3, "color": style.SERIES[0]}}
                    | _plane(poles.ravel()))  # fmt: skip
        cross = {
            "size": 9,
            "symbol": "x-thin",
            "color": style.SERIES[1],
            "line": {"color": style.SERIES[1], "width": 2},
        }
        data.append(base | {"mode": "markers", "name": "as it is", "marker": cross} | _plane(poles[middle]))
        notes.append(style.heading(f"tuned on {name}", columns[k][0], 1.0))
        layout["xaxis" + number] = style.axis(
            "real part", domain=list(columns[k]), anchor="y" + number, range=[-1.25, 1.25]
        )
        layout["yaxis" + number] = style.axis(
            "imaginary part" if k == 0 else "",
            anchor="x" + number,
            range=[-1.25, 1.25],
            scaleanchor="x" + number,
            scaleratio=1,
        )
    layout["legend"] = {**layout["legend"], "y": 1.0 + 22.0 / height}
    return {"data": data, "layout": layout | {"annotations": notes}}


def _plane(values: np.ndarray) -> dict[str, Any]:
    near = np.where(np.abs(values) < 2.0, values, np.nan)
    return {"x": style.numbers(np.real(near), 4), "y": style.numbers(np.imag(near), 4)}
