"""Tables whose axis is unknown."""

import numpy as np

from benchmarks.search_suite.case import Case
from benchmarks.search_suite.regressions import evenly, over_input, over_time
from plantfit.space import Parameter as P

HEIGHTS = (0.3, 2.1, 0.8, 3.4, 1.1, 2.6, 0.2, 1.9, 3.1, 0.9, 2.2, 0.4)  # of a scale with marks, known

CASES = (
    Case(
        "place on a scale",
        "table",
        "A sensor reads a coded scale that is known as a table: "
        "where does the piece lie, and how much is it stretched?",
        "y = gain*code(place + stretch*x) + off",
        {"y": "V"},
        {
            "gain": P((0.05, 9.0)),
            "place": P((-6.0, 110.0), "mm"),
            "stretch": P((0.1, 2.9)),
            "off": P((-4.0, 3.0), "V"),
            "code": P(value=HEIGHTS, shape=(12,)),
        },
        {"gain": 1.3, "place": 41.7, "stretch": 0.87, "off": 0.2},
        {"y": 0.15},
        over_input("x", 0.0, 40.0, 130),
        inputs={"x": "mm"},
        tables={"code": {"over": ["x"], "nodes": {"from": 0, "to": 110, "count": 12}, "unit": "V"}},
        check_units=False,
    ),
    Case(
        "cam",
        "table",
        "Lift over the stroke of a crank that turns at an unknown speed: five support points of the curve.",
        "stroke = sin(w*t + phi)\ny = lift(stroke)",
        {"y": "mm"},
        {"w": P((0.5, 23.0), "rad/s"), "phi": P((-3.0, 3.3), "rad"), "lift": P((-9.0, 14.0), "mm", shape=(5,))},
        {"w": 8.43, "phi": 0.71, "lift[0]": 0.4, "lift[1]": 3.7, "lift[2]": 1.1, "lift[3]": -2.2, "lift[4]": 4.1},
        {"y": 0.4},
        evenly(170, 6.0),
        tables={"lift": {"over": ["t"], "nodes": {"from": -1, "to": 1, "count": 5}, "unit": "mm"}},
        check_units=False,
    ),
    Case(
        "two readers",
        "table",
        "Two heads read the same unknown profile a distance apart; its pitch is unknown.",
        "p = height(sin(k*x))\nq = height(sin(k*x - gap))",
        {"p": "um", "q": "um"},
        {"k": P((0.2, 9.7), "rad/mm"), "gap": P((-0.2, 3.1), "rad"), "height": P((-21.0, 34.0), "um", shape=(4,))},
        {"k": 4.13, "gap": 1.07, "height[0]": -3.0, "height[1]": 7.1, "height[2]": 2.2, "height[3]": 9.4},
        {"p": 0.8, "q": 0.8},
        over_input("x", 0.0, 14.0, 110),
        inputs={"x": "mm"},
        scales={"p": 0.8, "q": 0.8},
        tables={"height": {"over": ["x"], "nodes": {"from": -1, "to": 1, "count": 4}, "unit": "um"}},
        check_units=False,
    ),
    Case(
        "wind-up of a spring",
        "table",
        "Torque over an angle in two recordings, each with a zero of "
        "its own; the characteristic is known and goes up and down.",
        "y = scale*code(x + zero)",
        {"y": "N*m"},
        {
            "scale": P((0.1, 8.3)),
            "zero": P((-15.0, 95.0), "deg", per_recording=True),
            "code": P(value=HEIGHTS, shape=(12,)),
        },
        {"scale": 1.7, "zero[left]": 13.4, "zero[right]": 57.1},
        {"y": 0.3},
        lambda rng: {
            "left": (np.arange(70.0), {"x": np.sort(rng.uniform(0.0, 32.0, 70))}),
            "right": (np.arange(90.0), {"x": np.sort(rng.uniform(0.0, 32.0, 90))}),
        },
        inputs={"x": "deg"},
        tables={"code": {"over": ["x"], "nodes": {"from": 0, "to": 110, "count": 12}, "unit": "N*m"}},
        check_units=False,
    ),
    Case(
        "valve and swing",
        "table",
        "A valve with a dead zone, driven by a swing of unknown frequency: opening curve and swing from the flow.",
        "u = sin(w*t) + 0.35*sin(2*w*t + phi)\ny = flow(u)",
        {"y": "l/min"},
        {"w": P((0.4, 17.0), "rad/s"), "phi": P((-3.1, 3.2), "rad"), "flow": P((-24.0, 33.0), "l/min", shape=(5,))},
        {"w": 6.21, "phi": 0.93, "flow[0]": -6.0, "flow[1]": -1.1, "flow[2]": 0.2, "flow[3]": 4.7, "flow[4]": 7.9},
        {"y": 0.6},
        over_time(160, 7.0),
        tables={"flow": {"over": ["t"], "nodes": {"from": -1.2, "to": 1.2, "count": 5}, "unit": "l/min"}},
        check_units=False,
    ),
)
