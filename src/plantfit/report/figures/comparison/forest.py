"""One parameter in several recordings: values and intervals, one below the other, and the joint one."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from plantfit.findings.heterogeneity import EstimatedAlone, SharedParameter
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import interval, plus_minus, unit_label, with_unit

ROW, TOP, BOTTOM = 26, 34, 46  # pixels
ALL = "all together"
REACH = 6.0  # widths of the determined intervals that are drawn of those that are not


def forest_figure(p: SharedParameter, apart: Collection[str] = ()) -> Figure:
    """A parameter of a comparison of recordings; recordings `apart` have another colour."""
    rows = [*p.alone, EstimatedAlone(**dict(p.joint), recording=ALL, tested=True)]
    rows = [r for r in rows if r.value is not None]
    heights = {r.recording: len(rows) - 1 - k for k, r in enumerate(rows)}
    low, high = _span(rows)
    log = p.scale == "log" and low > 0 and high / low > 20.0
    data = []
    for r in rows:
        value = r.value or 0.0
        colour = style.INK if r.recording == ALL else style.WARNING if r.recording in apart else style.SIMULATED
        a, b = (r.low, r.high) if r.low is not None and r.high is not None else (value, value)
        a, b = (float(np.clip(v, low, high)) for v in (a, b))
        text = (
            f"{r.recording}: {plus_minus(r.value, r.standard_error)} {unit_label(p.unit)}; 95 % "
            f"{interval(r.low, r.high)}"
        )
        data.append(_line([a, b], heights[r.recording], colour, 6 if r.tested else 2, None if r.tested else "dot"))
        data.append(_value(float(np.clip(value, low, high)), heights[r.recording], colour, r, text))
    layout = style.layout(
        ROW * len(rows) + TOP + BOTTOM,
        showlegend=False,
        hovermode="closest",
        margin={"l": 40, "r": 14, "t": TOP, "b": BOTTOM},
    )
    told = "" if p.p_adjusted is None else f", p {p.p_adjusted:.2g}"
    pad = 0.04 * (np.log10(high / low) if log else high - low)
    ends = [np.log10(low) - pad, np.log10(high) + pad] if log else [low - pad, high + pad]
    layout["xaxis"] = style.axis(
        with_unit(p.name, p.unit) + told, range=[float(e) for e in ends], type="log" if log else "linear", nticks=7
    )
    layout["yaxis"] = style.axis(
        range=[-0.7, len(rows) - 0.3], showgrid=False, tickvals=list(heights.values()),
        ticktext=[style.plain(n) for n in heights],
        tickfont={"size": 12, "color": style.INK}, ticklabelstandoff=6,
    )  # fmt: skip
    joint = p.joint
    if joint.low is not None and joint.high is not None:
        a, b = (float(np.clip(v, low, high)) for v in (joint.low, joint.high))
        band = {
            "type": "rect",
            "layer": "below",
            "xref": "x",
            "yref": "y domain",
            "x0": a,
            "x1": b,
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
        }
        layout["shapes"] = [{**band, "fillcolor": style.FIT_ZONE}]
    return {"data": data, "layout": layout}


def _span(rows: Sequence[EstimatedAlone]) -> tuple[float, float]:
    """From where to where is drawn: the intervals that the data set, and values; of open ones no more than some
    widths."""
    sure = [r for r in rows if r.tested and r.low is not None and r.high is not None]
    ends = [v for r in sure for v in (r.low, r.high) if v is not None] + [
        r.value for r in rows if r.tested and r.value is not None
    ]
    values = [r.value for r in rows if r.value is not None]
    low, high = float(min(ends or values)), float(max(ends or values))
    width = (high - low) or abs(high) or 1.0
    for r in rows:
        for v in (r.low, r.high, r.value):
            if v is not None:
                low, high = max(min(low, v), low - REACH * width), min(max(high, v), high + REACH * width)
    return (low, high) if high > low else (low - 0.5 * width, high + 0.5 * width)


def _line(x: Sequence[float], y: int, colour: str, width: int, dash: str | None) -> dict[str, Any]:
    line = {"color": colour, "width": width} | ({} if dash is None else {"dash": dash})
    return {
        "type": "scatter",
        "mode": "lines",
        "x": style.numbers(np.array(x)),
        "y": [y, y],
        "line": line,
        "opacity": 0.55,
        "hoverinfo": "skip",
    }


def _value(x: float, y: int, colour: str, r: EstimatedAlone, text: str) -> dict[str, Any]:
    symbol = "diamond" if r.recording == ALL else "circle" if r.tested else "circle-open"
    return {
        "type": "scatter", "mode": "markers", "x": style.numbers(np.array([x])), "y": [y],
        "marker": {"symbol": symbol, "size": 10, "color": colour},
        "text": [style.plain(text)], "hovertemplate": "%{text}<extra></extra>",
    }  # fmt: skip
