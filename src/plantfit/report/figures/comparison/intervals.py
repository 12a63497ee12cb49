"""One parameter's intervals by several kinds, and its profile beside histograms of refits and draws."""

from typing import Any

import numpy as np

from plantfit.findings.record import array
from plantfit.findings.results.intervals_compared import IntervalsOfParameter
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import interval, unit_label, with_unit

ROW, TOP, BOTTOM = 26, 16, 46  # pixels
REACH = 20.0  # widths of the narrowest interval that are drawn of wide ones
BARS, CURVE = 60, 80
COLOURS = {"verdict": 0, "covariance": 1, "profile": 2, "bootstrap": 3, "posterior": 4}


def intervals_figure(p: IntervalsOfParameter) -> Figure:
    """Bars of the kinds, one below the other, with the value as a line."""
    rows = [k for k in p.kinds if k.low is not None]
    low, high = _span(p)
    data = []
    for place, k in enumerate(rows):
        y = len(rows) - 1 - place
        ends = [float(np.clip(v, low, high)) for v in k.ends]
        text = f"{k.kind}: {interval(k.low, k.high)} {unit_label(p.unit)}"
        data.append(
            {"type": "scatter", "mode": "lines", "x": ends, "y": [y, y],
             "line": {"width": 8, "color": style.SERIES[COLOURS[k.kind]]},
             "text": [style.plain(text)] * 2, "hovertemplate": "%{text}<extra></extra>"}
        )  # fmt: skip
    layout = style.layout(
        ROW * len(rows) + TOP + BOTTOM, hovermode="closest", margin={"l": 40, "r": 14, "t": TOP, "b": BOTTOM}
    )
    pad = 0.05 * (high - low)
    layout["xaxis"] = style.axis(with_unit(p.name, p.unit), range=[low - pad, high + pad], nticks=7)
    layout["yaxis"] = style.axis(
        range=[-0.7, len(rows) - 0.3], showgrid=False, tickvals=list(range(len(rows)))[::-1],
        ticktext=[k.kind for k in rows],
        tickfont={"size": 12, "color": style.INK}, ticklabelstandoff=6,
    )  # fmt: skip
    layout["shapes"] = [_upright(p.value)]
    return {"data": data, "layout": layout}


def profile_figure(p: IntervalsOfParameter) -> Figure:
    """Growth of the sum of squares over the parameter, with the threshold, beside histograms of refits and draws."""
    low, high = _span(p)
    data: list[dict[str, Any]] = []
    for k in p.kinds:
        colour = style.SERIES[COLOURS[k.kind]]
        if k.sample:
            counts, edges = np.histogram(k.sample, BARS, (low, high))
            data.append(
                {"type": "bar", "name": k.kind, "x": style.numbers(0.5 * (edges[1:] + edges[:-1])),
                 "y": style.numbers(counts / max(counts.max(), 1), 4), "marker": {"color": colour}, "opacity": 0.45,
                 "width": float(edges[1] - edges[0])}
            )  # fmt: skip
        if len(k.points) > 2 and k.threshold:
            x, y = np.asarray(k.points), array(k.excess) / k.threshold
            dense = np.sort(np.r_[x, np.linspace(max(low, x[0]), min(high, x[-1]), CURVE)])
            # linear where y is a parabola
            root = np.interp(dense, x, np.where(x < p.value, -1.0, 1.0) * np.sqrt(np.maximum(y, 0.0)))
            data += [
                {"type": "scatter", "mode": "lines", "name": k.kind, "x": style.numbers(dense),
                 "y": style.numbers(root**2, 4),
                 "line": {"color": colour, "width": 2}},
                {"type": "scatter", "mode": "markers", "showlegend": False, "x": style.numbers(x),
                 "y": style.numbers(y, 4),
                 "marker": {"color": colour, "size": 6}, "name": "refitted"},
            ]  # fmt: skip
    layout = style.layout(264, showlegend=True, barmode="overlay")
    pad = 0.05 * (high - low)
    layout["xaxis"] = style.axis(with_unit(p.name, p.unit), range=[low - pad, high + pad], nticks=7)
    layout["yaxis"] = style.axis("growth over its threshold", range=[0, 2.0])
    threshold = {
        "type": "line",
        "xref": "x domain",
        "x0": 0,
        "x1": 1,
        "y0": 1,
        "y1": 1,
        "line": {"color": style.MUTED, "width": 1, "dash": "dot"},
    }
    layout["shapes"] = [_upright(p.value), threshold]
    return {"data": data, "layout": layout}


def _span(p: IntervalsOfParameter) -> tuple[float, float]:
    """From where to where is drawn: all intervals, of wide ones a few widths of the narrowest."""
    rows = [k for k in p.kinds if k.low is not None]
    least = min((k.width for k in rows), default=0.0) or abs(p.value) or 1.0
    low = max(min([p.value, *(k.ends[0] for k in rows)]), p.value - REACH * least)
    high = min(max([p.value, *(k.ends[1] for k in rows)]), p.value + REACH * least)
    return (float(low), float(high)) if high > low else (p.value - least, p.value + least)


def _upright(value: float) -> dict[str, Any]:
    return {
        "type": "line",
        "yref": "y domain",
        "x0": value,
        "x1": value,
        "y0": 0,
        "y1": 1,
        "line": {"color": style.INK, "width": 1},
    }
