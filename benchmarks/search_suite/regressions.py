"""Curves: an output as a function of an input or of time."""

import numpy as np

from benchmarks.search_suite.case import Case
from plantfit.space import Parameter as P


def over_time(n: int, end: float):
    """One recording of n samples, a little irregular, without inputs."""

    def drives(rng):
        t = np.linspace(0.0, end, n)
        return {"run": (t + np.concatenate([[0.0], rng.uniform(-0.3, 0.3, n - 1) * end / n]), {})}

    return drives


def evenly(n: int, end: float):
    """One recording of n samples at equal distances, without inputs."""
    return lambda rng: {"run": (np.linspace(0.0, end, n), {})}


def over_input(name: str, low: float, high: float, n: int):
    """One recording in which an input walks from low to high."""

    def drives(rng):
        x = np.sort(rng.uniform(low, high, n))
        return {"scan": (np.arange(n, dtype=float), {name: x})}

    return drives


CASES = (
    Case(
        "runout",
        "regression",
        "Run-out of a shaft at a speed that is known to a decade: about forty periods fit into the record.",
        "y = A*sin(w*t + phi) + c",
        {"y": "mm"},
        {
            "A": P((0.2, 6.5), "mm"),
            "w": P((0.7, 27.0), "rad/s"),
            "phi": P((-3.0, 3.4), "rad"),
            "c": P((-2.0, 5.0), "mm"),
        },
        {"A": 1.7, "w": 8.61, "phi": 0.6, "c": 0.43},
        {"y": 0.3},
        over_time(120, 10.0),
    ),
    Case(
        "two tones",
        "regression",
        "Beat of two machines on one foundation, both speeds unknown; the tones may change places.",
        "y = a1*sin(w1*t) + b1*cos(w1*t) + a2*sin(w2*t) + b2*cos(w2*t)",
        {"y": "um"},
        {
            "a1": P((-9.0, 14.0), "um"),
            "b1": P((-9.0, 14.0), "um"),
            "w1": P((5.0, 21.0), "rad/s"),
            "a2": P((-9.0, 14.0), "um"),
            "b2": P((-9.0, 14.0), "um"),
            "w2": P((5.0, 21.0), "rad/s"),
        },
        {"a1": 3.1, "b1": -1.7, "w1": 10.93, "a2": 1.9, "b2": 4.4, "w2": 16.2},
        {"y": 0.8},
        over_time(140, 6.0),
    ),
    Case(
        "resonance line",
        "regression",
        "A narrow resonance somewhere in a wide sweep: most starts see nothing of it.",
        "y = base + slope*(f - 500) + peak/(1 + ((f - f0)/width)^2)",
        {"y": "mm"},
        {
            "base": P((-70.0, 25.0), "mm"),
            "slope": P((-0.1, 0.17), "mm/Hz"),
            "peak": P((1.0, 88.0), "mm"),
            "f0": P((12.0, 990.0), "Hz"),
            "width": P((0.5, 60.0), "Hz"),
        },
        {"base": -31.0, "slope": 0.012, "peak": 22.0, "f0": 713.4, "width": 6.1},
        {"y": 1.1},
        over_input("f", 5.0, 1000.0, 260),
        inputs={"f": "Hz"},
        check_units=False,
    ),
    Case(
        "thin film",
        "regression",
        "Interference of light in a film: thickness from fringes over "
        "the wavelength, with one optimum for every fringe order.",
        "y = a + b*cos(4*pi*n*d/lam)*(1 + s*(lam - 600))",
        {"y": None},
        {
            "a": P((-3.0, 5.0)),
            "b": P((0.05, 2.3)),
            "d": P((300.0, 9000.0), "nm"),
            "s": P((-0.004, 0.003), "1/nm"),
        },
        {"a": 0.61, "b": 0.27, "d": 2417.0, "s": 0.0006},
        {"y": 0.03},
        over_input("lam", 450.0, 820.0, 160),
        inputs={"lam": "nm"},
        constants={"n": 1.46},
        check_units=False,
    ),
    Case(
        "three peaks",
        "regression",
        "A chromatogram: three peaks of one width anywhere in the record.",
        "y = base + h1*exp(-((t - t1)/w)^2) + h2*exp(-((t - t2)/w)^2) + h3*exp(-((t - t3)/w)^2)",
        {"y": "mV"},
        {
            "base": P((-7.0, 16.0), "mV"),
            "w": P((0.5, 35.0), "s"),
            "h1": P((0.0, 95.0), "mV"),
            "t1": P((-5.0, 260.0), "s"),
            "h2": P((0.0, 95.0), "mV"),
            "t2": P((-5.0, 260.0), "s"),
            "h3": P((0.0, 95.0), "mV"),
            "t3": P((-5.0, 260.0), "s"),
        },
        {"base": 1.3, "w": 7.1, "h1": 21.0, "t1": 61.7, "h2": 33.0, "t2": 103.2, "h3": 12.4, "t3": 208.6},
        {"y": 0.8},
        over_time(200, 250.0),
    ),
    Case(
        "run-up",
        "regression",
        "A machine that runs up: first speed and acceleration from its vibration.",
        "y = A*sin(w*t + 0.5*k*t^2 + phi)",
        {"y": "um"},
        {
            "A": P((0.4, 31.0), "um"),
            "w": P((1.5, 15.0), "rad/s"),
            "k": P((-0.2, 2.3), "rad/s^2"),
            "phi": P((-2.9, 3.6), "rad"),
        },
        {"A": 6.2, "w": 7.4, "k": 0.83, "phi": 1.1},
        {"y": 1.4},
        over_time(160, 9.0),
    ),
    Case(
        "ripple of an encoder",
        "regression",
        "Ripple with an unknown number of periods a turn on a straight line.",
        "y = a*sin(n*x) + b*cos(n*x) + slope*x + c",
        {"y": "mrad"},
        {
            "a": P((-14.0, 23.0), "mrad"),
            "b": P((-14.0, 23.0), "mrad"),
            "n": P((1.0, 61.0)),
            "slope": P((-9.0, 7.0), "mrad/rad"),
            "c": P((-30.0, 40.0), "mrad"),
        },
        {"a": 2.7, "b": -1.4, "n": 36.8, "slope": 0.31, "c": 4.9},
        {"y": 0.9},
        over_input("x", 0.0, 6.28, 180),
        inputs={"x": "rad"},
    ),
    Case(
        "frequency modulation",
        "regression",
        "A carrier whose frequency swings at an unknown rate.",
        "y = A*sin(w*t + m*sin(v*t))",
        {"y": "V"},
        {"A": P((0.2, 8.1), "V"), "w": P((8.0, 21.0), "rad/s"), "m": P((0.1, 3.7), "rad"), "v": P((0.5, 3.1), "rad/s")},
        {"A": 1.9, "w": 13.2, "m": 1.7, "v": 1.36},
        {"y": 0.4},
        over_time(170, 10.0),
    ),
    Case(
        "tide",
        "regression",
        "A wave with its second harmonic; its period is known to a factor of forty.",
        "y = a*sin(w*t) + b*cos(w*t) + c*sin(2*w*t) + d*cos(2*w*t) + mean",
        {"y": "m"},
        {
            "a": P((-8.0, 11.0), "m"),
            "b": P((-8.0, 11.0), "m"),
            "c": P((-8.0, 11.0), "m"),
            "d": P((-8.0, 11.0), "m"),
            "mean": P((-9.0, 17.0), "m"),
            "w": P((0.05, 2.0), "rad/s"),
        },
        {"a": 1.2, "b": 0.7, "c": -0.5, "d": 0.6, "mean": 3.4, "w": 0.707},
        {"y": 0.3},
        over_time(180, 95.0),
    ),
    Case(
        "three phases",
        "regression",
        "Two currents of one machine, both measured: speed, angle between the windings and amplitudes.",
        "p = A*sin(w*t + phi)\nq = B*sin(w*t + phi - gap)",
        {"p": "A", "q": "A"},
        {
            "A": P((0.3, 22.0), "A"),
            "B": P((0.3, 22.0), "A"),
            "w": P((3.0, 170.0), "rad/s"),
            "phi": P((-3.1, 3.4), "rad"),
            "gap": P((-3.0, 3.3), "rad"),
        },
        {"A": 4.1, "B": 3.3, "w": 103.7, "phi": -1.2, "gap": 2.06},
        {"p": 0.7, "q": 0.5},
        over_time(90, 1.1),
        scales={"p": 0.7, "q": 0.5},
    ),
    Case(
        "two runs at one speed",
        "regression",
        "Two recordings of the same machine: the speed is shared, amplitude and phase are those of the run.",
        "y = a*sin(w*t) + b*cos(w*t) + c",
        {"y": "mm/s"},
        {
            "a": P((-7.0, 12.0), "mm/s", per_recording=True),
            "b": P((-7.0, 12.0), "mm/s", per_recording=True),
            "w": P((1.0, 44.0), "rad/s"),
            "c": P((-3.0, 4.1), "mm/s"),
        },
        {"a[cold]": 1.3, "a[warm]": 0.4, "b[cold]": -0.9, "b[warm]": 2.1, "w": 17.3, "c": 0.6},
        {"y": 0.5},
        lambda rng: {"cold": (np.linspace(0.0, 7.0, 130), {}), "warm": (np.linspace(0.0, 5.0, 90), {})},
    ),
    Case(
        "rational curve",
        "regression",
        "A quotient with poles almost everywhere in its box.",
        "y = (a + b*x)/(1 + c*x + d*x^2)",
        {"y": "N"},
        {"a": P((-40.0, 40.0), "N"), "b": P((-70.0, 70.0)), "c": P((-40.0, 47.0)), "d": P((-190.0, 150.0))},
        {"a": 3.7, "b": 6.2, "c": -0.81, "d": 2.9},
        {"y": 0.12},
        over_input("x", -1.5, 2.5, 120),
        inputs={"x": None},
        check_units=False,
    ),
    Case(
        "vapour pressure",
        "regression",
        "Antoine's equation in a wide box: the pole walks through the data.",
        "y = A - B/(C + T)",
        {"y": None},
        {"A": P((-200.0, 200.0)), "B": P((-18000.0, 18000.0), "K"), "C": P((-2300.0, 900.0), "K")},
        {"A": 16.3, "B": 1750.0, "C": 235.0},
        {"y": 0.02},
        over_input("T", -150.0, 950.0, 90),
        inputs={"T": "K"},
        check_units=False,
    ),
    Case(
        "weld pulse",
        "regression",
        "A pulse of unknown begin and end with steep edges: flat but for two places. The best base is on its bound.",
        "y = low + high*(tanh((t - begin)/edge) - tanh((t - end)/edge))",
        {"y": "kA"},
        {
            "low": P((0.0, 7.0), "kA"),
            "high": P((0.0, 33.0), "kA"),
            "begin": P((-60.0, 730.0), "ms"),
            "end": P((-60.0, 730.0), "ms"),
            "edge": P((0.4, 25.0), "ms"),
        },
        {"low": -0.13, "high": 3.1, "begin": 291.3, "end": 312.6, "edge": 1.9},
        {"y": 0.25},
        over_time(180, 400.0),
        check_units=False,
    ),
    Case(
        "peaks on a decay",
        "regression",
        "Two lines on a background that decays, as in a spectrum, in a box that allows both signs.",
        "y = b*exp(-r*x) + h1*exp(-((x - x1)/w1)^2) + h2*exp(-((x - x2)/w2)^2)",
        {"y": None},
        {
            "b": P((-600.0, 900.0)),
            "r": P((-0.002, 0.4)),
            "h1": P((-700.0, 900.0)),
            "x1": P((-900.0, 1300.0)),
            "w1": P((1.0, 260.0)),
            "h2": P((-700.0, 900.0)),
            "x2": P((-900.0, 1300.0)),
            "w2": P((1.0, 260.0)),
        },
        {"b": 83.0, "r": 0.0113, "h1": 71.0, "x1": 87.4, "w1": 17.2, "h2": 54.0, "x2": 154.1, "w2": 23.1},
        {"y": 2.1},
        over_input("x", 1.0, 250.0, 160),
        inputs={"x": None},
    ),
)
