"""Answers of plants, and what plantfit itself simulates of them."""

from functools import cache

import numpy as np

import plantfit as pf

HEATER = "x' = (K*delay(u, L) + T0 - x)/tau\nT = x"
ARM = (
    "w' = (gain*delay(u, L) - drag*w*abs(w) - rub*tanh(w/3))/inertia\na' = w\ny = w + 0.01*a\nz = "
    "exp(-abs(a)/50)*sin(a) + max(w, -1)"
)


MASS = "v' = (u - d*v)/m\nx' = v\nF = u - d*v"
ROOTS = "x' = (3 + u - k*sqrt(x))/tau\ns = sqrt(x)\nl = log(x)\nd = log10(x)"
# x, s, l, d
UNDEFINED = [
    [4.0, 2.0, 1.3862943611198906, 0.6020599913279624],
    [0.0, 0.0, -np.inf, -np.inf],
    [-1.0, np.nan, np.nan, np.nan],
]


def answered(text, truth, states, outputs, end, *, count=96, units=None, hold=None):
    """A fit to a noisy simulation whose input jumps at uneven times; the samples are not whole parts of the dead
    time."""
    units = units or {}
    rng = np.random.default_rng(4)
    t = np.linspace(0, end, count)
    u = np.repeat(rng.uniform(-2, 3, count // 8), 8)
    model = pf.equations(text, inputs={"u": units.get("u")}, states=states, outputs={n: units.get(n) for n in outputs},
                         parameters={n: units.get(n) for n in truth}, name="plant")  # fmt: skip
    known = {n: unit for n, unit in units.items() if n in ("u", *outputs)}
    blank = pf.from_arrays({"t": t, "u": u, **{n: 0.0 * t for n in outputs}}, units=known)
    bounds = {n: pf.Parameter((0.5 * v, 1.6 * v)) for n, v in truth.items()}
    # steps that are given need no choosing; what is exported is simulated with finer ones (`fine`)
    clean = pf.Problem(model, blank, bounds, scales=dict.fromkeys(outputs, 1.0), hold=hold, substeps=4)
    y = clean.predict(np.array(list(truth.values())))
    noisy = {n: v + rng.normal(0, 0.01 * np.ptp(v), count) for n, v in y.items()}
    for n in outputs:
        noisy[n][0] = y[n][0]
    measured = pf.from_arrays({"t": t, "u": u, **noisy}, units=known)
    problem = pf.Problem(model, measured, bounds, scales=dict.fromkeys(outputs, 1.0), hold=hold, substeps=4)
    return pf.fit(problem, "least_squares", budget=200, seed=1)


def series(answer):
    (experiment,) = answer.problem.experiments.values()
    return np.asarray(experiment.recording.t), {
        n: np.asarray(experiment.recording[n]) for n in answer.problem.model.inputs
    }


def fine(answer, factor=1.0):
    """plantfit's own simulation by steps so short that their error is far below 1e-6; those of the fit are long."""
    own = _of_short_steps(answer.problem)
    return own.predict(factor * np.array(list(answer.values.values())))


@cache
def _of_short_steps(problem):
    (experiment,) = problem.experiments.values()
    scales, hold = (
        dict.fromkeys(problem.outputs, 1.0),
        dict.fromkeys(problem.predictor.simulator.interpolated, "linear"),
    )
    return pf.Problem(
        problem.model, experiment.recording, problem.space.parameters, scales=scales, hold=hold, substeps=150
    )


def same(found, answer, tolerance=1e-6, factor=1.0):
    for name, y in fine(answer, factor).items():
        assert np.max(np.abs(np.asarray(found[name]) - y)) <= tolerance * np.ptp(y), name
