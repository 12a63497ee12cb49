"""A motor and a tank with white noise on their rates, simulated and filtered by plain numpy."""

import numpy as np
from scipy.linalg import expm

from plantfit import equations, from_arrays
from plantfit.estimate import Noise

TRUTH = {"Ra": 2.759854, "La": 1.118658e-2, "kw": 5.008705e-3, "B": 1.13284e-6, "J": 2.2748e-8}
PROCESS, MEASUREMENT = {"i": 1.0, "w": 300.0}, {"i": 0.01, "w": 2.0}
INITIAL = {"i": 0.1, "w": 10.0}
NOISE = Noise(PROCESS, MEASUREMENT, INITIAL)


def robot_motor():
    """Motor of SYSTEMS.md C with kt = kw and no load: current and speed."""
    wide = {name: (value / 3.1, value * 2.3) for name, value in TRUTH.items()}
    units = {"Ra": "ohm", "La": "H", "kw": "V*s/rad", "B": "N*m*s/rad", "J": "kg*m^2"}
    return equations(
        "i' = (V - Ra*i - kw*w)/La\nw' = (kw*i - B*w)/J",
        name="robot motor",
        inputs={"V": "V"},
        states={"i": "A", "w": "rad/s"},
        outputs={"i": "A", "w": "rad/s"},
        parameters={n: {"unit": units[n], "bounds": wide[n], "scale": "log"} for n in TRUTH},
    )


def motor_matrices(h, p=TRUTH, process=PROCESS):
    """F, B (n,) and Q of one step of h seconds with V held."""
    a = np.array([[-p["Ra"] / p["La"], -p["kw"] / p["La"]], [p["kw"] / p["J"], -p["B"] / p["J"]]])
    d = np.diag([process["i"] ** 2, process["w"] ** 2])
    big = expm(h * np.block([[-a, d], [np.zeros((2, 2)), a.T]]))
    f = big[2:, 2:].T
    q = f @ big[:2, 2:]
    return f, np.linalg.solve(a, (f - np.eye(2)) @ np.array([1.0 / p["La"], 0.0])), 0.5 * (q + q.T)


def motor_record(seed, n=400, h=1e-3, t=None, process=PROCESS, measurement=MEASUREMENT, name="run"):
    """A recording of i and w under a random telegraph of 0 and 3 V, and the true states (n, 2)."""
    rng = np.random.default_rng(seed)
    t = h * np.arange(n) if t is None else t
    voltage = 3.0 * (rng.random(len(t) // 20 + 1) < 0.5).repeat(20)[: len(t)]
    x = np.zeros((len(t), 2))
    x[0] = rng.standard_normal(2) * list(INITIAL.values())
    for k in range(len(t) - 1):
        f, b, q = motor_matrices(t[k + 1] - t[k], process=process)
        x[k + 1] = f @ x[k] + b * voltage[k] + np.linalg.cholesky(q) @ rng.standard_normal(2)
    y = x + rng.standard_normal(x.shape) * list(measurement.values())
    signals = {"V": (voltage, "V"), "i": (y[:, 0], "A"), "w": (y[:, 1], "rad/s")}
    return from_arrays(t, signals=signals, name=name), x


def numpy_filter(recording, p=TRUTH, process=PROCESS, measurement=MEASUREMENT):
    """Means, covariances and log-likelihood by the textbook recursion in covariance form; NaN outputs are left out
    row by row."""
    y, v, t = np.stack([recording["i"], recording["w"]], axis=1), recording["V"], recording.t
    m, c, total = np.zeros(2), np.diag(np.square(list(INITIAL.values()))), 0.0
    means, covariances = [], []
    for k in range(len(t)):
        if k:
            f, b, q = motor_matrices(t[k] - t[k - 1], p, process)
            m, c = f @ m + b * v[k - 1], f @ c @ f.T + q
        seen = np.flatnonzero(np.isfinite(y[k]))
        if len(seen):
            h = np.eye(2)[seen]
            s = h @ c @ h.T + np.diag(np.square(list(measurement.values())))[np.ix_(seen, seen)]
            gain, error = c @ h.T @ np.linalg.inv(s), y[k, seen] - h @ m
            total -= 0.5 * (error @ np.linalg.solve(s, error) + np.linalg.slogdet(2 * np.pi * s)[1])
            m, c = m + gain @ error, c - gain @ s @ gain.T
        means.append(m)
        covariances.append(c)
    return np.array(means), np.array(covariances), total


def tank():
    """A tank that empties by Torricelli: one state, nonlinear."""
    return equations(
        "level' = (flow - k*sqrt(level))/area",
        name="tank",
        inputs={"flow": "m^3/s"},
        states={"level": {"unit": "m", "initial": 1.0}},
        outputs={"level": "m"},
        parameters={"k": {"bounds": (0.1, 1.5)}, "area": {"unit": "m^2", "bounds": (0.5, 8.0), "scale": "log"}},
    )


TANK = {"k": 0.5, "area": 2.0}
TANK_NOISE = Noise({"level": 0.02}, {"level": 0.05}, {"level": 0.1})


def tank_record(seed, n=300, h=0.5, fine=50):
    """A recording of a tank under random inflow, by Euler-Maruyama in `fine` steps a sample, and its true level
    (n,)."""
    rng = np.random.default_rng(seed)
    flow = rng.uniform(0.2, 0.9, n // 15 + 1).repeat(15)[:n]
    level = np.empty(n)
    level[0] = 1.0 + 0.1 * rng.standard_normal()
    for k in range(n - 1):
        x = level[k]
        for push in rng.standard_normal(fine) * 0.02 * np.sqrt(h / fine):
            x = max(x + h / fine * (flow[k] - 0.5 * np.sqrt(x)) / 2.0 + push, 1e-3)
        level[k + 1] = x
    return from_arrays(
        period=h, signals={"flow": (flow, "m^3/s"), "level": (level + 0.05 * rng.standard_normal(n), "m")}
    ), level
