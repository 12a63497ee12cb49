"""A heater of first order and a straight line, of which everything is known."""

import numpy as np

import plantfit as pf

TRUTH = {"K": 0.6, "T0": 21.0, "tau": 30.0}

SPEC = """\
name = "heater"
[recording.bench]
file = "heater.csv"
signals = { u = "u", T = "T" }
split = 0.7
[model]
equations = \"\"\"
x' = (K*u + T0 - x)/tau
T = x
\"\"\"
inputs = { u = "W" }
states = { x = { unit = "degC", initial = "T0" } }
outputs = { T = "degC" }
[parameters.K]
bounds = [0.01, 10.0]
unit = "degC/W"
[parameters.T0]
bounds = [0.0, 50.0]
unit = "degC"
[parameters.tau]
bounds = [1.0, 500.0]
scale = "log"
unit = "s"
[search]
methods = ["least_squares"]
runs = 2
budget = 400
seed = 3
"""


def response(t, u, K=0.6, T0=21.0, tau=30.0):
    """The temperature (n,) in closed form for a power (n,) that is held between samples."""
    x = np.empty(len(t))
    x[0] = T0
    for k in range(1, len(t)):
        rest = K * u[k - 1] + T0
        x[k] = rest + (x[k - 1] - rest) * np.exp(-(t[k] - t[k - 1]) / tau)
    return x


def heated(t, period=80.0, noise=0.05, name="bench", seed=1):
    """A recording of the heater under a square wave of 50 W."""
    u = np.where((t // (period / 2)) % 2 == 0, 50.0, 0.0)
    y = response(t, u) + noise * np.random.default_rng(seed).normal(size=len(t))
    return pf.from_arrays({"t": t, "u": (u, "W"), "T": (y, "degC")}, name=name)


def heater_model():
    return pf.equations(
        "x' = (K*u + T0 - x)/tau\nT = x",
        inputs={"u": "W"},
        states={"x": {"unit": "degC", "initial": "T0"}},
        outputs={"T": "degC"},
        parameters={
            "K": {"unit": "degC/W", "bounds": (0.01, 10.0)},
            "T0": {"unit": "degC", "bounds": (0.0, 50.0)},
            "tau": {"unit": "s", "bounds": (1.0, 500.0), "scale": "log"},
        },
        name="heater",
    )


def heater_answer(**more):
    t = np.arange(0.0, 240.0, 2.0)
    problem = pf.Problem(heater_model(), heated(t), split=0.7, name="heater", **more)
    return pf.fit(problem, "least_squares", budget=400, seed=3)


def line(text="y = a*u + c", noise=0.1, **parameters):
    """A line y = 2 u + 1 over u from 0 to 3, as a model without time."""
    u = np.linspace(0.0, 3.0, 40)
    y = 2.0 * u + 1.0 + noise * np.random.default_rng(5).normal(size=len(u))
    given = {"a": {"bounds": (-10.0, 10.0)}, "c": {"bounds": (-10.0, 10.0)}, **parameters}
    model = pf.equations(text, inputs=["u"], outputs=["y"], parameters=given, name="line")
    return pf.Problem(model, pf.from_arrays({"u": u, "y": y}, period=1.0, name="rows"), name="line"), u, y


def write_study(folder):
    """The heater as a study file with its recording; the path of the file."""
    t = np.arange(0.0, 240.0, 2.0)
    r = heated(t)
    rows = ["t [s],u [W],T [degC]", *(f"{a:g},{b:g},{c:.6f}" for a, b, c in zip(t, r["u"], r["T"], strict=True))]
    (folder / "heater.csv").write_text("\n".join(rows))
    (folder / "heater.toml").write_text(SPEC)
    return folder / "heater.toml"


def lasting(findings):
    """The findings without times of computation, which differ in every process."""
    made = {k: v for k, v in findings["reproduction"].items() if k != "seconds"}
    return {**findings, "reproduction": made}
