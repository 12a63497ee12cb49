"""A front of controllers: its points over two of the figures that they trade, a panel for each pair with the first."""

from typing import Any

from plantfit.findings.results.tuned_controller import ControllerFront
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

PANEL, TOP, BOTTOM = 280, 40, 50  # pixels


def front_figure(front: ControllerFront) -> Figure:
    """The first figure over each of the others, points numbered; the picked one stands out."""
    first, *others = front.figures
    layout = style.layout(PANEL + TOP + BOTTOM, showlegend=False, margin={"l": 70, "r": 14, "t": TOP, "b": BOTTOM})
    data, width = [], (1.0 - 0.1 * (len(others) - 1)) / len(others)
    for k, other in enumerate(others):
        number = str(k + 1) if k else ""
        picked = [p.number == front.picked for p in front.points]
        marker = {
            "size": [13 if chosen else 8 for chosen in picked],
            "color": [style.SERIES[1] if chosen else style.SERIES[0] for chosen in picked],
        }
        trace: dict[str, Any] = {
            "type": "scatter", "mode": "markers+text" if len(others) > 1 else "lines+markers+text", "marker": marker,
            "line": {"color": style.SERIES[0], "width": 1}, "xaxis": "x" + number, "yaxis": "y" + number,
            "hoverinfo": "x+y+text",
            "x": [p.figures[other] for p in front.points], "y": [p.figures[first] for p in front.points],
            "text": [str(p.number) for p in front.points], "textposition": "top right", "textfont": style.SMALL,
        }  # fmt: skip
        data.append(trace)
        left = k * (width + 0.1)
        layout["xaxis" + number] = style.axis(_named(front, other), domain=[left, left + width], anchor="y" + number)
        layout["yaxis" + number] = style.axis(_named(front, first) if k == 0 else "", anchor="x" + number)
    return {"data": data, "layout": layout}


def _named(front: ControllerFront, figure: str) -> str:
    return with_unit(figure.replace("_", " "), front.units[figure])
