"""Figures 1 and 3 of the paper: the two links with their names, and the three poses with the flat output that leads
through them."""

from collections.abc import Mapping

import numpy as np

from plantfit.cases.pendubot.sections.control_section import L1, L2, arm
from plantfit.recording.record import Recording
from plantfit.report.figures import style
from plantfit.report.figures.strobe import Panel, strobe_figure
from plantfit.report.figures.style import Figure
from plantfit.rig.pendubot_reference import UPRIGHT, FlatOutput

POSES = (0.0, 7.0, 13.5)  # s, as in the paper's figure 3
DRAWN = np.radians((55.0, -35.0))  # theta1, theta2 of the scheme


def scheme_figure(truth: Mapping[str, float]) -> Figure:
    """Both links with the names of equations 5 to 15; the circles are the centres of mass of `truth`."""
    theta1, theta2 = DRAWN
    chain = arm(np.array([theta1]), np.array([theta2]))
    figure = strobe_figure(np.zeros(1), chain, [0.0], [], "")
    base, elbow, tip = chain[0]
    centres = np.stack([base + (elbow - base) * truth["lc1"] / L1, elbow + (tip - elbow) * truth["lc2"] / L2])
    marker = {"symbol": "circle-open", "size": 12, "color": style.SERIES[0], "line": {"width": 2}}
    dots = {"type": "scatter", "mode": "markers", "marker": marker, "showlegend": False, "hoverinfo": "skip"}
    figure["data"].append(dots | {"x": style.numbers(centres[:, 0], 5), "y": style.numbers(centres[:, 1], 5)})
    level = elbow + 0.6 * (elbow - base)  # theta2 is counted from the line of link 1
    for start, end in ((base, base + np.array([0.12, 0.0])), (elbow, level)):
        line = {
            "type": "scatter",
            "mode": "lines",
            "line": {"color": style.MUTED, "width": 1, "dash": "dot"},
            "showlegend": False,
        }
        figure["data"].append(
            line
            | {"x": style.numbers(np.array([start[0], end[0]]), 5), "y": style.numbers(np.array([start[1], end[1]]), 5)}
        )
    names = {
        "torque tau": base + np.array([-0.06, 0.01]),
        "theta1": base + np.array([0.06, 0.02]),
        "theta2": elbow + np.array([0.07, 0.05]),
        "l1": 0.4 * elbow + np.array([-0.02, 0.01]),
        "m1, I1 at lc1": centres[0] + np.array([-0.065, 0.005]),
        "m2, I2 at lc2": centres[1] + np.array([0.02, -0.03]),
        "l2": elbow + 0.85 * (tip - elbow) + np.array([0.0, 0.018]),
    }
    notes = [
        {
            "text": style.plain(text),
            "x": round(float(x), 4),
            "y": round(float(y), 4),
            "showarrow": False,
            "font": {"size": 12, "color": style.INK},
        }
        for text, (x, y) in names.items()
    ]
    return {"data": figure["data"], "layout": figure["layout"] | {"height": 320, "annotations": notes}}


def poses_figure(recording: Recording, base: Mapping[str, float], l1: float, g: float) -> Figure:
    """The rest-to-rest poses of figure 3, the references of both angles, and y of equation 16 along them."""
    theta1, theta2 = recording["theta1_ref"], recording["theta2_ref"]
    flat = FlatOutput.of(base, l1, g)
    y = (1.0 + 1.0 / flat.factor) * (theta1 - UPRIGHT) + theta2  # (b2 + b3)/b2 = 1 + b3/b2
    panels = [
        Panel("reference of the angles [deg]", {"theta1": np.degrees(theta1), "theta2": np.degrees(theta2)}),
        Panel("flat output y_f of equation 16 [rad]", {"y_f": y}),
    ]
    return strobe_figure(recording.t, arm(theta1, theta2), POSES, panels, "at 0, 7 and 13.5 s, faint to dark")
