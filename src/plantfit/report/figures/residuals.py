"""Correlations of the residuals as stems inside their 95 % bounds."""

import numpy as np

from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

MOST_STEMS = 400


def stem_figure(lags_s: np.ndarray, values: np.ndarray, bound: float | None, title: str, timed: bool = True) -> Figure:
    """Correlation `values` (k,) over `lags_s` (k,) in seconds, or in rows that are not `timed`; stems outside the bound
    are marked."""
    keep = envelope(values, MOST_STEMS)
    lags, values = lags_s[keep], values[keep]
    outside = np.abs(values) > (np.inf if bound is None else bound)
    data = [
        _stems(lags[~outside], values[~outside], style.SIMULATED, timed),
        _stems(lags[outside], values[outside], style.WARNING, timed),
    ]
    reach = max(1.15 * np.nanmax(np.abs(values), initial=0.0), 1.6 * (bound or 0.0), 1e-3)
    layout = style.layout(210, hovermode="closest", margin={"l": 48, "r": 10, "t": 28, "b": 42})
    layout["xaxis"] = style.axis("lag [s]" if timed else "lag [rows]", nticks=7)
    layout["yaxis"] = style.axis(range=[-reach, reach], nticks=5, zeroline=True, zerolinecolor=style.MUTED)
    layout["annotations"] = [style.heading(title, 0, 1)]
    layout["shapes"] = [] if bound is None else [_band(bound)]
    return {"data": data, "layout": layout}


def _stems(lags: np.ndarray, values: np.ndarray, colour: str, timed: bool) -> dict:
    nothing = np.full(len(lags), np.nan)
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": style.numbers(np.stack([lags, lags, nothing], axis=1).ravel()),
        "y": style.numbers(np.stack([0 * values, values, nothing], axis=1).ravel(), 4),
        "line": {"color": colour, "width": 1.4},
        "marker": {"color": colour, "size": [0, 5, 0] * len(lags), "line": {"width": 0}},
        "hovertemplate": f"lag %{{x:.4~g}} {'s' if timed else 'rows'}: %{{y:.3f}}<extra></extra>",
    }


def _band(bound: float) -> dict:
    return {
        "type": "rect",
        "layer": "below",
        "xref": "paper",
        "yref": "y",
        "x0": 0,
        "x1": 1,
        "y0": -bound,
        "y1": bound,
        "line": {"width": 0},
        "fillcolor": style.BOUND_ZONE,
    }
