"""Plants on which simulating a whole record from a bad start leads nowhere, with noisy records of them."""

import itertools

import numpy as np
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Delay, Model
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal

import jax.numpy as jnp

OSCILLATION = {"w": 5.0, "z": 0.002, "a": 1.3}
PENDULUM = {"k": 9.0, "b": 4.0, "c": 0.3}
LORENZ = {"s": 10.0, "r": 28.0, "b": 8.0 / 3.0}
LAG = {"K": 2.0, "T": 0.7, "Td": 0.33}


def oscillator() -> Model:
    """A free oscillation that dies out slowly."""
    return Model(
        name="oscillator",
        states={"x": None, "v": None},
        inputs={},
        outputs={"y": None},
        parameters=(
            Declared("w", "1/s", (1.0, 12.0)),
            Declared("z", None, (0.0, 0.004)),
            Declared("a", None, (-3.0, 3.0)),
        ),
        derivative=lambda x, u, p: {"x": x["v"], "v": -(p["w"] ** 2) * x["x"] - 2 * p["z"] * p["w"] * x["v"]},
        output=lambda x, u, p: {"y": x["x"]},
        initial_state=lambda p, u0, y0: {"x": p["a"], "v": 0.0},
    )


def oscillation(noise: float = 0.05, seed: int = 0, periods: int = 50, unit: float = 1.0) -> Problem:
    """`periods` periods of the oscillator from the closed form, y in multiples of 1/unit."""
    w, z, a = OSCILLATION.values()
    t = np.linspace(0.0, periods * 2 * np.pi / w, 30 * periods + 1)
    wd = w * np.sqrt(1 - z**2)
    y = a * np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t))
    y = (y + noise * np.random.default_rng(seed).normal(size=len(t))) * unit
    return Problem(oscillator(), Recording(t, {"y": Signal(y)}), {"a": (-3.0 * unit, 3.0 * unit)}, substeps=2)


def pendulum() -> Model:
    """An upright pendulum: angle q from the top, driven by u."""
    return Model(
        name="pendulum",
        states={"q": None, "v": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(
            Declared("k", None, (2.0, 30.0)),
            Declared("b", None, (0.5, 20.0)),
            Declared("c", None, (0.0, 3.0)),
        ),
        derivative=lambda x, u, p: {"q": x["v"], "v": p["k"] * jnp.sin(x["q"]) - p["c"] * x["v"] + p["b"] * u["u"]},
        output=lambda x, u, p: {"y": x["q"]},
        initial_state=lambda p, u0, y0: {"q": 0.05, "v": 0.0},
    )


def balanced(noise: float = 0.005, seed: int = 0, n: int = 500, h: float = 0.02) -> Problem:
    """A pendulum that a PD controller with a wandering reference holds upright; only angle and input are recorded."""
    k, b, c = PENDULUM.values()
    rng = np.random.default_rng(seed)
    reference = np.repeat(rng.uniform(-0.5, 0.5, n // 25 + 1), 25)[:n]
    x, y, u = np.array([0.05, 0.0]), np.zeros(n), np.zeros(n)
    for i in range(n):
        y[i], u[i] = x[0], -6.0 * (x[0] - reference[i]) - 1.5 * x[1]
        x = solve_ivp(
            lambda t, x, v=u[i]: [x[1], k * np.sin(x[0]) - c * x[1] + b * v], (0, h), x, rtol=1e-10, atol=1e-12
        ).y[:, -1]
    y = y + noise * rng.normal(size=n)
    return Problem(pendulum(), Recording(h * np.arange(n), {"u": Signal(u), "y": Signal(y)}), substeps=2)


def lorenz() -> Model:
    """E. N. Lorenz, J. Atmos. Sci. 20 (1963) 130; x and z are measured."""
    return Model(
        name="lorenz",
        states={"x": None, "y": None, "z": None},
        inputs={},
        outputs={"x": None, "z": None},
        parameters=(
            Declared("s", None, (3.0, 20.0)),
            Declared("r", None, (10.0, 50.0)),
            Declared("b", None, (0.5, 6.0)),
            Declared("x0", None, (-20.0, 20.0)),
            Declared("y0", None, (-20.0, 20.0)),
            Declared("z0", None, (0.0, 40.0)),
        ),
        derivative=lambda x, u, p: {
            "x": p["s"] * (x["y"] - x["x"]),
            "y": x["x"] * (p["r"] - x["z"]) - x["y"],
            "z": x["x"] * x["y"] - p["b"] * x["z"],
        },
        output=lambda x, u, p: {"x": x["x"], "z": x["z"]},
        initial_state=lambda p, u0, y0: {"x": p["x0"], "y": p["y0"], "z": p["z0"]},
    )


def chaos(noise: float = 0.5, seed: int = 0, n: int = 500, h: float = 0.02) -> Problem:
    """Ten seconds on the attractor: nine times the time in which neighbours part by a factor e."""
    s, r, b = LORENZ.values()
    exact = solve_ivp(
        lambda t, x: [s * (x[1] - x[0]), x[0] * (r - x[2]) - x[1], x[0] * x[1] - b * x[2]],
        (0.0, h * (n - 1)), [-4.0, -6.0, 15.0], "DOP853", t_eval=h * np.arange(n), rtol=1e-12, atol=1e-12,
    ).y  # fmt: skip
    e = noise * np.random.default_rng(seed).normal(size=exact.shape)
    signals = {"x": Signal(exact[0] + e[0]), "z": Signal(exact[2] + e[2])}
    return Problem(lorenz(), Recording(h * np.arange(n), signals), stepper="rk4", substeps=2)


def lag() -> Model:
    """A stable first-order lag with a dead time."""
    return Model(
        name="lag",
        states={"x": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("K", None, (0.2, 5.0)), Declared("T", "s", (0.1, 3.0)), Declared("Td", "s", (0.0, 1.0))),
        derivative=lambda x, u, p: {"x": (p["K"] * u["late"] - x["x"]) / p["T"]},
        output=lambda x, u, p: {"y": x["x"]},
        initial_state=lambda p, u0, y0: {"x": p["K"] * u0["late"]},
        delays=(Delay("late", "u", "Td"),),
    )


def lag_recording(
    noise: float = 0.05, seed: int = 0, n: int = 300, name: str = "lag", irregular: bool = False
) -> Recording:
    """The lag under random steps, from the closed form between the edges of the late input."""
    K, T, Td = LAG.values()
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(n) if not irregular else np.r_[0.0, np.cumsum(rng.uniform(0.01, 0.09, n - 1))]
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 10 + 1), 10)[:n]
    fine = np.unique(np.r_[t, t + Td])
    x, now = {0.0: K * u[0]}, K * u[0]
    for a, b in itertools.pairwise(fine):
        held = u[max(0, np.searchsorted(t, 0.5 * (a + b) - Td, side="right") - 1)]
        now = K * held + (now - K * held) * np.exp(-(b - a) / T)
        x[float(b)] = now
    y = np.array([x[float(s)] for s in t]) + noise * rng.normal(size=n)
    return Recording(t, {"u": Signal(u), "y": Signal(y)}, name)
