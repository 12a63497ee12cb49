"""What all figures share: colours by role, axes, text.

Figures are plain plotly dictionaries. Colours are CSS variables of templates/style.css, which
templates/draw.js replaces by their values, so that figures follow light, dark and print.
"""

import html
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

Figure = dict[str, Any]

INK, MUTED, GRID = "var(--ink)", "var(--muted)", "var(--grid)"
MEASURED, SIMULATED, RESIDUAL, INPUT = "var(--measured)", "var(--simulated)", "var(--residual)", "var(--input)"
FIT_ZONE, VALIDATION_ZONE, BOUND_ZONE = "var(--fit-zone)", "var(--validation-zone)", "var(--bound-zone)"
TRACK, WARNING, CLEAR = "var(--track)", "var(--warning)", "rgba(0,0,0,0)"
SERIES, BANDS = tuple(f"var(--series-{k})" for k in range(1, 7)), tuple(f"var(--band-{k})" for k in range(1, 7))
SMALL = {"size": 11, "color": MUTED}
# characters of a name's line, of a legend's row and of a key in it; pixels of a row
NARROW, WIDE, KEY, ROW = (15, 105, 6, 20)


def layout(height: int, **more: Any) -> dict[str, Any]:
    """The base layout of every figure, `height` in pixels."""
    base = {
        "height": height,
        "autosize": True,
        "paper_bgcolor": CLEAR,
        "plot_bgcolor": CLEAR,
        "font": {
            "family": "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif",
            "size": 12,
            "color": INK,
        },
        "margin": {"l": 56, "r": 14, "t": 58, "b": 44},
        "hoverlabel": {"bgcolor": "var(--card)", "bordercolor": GRID, "font": {"color": INK}, "namelength": -1},
        "legend": {
            "orientation": "h",
            "x": 1,
            "xanchor": "right",
            "y": 1,
            "yanchor": "bottom",
            "bgcolor": CLEAR,
            "font": {"size": 12},
        },
        "modebar": {"bgcolor": CLEAR, "color": MUTED, "activecolor": INK},
        "uirevision": "keep",
        "showlegend": False,
    }
    return base | more


def axis(title: str = "", **more: Any) -> dict[str, Any]:
    """A quiet axis; `title` is plain text."""
    base = {
        "title": {"text": plain(title), "font": SMALL, "standoff": 8},
        "gridcolor": GRID,
        "linecolor": GRID,
        "zeroline": False,
        "tickfont": SMALL,
        "ticks": "",
        "automargin": True,
        "exponentformat": "power",  # plotly's own is a letter: 23n beside kg*m^2
    }
    return base | more


def log_axis(title: str, values: np.ndarray, **more: Any) -> dict[str, Any]:
    """A log axis where all finite values are positive, else a linear one; labels at 1, 2, 5 or at decades."""
    shown = values[np.isfinite(values)]
    if len(shown) == 0 or shown.min() <= 0:
        return axis(title, **more)
    decades = np.log10(shown.max() / shown.min())
    return axis(title, type="log", dtick="D2" if decades < 1.5 else max(1, round(decades / 8)), tickformat="~g", **more)


def categories(names: Sequence[str], **more: Any) -> dict[str, Any]:
    """An axis of names, long ones in lines: turned ones take half of a figure."""
    told = {
        "tickvals": [plain(n) for n in names],
        "ticktext": ["<br>".join(map(plain, textwrap.wrap(n, NARROW))) for n in names],
    }
    return axis(type="category", tickfont={"size": 12, "color": INK}, **told, **more)


def with_legend(layout: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """The layout with room above for a legend of several rows, which would reach into the figure's buttons."""
    rows = -(-sum(len(n) + KEY for n in names) // WIDE)
    return {**layout, "margin": {**layout["margin"], "t": layout["margin"]["t"] + ROW * max(0, rows - 1)}}


def heading(text: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    """A panel's title at its upper left corner, in paper coordinates."""
    base = {
        "text": plain(text),
        "x": x,
        "y": y,
        "xref": "paper",
        "yref": "paper",
        "xanchor": "left",
        "yanchor": "bottom",
    }
    return base | {"showarrow": False, "align": "left", "font": {"size": 12, "color": INK}} | more


def plain(text: str) -> str:
    """Text that plotly shows as it is; plotly would read tags and %{...} in it."""
    return html.escape(text, quote=False).replace("%{", "%\u200b{")


def dots(values: np.ndarray, colour: str, few: int = 0) -> dict[str, Any]:
    """What draws a trace (n,) as points where it has at most `few` samples, or where a line would not show most of
    them, as each stands alone between missing ones; else nothing."""
    there = np.isfinite(values)
    beside = np.r_[False, there[:-1]] | np.r_[there[1:], False]
    alone = np.sum(there & ~beside) > 0.5 * np.sum(there)
    return {"mode": "markers", "marker": {"size": 5, "color": colour}} if alone or 0 < np.sum(there) <= few else {}


def numbers(values: np.ndarray, digits: int = 6) -> list[float | None]:
    """Values (n,) for JSON: rounded to keep the file small, None for what is not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values]
