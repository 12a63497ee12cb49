"""The plant of the engine's timings: stiff, two states, twelve parameters, a held input with many edges."""

import numpy as np

from plantfit.models.model import Declared, Model

PARAMETERS = {
    "a0": 0.2, "a1": 1.1, "a2": -0.15, "a3": 0.05, "T1": 0.004, "T2": 0.8, "c": 0.05, "b": 0.1, "d": 0.08, "e": 0.3,
    "x10": 0.1, "x20": -0.2,
}  # fmt: skip
PERIOD = 0.01  # s, 2.5 times the fast time constant


def rate(x1, x2, u, p):
    """d(x1, x2)/dt; works on floats and on jax scalars."""
    gain = p["a0"] + p["a1"] * u + p["a2"] * u * u + p["a3"] * u * u * u
    return (gain - x1 - p["c"] * x1 * x1 * x1) / p["T1"], (x1 - x2 - p["b"] * x2 * x2 * x2) / p["T2"] + p["d"] * u * x2


def jacobian(x1, x2, u, p):
    """The derivative of `rate` by (x1, x2), as rows."""
    return [
        [(-1.0 - 3.0 * p["c"] * x1 * x1) / p["T1"], 0.0],
        [1.0 / p["T2"], (-1.0 - 3.0 * p["b"] * x2 * x2) / p["T2"] + p["d"] * u],
    ]


def model() -> Model:
    """The plant for plantfit; y = x2 + e x1."""

    def derivative(x, u, p):
        d1, d2 = rate(x["x1"], x["x2"], u["u"], p)
        return {"x1": d1, "x2": d2}

    return Model(
        name="stiff",
        states={"x1": None, "x2": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=tuple(Declared(n, bounds=(v - 0.5 * abs(v), v + 0.6 * abs(v))) for n, v in PARAMETERS.items()),
        derivative=derivative,
        output=lambda x, u, p: {"y": x["x2"] + p["e"] * x["x1"]},
        initial_state=lambda p, u0, y0: {"x1": p["x10"], "x2": p["x20"]},
    )


def record(samples: int, hold: int = 50, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s and an input (n,) with a new random level every `hold` samples."""
    levels = np.random.default_rng(seed).uniform(-1.5, 1.5, samples // hold + 1)
    return PERIOD * np.arange(samples), np.repeat(levels, hold)[:samples]
