import json
import re

import numpy as np
import plotly.graph_objects as go

from plantfit.report.figures import Panel, strobe_figure

T = np.linspace(0.0, 2.0, 2001)


def swing():
    """Two links of 1 m and 2 m, the first turning by 1 rad/s."""
    elbow = np.stack([np.cos(T), np.sin(T)], axis=-1)
    return np.stack([np.zeros_like(elbow), elbow, 3.0 * elbow], axis=1)


def figure(panels=True):
    lines = (
        [Panel("angle [deg]", {"LQR": np.degrees(T), "MPC": -T}), Panel("voltage [V]", {"MPC": T**2, "<b>": T})]
        if panels
        else []
    )
    return strobe_figure(T, swing(), [0.0, 0.5, 1.5], lines, "arm")


def test_plotly_accepts_it():
    text = re.sub(r"var\(--[a-z0-9-]+\)", "#123456", json.dumps(figure(), allow_nan=False))
    assert len(list(go.Figure(json.loads(text))["data"])) == 3 + 1 + 4


def test_links_stand_where_they_were_and_the_tip_leaves_its_path():
    data = figure()["data"]
    for k, time in enumerate([0.0, 0.5, 1.5]):
        np.testing.assert_allclose(data[k]["x"], [0.0, np.cos(time), 3.0 * np.cos(time)], atol=1e-4)
        np.testing.assert_allclose(data[k]["y"], [0.0, np.sin(time), 3.0 * np.sin(time)], atol=1e-4)
    assert data[0]["opacity"] < data[1]["opacity"] < data[2]["opacity"] == 1.0
    np.testing.assert_allclose(np.hypot(data[3]["x"], data[3]["y"]), 3.0, rtol=1e-4)
    assert figure()["layout"]["yaxis"]["scaleanchor"] == "x"


def test_a_signal_has_one_colour_and_one_line_of_the_legend():
    lines = figure()["data"][4:]
    colours = {}
    for line in lines:
        colours.setdefault(line["name"], set()).add(line["line"]["color"])
    assert set(colours) == {"LQR", "MPC", "&lt;b&gt;"}
    assert all(len(c) == 1 for c in colours.values())
    assert len(set.union(*colours.values())) == 3
    assert sorted(line["name"] for line in lines if line["showlegend"]) == sorted(colours)
    assert {(line["xaxis"], line["yaxis"]) for line in lines} == {("x2", "y2"), ("x3", "y3")}


def test_panels_do_not_overlap():
    layout = figure()["layout"]
    assert layout["xaxis"]["domain"][1] < layout["xaxis2"]["domain"][0]
    assert layout["yaxis3"]["domain"][1] < layout["yaxis2"]["domain"][0]
    assert figure(panels=False)["layout"]["xaxis"]["domain"] == [0.0, 1.0]
