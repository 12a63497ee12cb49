"""How methods went: medians with quartile bands over time, and the share of targets reached."""

from collections.abc import Iterable, Mapping

import numpy as np

from plantfit.findings.results.methods_compared import Quartiles, SharesReached
from plantfit.report.figures import style
from plantfit.report.figures.comparison.costs import colours
from plantfit.report.figures.style import Figure

BAND_OF = 5  # runs from which quartiles mean something


def quartiles_figure(curves: Mapping[str, Quartiles], runs: Mapping[str, int], time: str, unit: str) -> Figure:
    """Median best cost of each method over `time` inside its quartiles, both axes logarithmic."""
    palette = colours(list(curves))
    data = []
    for m, curve in curves.items():
        colour, band, dash = palette[m]
        name = style.plain(m)
        base: Figure = {
            "type": "scatter",
            "mode": "lines",
            "x": style.numbers(np.array(curve.at), 5),
            "legendgroup": name,
            "hoverinfo": "skip",
        }
        edge = base | {"line": {"width": 0}, "showlegend": False}
        if runs[m] >= BAND_OF:
            data.append(edge | {"y": style.numbers(np.array(curve.low))})
            data.append(edge | {"y": style.numbers(np.array(curve.high)), "fill": "tonexty", "fillcolor": band})
        line = {"color": colour, "width": 2.3, "dash": dash}
        hover = f"{name}: median %{{y:.5~g}} after %{{x:.4~g}} {unit}<extra></extra>"
        middle = {"y": style.numbers(np.array(curve.median)), "name": name, "line": line}
        data.append(base | middle | {"hoverinfo": "all", "hovertemplate": hover})
    layout = style.with_legend(style.layout(340, showlegend=len(curves) > 1, hovermode="closest"), list(curves))
    layout["xaxis"] = style.log_axis(time, _all(c.at for c in curves.values()))
    layout["yaxis"] = style.log_axis(
        "best cost so far", _all(values for c in curves.values() for values in (c.low, c.high))
    )
    return {"data": data, "layout": layout}


def ecdf_figure(ecdf: SharesReached, time: str) -> Figure:
    """Share of all (run, target) pairs that were reached by a time."""
    palette = colours(list(ecdf.methods))
    at = np.array(ecdf.at, dtype=float)
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": style.plain(m),
            "x": style.numbers(at, 5),
            "y": style.numbers(100 * np.array(shares), 4),
            "line": {"color": palette[m][0], "width": 2.3, "dash": palette[m][2], "shape": "hv"},
            "hovertemplate": f"{style.plain(m)}: %{{y:.3~g}} % after %{{x:.4~g}}<extra></extra>",
        }
        for m, shares in ecdf.methods.items()
    ]
    layout = style.layout(320, showlegend=len(data) > 1, hovermode="closest")
    layout["xaxis"] = style.log_axis(time, at)
    layout["yaxis"] = style.axis("targets reached [%]", range=[0, 101])
    return {"data": data, "layout": layout}


def _all(values: Iterable[list[float]]) -> np.ndarray:
    return np.concatenate([np.array(v, dtype=float) for v in values] or [np.empty(0)])
