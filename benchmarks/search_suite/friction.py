"""Friction, backlash and thresholds."""

import numpy as np

from benchmarks.search_suite.case import Case
from benchmarks.search_suite.regressions import evenly, over_input, over_time
from plantfit.space import Parameter as P

CASES = (
    Case(
        "stribeck curve",
        "friction",
        "Friction force over speed: the Stribeck velocity is small in its box, where the bump is gone.",
        "y = sign(v)*(Fc + (Fs - Fc)*exp(-(v/vs)^2)) + b*v + off",
        {"y": "N"},
        {
            "Fc": P((0.0, 85.0), "N"),
            "Fs": P((0.0, 130.0), "N"),
            "vs": P((0.0005, 2.5), "m/s"),
            "b": P((-90.0, 140.0), "N*s/m"),
            "off": P((-14.0, 23.0), "N"),
        },
        {"Fc": 11.2, "Fs": 17.9, "vs": 0.021, "b": 8.3, "off": 1.1},
        {"y": 0.5},
        over_input("v", -1.0, 1.0, 200),
        inputs={"v": "m/s"},
    ),
    Case(
        "cogging",
        "friction",
        "Force over a rail: friction by the direction, and cogging "
        "whose pitch is unknown. The best offset is on its bound.",
        "y = Fc*v + a*sin(k*x) + b*cos(k*x) + off",
        {"y": "N"},
        {
            "Fc": P((0.0, 41.0), "N"),
            "a": P((-14.0, 19.0), "N"),
            "b": P((-14.0, 19.0), "N"),
            "k": P((5.0, 490.0), "rad/m"),
            "off": P((-8.0, 0.2), "N"),
        },
        {"Fc": 6.1, "a": 1.9, "b": 1.2, "k": 203.0, "off": 0.4},
        {"y": 0.8},
        lambda rng: {
            "rail": (np.arange(190.0), {"x": np.abs(np.linspace(-0.55, 0.55, 190)), "v": np.repeat([-1.0, 1.0], 95)})
        },
        inputs={"x": "m", "v": None},
        check_units=False,
    ),
    Case(
        "ringing with friction",
        "friction",
        "A mass on a spring that dry friction brings to rest.",
        "x' = v\nv' = -k*x - c*v - Fc*tanh(v/0.2)\ny = x + off",
        {"y": "mm"},
        {
            "k": P((1.0, 3900.0), "1/s^2"),
            "c": P((0.0, 2.9), "1/s"),
            "Fc": P((0.0, 47.0)),
            "x0": P((-14.0, 19.0), "mm"),
            "off": P((-3.0, 4.2), "mm"),
        },
        {"k": 113.0, "c": 0.11, "Fc": 3.1, "x0": 4.3, "off": 0.3},
        {"y": 0.2},
        evenly(170, 6.0),
        states={"x": {"unit": "mm", "initial": "x0"}, "v": "mm/s"},
        substeps=8,
        check_units=False,
    ),
    Case(
        "dead zone and swing",
        "friction",
        "A swing of unknown frequency behind a dead zone.",
        "y = gain*deadzone(sin(w*t + phi), -gap, gap) + off",
        {"y": "mm"},
        {
            "gain": P((0.1, 27.0), "mm"),
            "w": P((0.5, 31.0), "rad/s"),
            "phi": P((-2.9, 3.4), "rad"),
            "gap": P((0.0, 0.97)),
            "off": P((-4.0, 3.0), "mm"),
        },
        {"gain": 5.2, "w": 12.7, "phi": 0.83, "gap": 0.37, "off": 0.4},
        {"y": 0.4},
        over_time(170, 7.0),
        check_units=False,
    ),
    Case(
        "friction of two joints",
        "friction",
        "Torques of two joints with one Stribeck velocity, far "
        "below the middle of its box, and cogging of unknown order.",
        "s = exp(-(v/vs)^2)\np = sign(v)*(F1 + S1*s) + a*sin(n*x)\nq = sign(v)*(F2 + S2*s) + b*sin(n*x)",
        {"p": "N*m", "q": "N*m"},
        {
            "F1": P((0.0, 22.0)),
            "S1": P((-9.0, 16.0)),
            "F2": P((0.0, 22.0)),
            "S2": P((-9.0, 16.0)),
            "vs": P((0.001, 2.1), "rad/s"),
            "a": P((-4.0, 5.1)),
            "b": P((-4.0, 5.1)),
            "n": P((1.0, 39.0)),
        },
        {"F1": 3.1, "S1": 2.4, "F2": 1.7, "S2": 1.2, "vs": 0.083, "a": 0.6, "b": -0.5, "n": 14.2},
        {"p": 0.25, "q": 0.2},
        lambda rng: {
            "sweep": (np.arange(150.0), {"x": np.linspace(0.0, 5.9, 150), "v": np.sort(rng.uniform(-1.0, 1.0, 150))})
        },
        inputs={"x": "rad", "v": "rad/s"},
        scales={"p": 0.25, "q": 0.2},
        check_units=False,
    ),
    Case(
        "stribeck of two runs",
        "friction",
        "Force over speed in two recordings, each with an offset of its own.",
        "y = sign(v)*(Fc + S*exp(-(v/vs)^2)) + b*v + off",
        {"y": "N"},
        {
            "Fc": P((0.0, 85.0), "N"),
            "S": P((0.0, 60.0), "N"),
            "vs": P((0.0005, 12.0), "m/s"),
            "b": P((-90.0, 140.0), "N*s/m"),
            "off": P((-14.0, 23.0), "N", per_recording=True),
        },
        {"Fc": 9.2, "S": 4.9, "vs": 0.017, "b": 5.3, "off[day]": 1.1, "off[night]": -0.7},
        {"y": 0.5},
        lambda rng: {
            "day": (np.arange(110.0), {"v": np.sort(rng.uniform(-1.0, 1.0, 110))}),
            "night": (np.arange(90.0), {"v": np.sort(rng.uniform(-0.6, 0.8, 90))}),
        },
        inputs={"v": "m/s"},
    ),
)
