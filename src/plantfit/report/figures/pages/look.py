"""Figures of a first look: frequency response with bands and coherence, step response, cross-correlation."""

from typing import Any

import numpy as np

from plantfit.findings.record import array
from plantfit.findings.results.first_look import InputToOutput
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import unit_label

PANEL, GAP, TOP, BOTTOM = 170, 34, 58, 46  # pixels


def bode_figure(pair: InputToOutput, output: str, unit: str | None) -> Figure:
    """Gain, phase and coherence over frequency, with 95 % bands and the linear model."""
    f = array(pair.f)
    gain, phase, radius = (array(v) for v in (pair.gain, pair.phase, pair.radius))
    low, high = np.maximum(gain - radius, 1e-3 * np.nanmax(gain)), gain + radius
    angle = np.degrees(np.arcsin(np.minimum(radius / np.maximum(gain, 1e-300), 1.0)))
    angle = np.where(radius < gain, angle, 180.0)
    per = f"{unit_label(unit) or '1'}/{unit_label(pair.unit) or '1'}"
    height = 3 * PANEL + 2 * GAP
    layout = style.layout(
        height + TOP + BOTTOM, showlegend=True, hovermode="x", margin={"l": 60, "r": 14, "t": TOP, "b": BOTTOM}
    )
    tops = [height - k * (PANEL + GAP) for k in range(3)]
    domains = [[max(0.0, (t - PANEL) / height), t / height] for t in tops]
    data = [
        *_band(f, gain, low, high, 0, "measured, 95 %", True), _line(f, pair.model_gain, 0, "linear model", True),
        *_band(f, phase, phase - angle, phase + angle, 1, "", False),
        _line(f, _near(pair.model_phase, phase, gain, radius), 1, "", False),
        _line(f, pair.coherence, 2, "", False, style.SERIES[2]),
    ]  # fmt: skip
    names = (f"gain {output}/{pair.input} [{per}]", "phase [degrees]", "coherence")
    layout["yaxis"] = style.log_axis("", np.concatenate([low, high]), domain=domains[0])
    layout["yaxis2"] = style.axis(domain=domains[1], nticks=5, range=_middle(phase, radius < gain))
    layout["yaxis3"] = style.axis(domain=domains[2], nticks=5, range=[0, 1.05])
    for k in range(3):
        number = str(k + 1) if k else ""
        layout["xaxis" + number] = style.log_axis(
            "frequency [Hz]" if k == 2 else "",
            f,
            anchor="y" + number,
            showticklabels=k == 2,
            **({} if k == 0 else {"matches": "x"}),
        )
    notes = [style.heading(n, 0, d[1]) for n, d in zip(names, domains, strict=True)]
    return {"data": data, "layout": layout | {"annotations": notes}}


def step_figure(pair: InputToOutput, output: str, unit: str | None) -> Figure:
    """Answer to a step of one unit of the input, with its 95 % band."""
    t, y, half = (array(v) for v in (pair.step_t, pair.step, pair.step_half))
    layout = style.layout(260, showlegend=True, hovermode="x")
    label = unit_label(unit)
    layout["yaxis"] = style.axis(f"{output} [{label}]" if label else output, zeroline=True, zerolinecolor=style.MUTED)
    layout["xaxis"] = style.axis("time after the step [s]")
    layout["annotations"] = [
        style.heading(f"{output} after a step of {pair.input} by 1 {unit_label(pair.unit)}".rstrip(), 0, 1)
    ]
    return {"data": _band(t, y, y - half, y + half, 0, "linear model, 95 %", True), "layout": layout}


def _band(
    x: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray, panel: int, name: str, shown: bool
) -> list[dict[str, Any]]:
    axes, xs = _axes(panel), style.numbers(x)
    base = {"type": "scatter", "mode": "lines", **axes, "x": xs, "hoverinfo": "skip", "showlegend": False}
    edge = base | {"y": style.numbers(low), "line": {"width": 0}}
    fill = base | {"y": style.numbers(high), "line": {"width": 0}, "fill": "tonexty", "fillcolor": style.BANDS[0]}
    line = {"color": style.SERIES[0], "width": 1.6}
    return [
        edge,
        fill,
        base | {"y": style.numbers(y), "line": line, "name": name, "showlegend": shown, "hoverinfo": "x+y"},
    ]


def _line(x: np.ndarray, y: Any, panel: int, name: str, shown: bool, colour: str = style.SERIES[1]) -> dict[str, Any]:
    values = style.numbers(np.array(y, dtype=float))
    line = {"color": colour, "width": 1.5, "dash": "solid" if panel == 2 else "dash"}
    return {"type": "scatter", "mode": "lines", **_axes(panel), "x": style.numbers(x), "y": values, "line": line,
            "name": name,
            "showlegend": shown, "hoverinfo": "x+y"}  # fmt: skip


def _axes(panel: int) -> dict[str, str]:
    number = str(panel + 1) if panel else ""
    return {"xaxis": "x" + number, "yaxis": "y" + number}


def _near(model: Any, phase: np.ndarray, gain: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """The model's phase in the turn of the measured one, where that is known."""
    values, sure = np.array(model, dtype=float), radius < gain
    off = np.median((phase - values)[sure]) if sure.any() else 0.0
    return values + 360.0 * np.round(off / 360.0)


def _middle(phase: np.ndarray, sure: np.ndarray) -> list[float]:
    """An axis around the phases that are known."""
    own = phase[sure] if sure.any() else phase
    return [float(np.nanmin(own)) - 40.0, float(np.nanmax(own)) + 40.0]
