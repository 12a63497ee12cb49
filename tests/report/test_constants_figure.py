"""The figure of constants that settle: one panel each, bands around lines, references where given."""

import json

import numpy as np

from plantfit.estimate import Track
from plantfit.report.figures.pages.constants import constants_figure


def track(name, factor=1.0, n=2000):
    t = np.linspace(0.0, 5.0, n)
    value, sd = factor * (1.0 + np.exp(-t)), factor * 0.45 / (0.5 + t)
    return Track(name, "ohm", t, value, value - 2 * sd, value + 2 * sd)


def test_one_panel_for_each_constant_with_its_band():
    figure = constants_figure([track("R"), track("<k>", 1e-3)], {"R": (1.0, 0.9, 1.1)}, "fit")
    assert json.loads(json.dumps(figure, allow_nan=False)) == figure
    lines = [d for d in figure["data"] if d.get("name") == "filter"]
    assert [d["yaxis"] for d in lines] == ["y", "y2"]
    assert all(len(d["x"]) <= 600 and d["x"][-1] == 5.0 for d in lines)
    low, high = figure["data"][0], figure["data"][1]
    assert all(a < v < b for a, v, b in zip(low["y"], lines[0]["y"], high["y"], strict=True))
    reference = next(d for d in figure["data"] if d.get("name") == "fit")
    assert reference["y"] == [1.0, 1.0]
    assert [(s["y0"], s["y1"]) for s in figure["layout"]["shapes"]] == [(0.9, 1.1)]
    texts = [a["text"] for a in figure["layout"]["annotations"]]
    assert any("&lt;k&gt;" in t for t in texts)
    domains = [figure["layout"][k]["domain"] for k in ("yaxis", "yaxis2")]
    assert domains[1][1] < domains[0][0]


def test_a_band_over_decades_is_drawn_on_a_logarithm():
    t = np.array([0.0, 1.0])
    wide = Track("J", None, t, np.array([1.0, 2.0]), np.array([0.05, 1.5]), np.array([20.0, 2.5]))
    narrow = Track("R", None, t, np.ones(2), np.full(2, 0.9), np.full(2, 1.1))
    layout = constants_figure([wide, narrow])["layout"]
    assert layout["yaxis"]["type"] == "log"
    assert "type" not in layout["yaxis2"]
