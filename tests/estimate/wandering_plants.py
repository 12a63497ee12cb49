"""A first-order plant with process noise, simulated exactly by numpy, and its likelihood by the scalar recursion."""

import numpy as np

from plantfit import Problem, equations, from_arrays

TRUTH = {"K": 2.0, "tau": 0.5}
PROCESS, MEASUREMENT, PERIOD = 0.3, 0.05, 0.05


def record(
    seed, n=300, truth=TRUTH, process=PROCESS, measurement=MEASUREMENT, after=None, name="run", hold=15, before=None
):
    """u and y; `truth` holds from sample `after` on, `before` (default TRUTH) until then. A dead time L delays u.
    The state begins at 0."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.0, 1.0, n // hold + 1).repeat(hold)[:n]
    x = np.zeros(n)
    for k in range(n - 1):
        p = (before or TRUTH) if after is not None and k < after else truth
        f = np.exp(-PERIOD / p["tau"])
        q = process * np.sqrt(0.5 * p["tau"] * (1 - f * f))
        whole, share = divmod(p.get("L", 0.0) / PERIOD, 1.0)
        old, new = (u[max(k - int(whole) - back, 0)] for back in (1, 0))
        edge = np.exp(-PERIOD * (1 - share) / p["tau"])  # what is left of the part before the edge of the late input
        x[k + 1] = f * x[k] + p["K"] * ((edge - f) * old + (1 - edge) * new) + q * rng.standard_normal()
    return from_arrays(
        period=PERIOD, signals={"u": (u, "V"), "y": (x + measurement * rng.standard_normal(n), "K")}, name=name
    )


LATE = TRUTH | {"L": 0.33}  # 6.6 samples


def problem(recording, late=False, **more):
    """The plant in boxes that are not centred at the truth; `late`: with a dead time L of its input."""
    own = {"L": {"bounds": (0.0, 1.0), "unit": "s"}} if late else {}
    model = equations(
        f"x' = (K*{'delay(u, L)' if late else 'u'} - x)/tau\ny = x",
        name="lag",
        inputs={"u": "V"},
        states={"x": {"unit": "K", "initial": 0.0}},
        outputs={"y": "K"},
        parameters={
            "K": {"bounds": (0.1, 30.0), "unit": "K/V", "scale": "log"},
            "tau": {"bounds": (0.05, 10.0), "unit": "s", "scale": "log"},
            **own,
        },
    )
    return Problem(model, recording, substeps=1, **more)


def minus_log_likelihood(recording, k, tau, process, measurement, initial):
    """The scalar Kalman filter as textbooks print it."""
    f = np.exp(-PERIOD / tau)
    q, r = process**2 * 0.5 * tau * (1 - f * f), measurement**2
    m, p, total = 0.0, initial**2, 0.0
    for u, y in zip(recording["u"], recording["y"], strict=True):
        s = p + r
        total += 0.5 * ((y - m) ** 2 / s + np.log(2 * np.pi * s))
        m, p = m + p / s * (y - m), p * r / s
        m, p = f * m + k * (1 - f) * u, f * f * p + q
    return total


STUDY = """\
name = "lag"
[recording.bench]
file = "bench.csv"
time = "t"
[model]
equations = \"\"\"
x' = (K*u - x)/tau
y = x
\"\"\"
inputs = { u = "V" }
states = { x = { unit = "K", initial = 0 } }
outputs = { y = "K" }
[parameters]
K = { unit = "K/V", bounds = [0.1, 30], scale = "log" }
tau = { unit = "s", bounds = [0.05, 10], scale = "log" }
[simulation]
substeps = 1
[search]
budget = 400
"""


def save(recording, path):
    """A CSV with times, u and y."""
    rows = np.column_stack([recording.t, recording["u"], recording["y"]])
    np.savetxt(path, rows, delimiter=",", header="t,u,y", comments="", fmt="%.9g")
