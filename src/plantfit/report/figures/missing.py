"""What additions to a model explain, and what they leave of the residual."""

from collections.abc import Mapping, Sequence

import numpy as np

from plantfit.findings import ResidualChange, Round, array
from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import percent, with_unit

MOST_BARS = 15
PANEL, GAP, TOP, BOTTOM = 150, 40, 58, 46  # pixels


def share_figure(first: Round, unmeasured: Mapping[str, float] | None = None) -> Figure:
    """A bar for each addition of a round: its share of the mean square, the largest on top; those that were named
    stand out, and above them stands what was `unmeasured`, by name its share."""
    above = unmeasured or {}
    every = [*above.items(), *((t.name, t.explained or 0.0) for t in first.tried[:MOST_BARS])][::-1]
    names, shares = [name for name, _ in every], np.array([100.0 * share for _, share in every])
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": style.numbers(shares, 4),
        "y": [style.plain(name) for name in names],
        "marker": {"color": [style.WARNING if n in above or n in first.found else style.SIMULATED for n in names]},
        "width": 0.62,
        "text": [percent(v / 100.0) if v >= 1 else "< 1 %" for v in shares],
        "textposition": "outside",
        "textfont": style.SMALL,
        "cliponaxis": False,
        "hovertemplate": "%{y}: %{x:.1f} %<extra></extra>",
    }
    layout = style.layout(24 * len(names) + 86, margin={"l": 40, "r": 46, "t": 26, "b": 44})
    layout["xaxis"] = style.axis("share of the mean square that is left [%]", range=[0, 100], nticks=6)
    layout["yaxis"] = style.axis(type="category", showgrid=False, tickfont={"size": 13, "color": style.INK})
    return {"data": [bars], "layout": layout}


def residual_change_figure(series: Sequence[ResidualChange], points: int) -> Figure:
    """Residuals over time with the model as it is and with an addition, one panel for each output of a recording."""
    height = PANEL * len(series) + GAP * (len(series) - 1)
    layout = style.layout(
        height + TOP + BOTTOM, showlegend=True, hovermode="x", margin={"l": 56, "r": 14, "t": TOP, "b": BOTTOM}
    )
    data, notes = [], []
    for k, one in enumerate(series):
        top = (height - k * (PANEL + GAP)) / height
        axis = "" if k == 0 else str(k + 1)
        for name, values, colour, width in (
            ("as it is", one.before, style.MEASURED, 1.4),
            ("with it", one.after, style.SIMULATED, 1.2),
        ):
            data.append(_line(name, array(one.t), array(values), axis, colour, width, points, k == 0))
        title = f"residual of {one.output}" + (f" in {one.recording}" if len(series) > 1 else "")
        notes.append(style.heading(with_unit(title, one.unit), 0, top, font=style.SMALL))
        layout[f"yaxis{axis}"] = style.axis(
            domain=[max(0.0, top - PANEL / height), top], nticks=5, zeroline=True, zerolinecolor=style.MUTED
        )
        layout[f"xaxis{axis}"] = style.axis(
            ("time [s]" if one.timed else "row") if k == len(series) - 1 else "", anchor=f"y{axis}"
        )
    return {"data": data, "layout": layout | {"annotations": notes}}


def _line(
    name: str, t: np.ndarray, values: np.ndarray, axis: str, colour: str, width: float, points: int, legend: bool
) -> dict:
    keep = envelope(values, points)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": style.numbers(t[keep], 9),
        "y": style.numbers(values[keep]),
        "xaxis": f"x{axis}",
        "yaxis": f"y{axis}",
        "line": {"color": colour, "width": width},
        "showlegend": legend,
        "legendgroup": name,
        "hovertemplate": "%{y:.5~g}",
    }
