"""Signals of a demo's page in panels over one time axis."""

from collections.abc import Mapping, Sequence

import numpy as np

from plantfit.report.decimate import envelope
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure

POINTS = 3000


def signals_figure(t: np.ndarray, panels: Sequence[tuple[str, Mapping[str, tuple[np.ndarray, str, float]]]]) -> Figure:
    """Panels (axis title, {name: (values (n,), colour, width)}) over one time axis in s."""
    height, data = 170, []
    layout = style.layout(60 + height * len(panels), showlegend=True, hovermode="closest")
    share = 1.0 / len(panels)
    for k, (title, lines) in enumerate(panels):
        number = "" if k == 0 else str(k + 1)
        top = 1.0 - k * share
        layout["yaxis" + number] = style.axis(title, domain=[max(0.0, top - share + 0.05), top], nticks=5)
        for name, (values, colour, width) in lines.items():
            kept = envelope(values, POINTS)
            look = {
                "type": "scatter",
                "mode": "lines",
                "name": style.plain(name),
                "line": {"color": colour, "width": width},
            }
            data.append(
                look | {"x": style.numbers(t[kept], 6), "y": style.numbers(values[kept], 5), "yaxis": "y" + number}
            )
    layout["xaxis"] = style.axis("time [s]", anchor="y" + ("" if len(panels) == 1 else str(len(panels))))
    return {"data": data, "layout": layout}
