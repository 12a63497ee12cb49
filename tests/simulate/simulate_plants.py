"""A stiff plant with thirteen parameters, written twice: for plantfit, and in plain numbers for scipy."""

import itertools

import numpy as np
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Delay, Model

P = {
    "a0": 0.3, "a1": 1.2, "a2": -0.2, "a3": 0.07, "T1": 0.02, "T2": 1.5, "c": 0.05, "b": 0.2, "d": 0.1, "e": 0.0,
    "x10": 0.5, "x20": -0.3,
    "Td": 0.37,
}  # fmt: skip


def rate(x1, x2, u, ud, p):
    gain = p["a0"] + p["a1"] * ud + p["a2"] * ud**2 + p["a3"] * ud**3
    return (gain - x1 - p["c"] * x1**3) / p["T1"], (x1 - x2 - p["b"] * x2**3) / p["T2"] + p["d"] * u * x2


def stiff() -> Model:
    """x1 follows a polynomial of the late input with T1 = 20 ms, x2 follows x1 with T2 = 1.5 s; y = x2 + e x1."""

    def derivative(x, u, p):
        d1, d2 = rate(x["x1"], x["x2"], u["u"], u["late"], p)
        return {"x1": d1, "x2": d2}

    return Model(
        name="stiff",
        states={"x1": None, "x2": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=tuple(Declared(n) for n in P),
        derivative=derivative,
        output=lambda x, u, p: {"y": x["x2"] + p["e"] * x["x1"]},
        initial_state=lambda p, u0, y0: {"x1": p["x10"], "x2": p["x20"]},
        delays=(Delay("late", "u", "Td"),),
    )


def record(irregular: bool = False, n: int = 60, seed: int = 3):
    """Times (n,) s and an input (n,) that changes in steps every few samples."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(n)
    if irregular:
        t = np.r_[0.0, np.cumsum(rng.uniform(0.03, 0.2, n - 1))]
    return t, np.repeat(rng.uniform(-1.5, 1.5, size=n // 6 + 1), 6)[:n]


def exact(p, t, u, hold="previous", before=None):
    """States (2, n) by LSODA, begun anew wherever the input or its late copy has an edge."""
    before = u[0] if before is None else before
    stops = np.unique(np.r_[t, t + p["Td"]])
    stops = stops[(stops >= t[0]) & (stops <= t[-1])]
    states = {float(t[0]): np.array([p["x10"], p["x20"]])}
    x = states[float(t[0])]

    def at(time, middle):
        if hold == "linear":
            return float(np.interp(time, t, u, left=before))
        k = np.searchsorted(t, middle, side="right") - 1
        return float(before if k < 0 else u[k])

    for a, b in itertools.pairwise(stops):
        if b - a > 1e-13:
            middle = 0.5 * (a + b)
            f = lambda s, x, m=middle: rate(x[0], x[1], at(s, m), at(s - p["Td"], m - p["Td"]), p)  # noqa: E731
            x = solve_ivp(f, (a, b), x, "LSODA", rtol=1e-11, atol=1e-13).y[:, -1]
        states[float(b)] = x
    return np.array([states[float(s)] for s in t]).T
