"""A measured output and what one or more answers make of it, on a demo's page."""

from collections.abc import Mapping

import numpy as np

from plantfit.fitting import Answer
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import with_unit

SHOWN = 1500  # points of a line
LONG = 7200.0  # s from which on the axis is in hours


def followed_figure(answers: Mapping[str, Answer], recording: str, output: str) -> Figure:
    """Lines over time for a recording that all `answers` (by their labels) have; what the first did not fit is
    shaded where part is."""
    first = next(iter(answers.values()))
    experiment = first.problem.experiments[recording]
    r = experiment.recording
    hours = r.t[-1] - r.t[0] > LONG
    t, per = r.t / (3600.0 if hours else 1.0), "h" if hours else "s"
    keep = np.linspace(0, len(r) - 1, min(SHOWN, len(r))).astype(int)
    drawn = {"measured": (r[output], style.MEASURED, 2.4)}
    colours = (style.SIMULATED, *style.SERIES[1:])
    for k, (label, answer) in enumerate(answers.items()):
        drawn[label] = (answer.predict(recording)[output], colours[k % len(colours)], 1.4)
    data = [
        {
            "type": "scatter", "mode": "lines", "name": style.plain(label), "x": style.numbers(t[keep]),
            "y": style.numbers(values[keep]), "line": {"color": colour, "width": width},
        }
        for label, (values, colour, width) in drawn.items()
    ]  # fmt: skip
    layout = style.layout(280, showlegend=True, hovermode="x")
    layout["xaxis"] = style.axis(f"time [{per}]")
    layout["yaxis"] = style.axis(with_unit(output, r.signals[output].unit))
    fitted, unseen = experiment.mask("fit"), experiment.mask("validation")
    if np.any(fitted) and np.any(unseen):
        edges = t[unseen]
        layout["shapes"] = [
            {
                "type": "rect", "x0": float(edges[0]), "x1": float(edges[-1]), "xref": "x", "y0": 0, "y1": 1,
                "yref": "paper",
                "layer": "below", "line": {"width": 0}, "fillcolor": style.VALIDATION_ZONE,
            }
        ]  # fmt: skip
    return {"data": data, "layout": layout}
