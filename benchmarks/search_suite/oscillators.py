"""Plants that oscillate: an optimum for every number of swings."""

import numpy as np

from benchmarks.search_suite.case import Case
from benchmarks.search_suite.regressions import evenly
from plantfit.space import Parameter as P


def steps(
    names: tuple[str, ...], n: int, period: float, size: float, held: int, recordings: tuple[str, ...] = ("run",)
):
    """Inputs that jump to random levels after a random number of samples, `held` on average."""

    def drives(rng):
        made = {}
        for recording in recordings:
            inputs = {}
            for name in names:
                jumps = rng.random(n) < 1 / held
                jumps[0] = True
                inputs[name] = rng.uniform(-size, size, n)[np.maximum.accumulate(np.where(jumps, np.arange(n), 0))]
            made[recording] = (period * np.arange(n), inputs)
        return made

    return drives


CASES = (
    Case(
        "ringing mass",
        "oscillator",
        "A mass on a spring let go: stiffness over two decades on a linear scale.",
        "x' = v\nv' = -(k*x + c*v)/m\ny = x + off",
        {"y": "mm"},
        {
            "k": P((3.0, 7000.0), "N/m"),
            "c": P((0.0, 3.0), "N*s/m"),
            "x0": P((-25.0, 40.0), "mm"),
            "off": P((-11.0, 6.0), "mm"),
        },
        {"k": 261.0, "c": 0.37, "x0": 12.4, "off": 0.9},
        {"y": 0.4},
        evenly(240, 12.0),
        substeps=4,
        states={"x": {"unit": "mm", "initial": "x0"}, "v": "mm/s"},
        constants={"m": "1.7 kg"},
    ),
    Case(
        "pendulum",
        "oscillator",
        "A pendulum let go at a large angle, whose period depends on the swing: length, friction and where it began.",
        "x' = v\nv' = -g/l*sin(x) - c*v\ny = x + off",
        {"y": "rad"},
        {
            "l": P((0.05, 9.0), "m"),
            "c": P((0.0, 0.27), "1/s"),
            "x0": P((-2.9, 2.7), "rad"),
            "off": P((-1.0, 1.3), "rad"),
        },
        {"l": 0.61, "c": 0.037, "x0": 1.87, "off": 0.11},
        {"y": 0.08},
        evenly(330, 50.0),
        states={"x": {"unit": "rad", "initial": "x0"}, "v": "rad/s"},
        constants={"g": "9.81 m/s^2"},
        substeps=6,
        check_units=False,
    ),
    Case(
        "limit cycle",
        "oscillator",
        "Van der Pol's oscillator: its period grows with its nonlinearity.",
        "x' = w*v\nv' = w*(mu*(1 - x^2)*v - x)\ny = gain*x",
        {"y": "V"},
        {
            "w": P((0.3, 14.0), "rad/s"),
            "mu": P((0.05, 3.1)),
            "x0": P((-3.0, 2.6)),
            "v0": P((-3.0, 3.4)),
            "gain": P((0.1, 9.0), "V"),
        },
        {"w": 4.37, "mu": 0.64, "x0": 1.2, "v0": -0.7, "gain": 2.3},
        {"y": 0.5},
        evenly(200, 12.0),
        states={"x": {"initial": "x0"}, "v": {"initial": "v0"}},
        substeps=4,
        check_units=False,
    ),
    Case(
        "hunter and prey",
        "oscillator",
        "Lotka and Volterra's cycle, both populations counted.",
        "a' = r*a - k*a*b\nb' = k*gain*a*b - m*b\np = a\nq = b",
        {"p": None, "q": None},
        {
            "r": P((0.05, 5.0), "1/s"),
            "k": P((0.05, 3.0)),
            "gain": P((0.05, 4.0)),
            "m": P((0.05, 6.0), "1/s"),
            "a0": P((0.1, 9.0)),
        },
        {"r": 1.1, "k": 0.43, "gain": 0.81, "m": 0.92, "a0": 3.3},
        {"p": 0.3, "q": 0.2},
        evenly(110, 30.0),
        states={"a": {"initial": "a0"}, "b": {"initial": 1.7}},
        scales={"p": 0.3, "q": 0.2},
        substeps=4,
        check_units=False,
    ),
    Case(
        "hardening spring",
        "oscillator",
        "A mass on a hardening spring, let go twice from places of its own.",
        "x' = v\nv' = -k*x - h*x^3 - c*v\ny = x",
        {"y": "mm"},
        {
            "k": P((0.0, 190.0), "1/s^2"),
            "h": P((0.0, 60.0)),
            "c": P((0.0, 2.1), "1/s"),
            "x0": P((-5.0, 7.0), "mm", per_recording=True),
        },
        {"k": 27.0, "h": 6.1, "c": 0.09, "x0[near]": 0.9, "x0[far]": 2.6},
        {"y": 0.25},
        lambda rng: {"near": (np.linspace(0.0, 9.0, 140), {}), "far": (np.linspace(0.0, 7.0, 120), {})},
        states={"x": {"unit": "mm", "initial": "x0"}, "v": "mm/s"},
        substeps=4,
        check_units=False,
    ),
    Case(
        "soft shaft",
        "oscillator",
        "Motor and load on a shaft swing against each other after a blow; both angles are measured.",
        "x' = v\nv' = -w^2*x - d*v\np = x + s*t\nq = -b*x + s*t",
        {"p": "rad", "q": "rad"},
        {
            "w": P((1.0, 110.0), "rad/s"),
            "d": P((0.0, 5.0), "1/s"),
            "b": P((0.0, 9.0)),
            "v0": P((-180.0, 195.0), "rad/s"),
            "s": P((-1.0, 1.4), "rad/s"),
        },
        {"w": 31.7, "d": 0.42, "b": 0.6, "v0": 31.0, "s": 0.23},
        {"p": 0.2, "q": 0.15},
        evenly(150, 4.0),
        states={"x": {"unit": "rad", "initial": 0.0}, "v": {"unit": "rad/s", "initial": "v0"}},
        scales={"p": 0.2, "q": 0.15},
        substeps=2,
        check_units=False,
    ),
)
