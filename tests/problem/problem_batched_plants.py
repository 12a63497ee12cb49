"""A plant with everything that a chunk of steps can meet, and a plain loop that simulates it without jax."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Delay, Model
from plantfit.models.parts.tables import lookup
from plantfit.problem import Experiment, Problem
from plantfit.problem.evaluate.record_by_record import RecordByRecord
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

NODES = (-1.0, -0.4, 0.3, 1.1)
VALUES = (0.2, 0.5, 0.1, 0.4)
TRUE = {
    "T1": 0.15, "T2": 0.9, "gain": 1.1, "b": 0.3, "c": 0.2, "a": 0.15, "k": VALUES, "x0": 0.4, "Td": 0.3137,
    "Te": 0.0871, "off": 0.05,
}  # fmt: skip
BOUNDS = {
    "T1": (0.05, 0.5), "T2": (0.3, 3.0), "gain": (0.0, 2.0), "b": (0.0, 1.0), "c": (-1.0, 1.0), "a": (-0.5, 0.5),
    "k": (-1.0, 1.0),
    "x0": (-1.0, 1.0), "Td": (0.1, 1.3), "Te": (0.0, 0.4), "off": (-0.5, 0.5),
}  # fmt: skip
STEP = 1e-30  # of complex differences, which have no rounding error


def model(delays: int, table: bool, outputs: str) -> Model:
    """A nonlinear plant of two states; u and w enter directly or late. `outputs`: "state", or "direct" for two that
    also read inputs."""
    names = [n for n in TRUE if (table or n != "k") and (delays > 0 or n != "Td") and (delays > 1 or n != "Te")]
    late = (Delay("du", "u", "Td"), Delay("dw", "w", "Te"))[:delays]
    return Model(
        name="plant",
        states={"x1": None, "x2": None},
        inputs={"u": None, "w": None},
        outputs={"y": None} if outputs == "state" else {"y": None, "q": None},
        parameters=tuple(Declared(n, bounds=BOUNDS[n], shape=(len(NODES),) if n == "k" else ()) for n in names),
        derivative=lambda x, u, p: rate(x, u, p, lambda values, at: lookup(values, NODES, at)),
        output=output,
        initial_state=lambda p, u0, y0: {"x1": p["x0"] * u0["u"], "x2": p["x0"]},
        delays=late,
    )


def rate(x, u, p, table: Callable):
    """Written with plain arithmetic, so that jax arrays and complex numbers will do."""
    drive, side = u.get("du", u["u"]), u.get("dw", u["w"])
    lost = table(p["k"], x["x2"]) * x["x2"] if "k" in p else 0.0
    return {
        "x1": (p["gain"] * drive - x["x1"] - p["b"] * x["x1"] * x["x1"] * x["x1"]) / p["T1"],
        "x2": (x["x1"] - x["x2"]) / p["T2"] + p["a"] * u["w"] * x["x2"] + p["c"] * side - lost,
    }


def output(x, u, p):
    late = u.get("du", u["u"])
    return {"y": x["x2"] + p["off"], "q": x["x1"] * x["x2"] + 0.3 * u["w"] + 0.2 * late * p["gain"] + 0.02 * u["t"]}


@dataclass(frozen=True)
class Case:
    """What a problem of this plant is made of."""

    lengths: tuple[int, ...] = (150,)
    irregular: bool = False
    delays: int = 0
    dense: bool = False  # a new value of the inputs at every sample, else a single change
    hold: str = "previous"
    substeps: int = 1
    stepper: str = "exponential"
    outputs: str = "state"
    table: bool = False
    missing: bool = False
    fit_to: float = np.inf  # share of each record that is fitted
    parameters: Mapping[str, Parameter | float] | None = None

    def problem(self) -> Problem:
        own = model(self.delays, self.table, self.outputs)
        recordings = {f"r{i}": self._experiment(own, i, n) for i, n in enumerate(self.lengths)}
        return Problem(
            own, recordings, dict(self.parameters or {}), hold=dict.fromkeys(own.inputs, self.hold),
            stepper=self.stepper,
            substeps=self.substeps,
        )  # fmt: skip

    def _experiment(self, own: Model, i: int, n: int) -> Experiment:
        rng = np.random.default_rng([i, n])
        t = 2.0 + (np.r_[0.0, np.cumsum(rng.uniform(0.02, 0.09, n - 1))] if self.irregular else 0.05 * np.arange(n))
        if self.dense:
            signals = {"u": rng.uniform(-1.0, 1.0, n), "w": rng.uniform(-1.0, 1.0, n)}
        else:
            signals = {"u": np.where(np.arange(n) < n // 3, -0.5, 0.8), "w": np.where(np.arange(n) < n // 2, 0.3, -0.6)}
        for name in own.outputs:
            signals[name] = rng.normal(size=n)
            if self.missing:
                signals[name][rng.random(n) < 0.3] = np.nan
        recording = Recording(t, {k: Signal(v) for k, v in signals.items()}, f"r{i}")
        end = np.inf if self.fit_to == np.inf else float(t[int(self.fit_to * (n - 1))]) + 1e-6
        return Experiment(recording, fit=(-np.inf, end))


def direct(problem: Problem) -> RecordByRecord:
    """The same problem, record by record, without chunks."""
    return RecordByRecord(problem.predictor, problem.space, problem.outputs, tuple(problem.data["drive"]))


def points(problem: Problem, n: int, seed: int = 0) -> np.ndarray:
    """Cube points (n, d) away from the bounds."""
    return np.random.default_rng(seed).uniform(0.1, 0.9, (n, problem.space.dimension))


# -- the plain loop ---------------------------------------------------------------------------------


def plain_residuals(case: Case, problem: Problem, z: np.ndarray) -> np.ndarray:
    """Scaled residuals (m,) by a loop over all steps in plain Python."""
    parts = []
    for name, experiment in problem.experiments.items():
        p = {k: np.asarray(v) for k, v in problem.space.tree(np.asarray(problem.space.physical(z)), name).items()}
        record = experiment.recording
        y = _outputs(case, problem.model, p, record)
        for output_name in problem.outputs:
            measured = record[output_name]
            scored = np.isfinite(measured) & experiment.mask("fit")
            parts.append((y[output_name] - measured)[scored] / problem.scales[output_name])
    return np.concatenate(parts)


def _outputs(case: Case, own, p, record: Recording) -> dict[str, np.ndarray]:
    t, linear = record.t, case.hold == "linear"
    delays = {d.channel: (d.input, float(p[d.parameter])) for d in own.delays}
    sources = {**{n: (n, 0.0) for n in own.inputs}, **delays}

    def channels(time, middle):
        held = {c: _value(t, record[n], time - d, middle - d, linear) for c, (n, d) in sources.items()}
        return {**held, "t": time}

    edges = [t[_kinks(t, record[n], linear)] + d for n, d in delays.values()]
    grid = np.unique(np.concatenate([t, *edges]))
    grid = grid[(grid >= t[0]) & (grid <= t[-1])]
    start = own.initial_state(p, channels(t[0], t[0]), {})
    x = np.array([float(start["x1"]), float(start["x2"])])
    states = {t[0]: x}
    for a, b in itertools.pairwise(grid):
        ends = [np.array(list(channels(s, 0.5 * (a + b)).values())) for s in (a, b)]
        for j in range(case.substeps):
            u0, u1 = (ends[0] + (ends[1] - ends[0]) * s for s in (j / case.substeps, (j + 1) / case.substeps))
            x = PLAIN[case.stepper](_packed(own, p, (*sources, "t")), x, u0, u1, (b - a) / case.substeps)
        states[b] = x
    at = [channels(s, s) for s in t]
    rows = [output(dict(zip(("x1", "x2"), states[s], strict=True)), u, p) for s, u in zip(t, at, strict=True)]
    return {n: np.array([r[n] for r in rows]) for n in own.outputs}


def _value(t, u, time, middle, linear):
    if linear:
        return float(np.interp(time, t, u))
    return float(u[max(np.searchsorted(t, middle, side="right") - 1, 0)])


def _kinks(t, u, linear):
    """Samples at which an input does something new."""
    if not linear:
        return np.flatnonzero(np.diff(u, prepend=u[0]) != 0.0)
    slope = np.r_[0.0, np.diff(u) / np.diff(t), 0.0]
    return np.flatnonzero(np.diff(slope) != 0.0)


def _packed(own, p, channels):
    numbers = {k: [float(a) for a in v] if v.ndim else float(v) for k, v in p.items()}

    def f(x, u):
        d = rate(dict(zip(("x1", "x2"), x, strict=True)), dict(zip(channels, u, strict=True)), numbers, _interpolated)
        return np.array([d["x1"], d["x2"]])

    return f


def _interpolated(values, at):
    i = int(np.clip(np.searchsorted(NODES, at.real, side="right") - 1, 0, len(NODES) - 2))
    if not NODES[0] <= at.real < NODES[-1]:
        return values[0 if at.real < NODES[0] else -1]
    return values[i] + (values[i + 1] - values[i]) * (at - NODES[i]) / (NODES[i + 1] - NODES[i])


def jacobian(f, x, u) -> np.ndarray:
    """df/dx by complex differences."""
    return np.column_stack([f(x + 1j * STEP * e, u).imag / STEP for e in np.eye(len(x))])


def drift(f, x, u0, u1) -> np.ndarray:
    """The change of f along the inputs, (df/du) (u1 - u0)."""
    return np.imag(f(x + 0j, u0 + 1j * STEP * (u1 - u0))) / STEP


def exponential(f, x, u0, u1, h):
    """The formula in the docstring of `exponential.exponential`, with numpy's dense solver."""
    z, eye = h * jacobian(f, x, u0), np.eye(len(x))
    d = drift(f, x, u0, u1)
    return x + h * np.linalg.solve(eye - 2 / 3 * z + z @ z / 6, f(x, u0) + d / 2 - z @ (f(x, u0) + d) / 6)


def rosenbrock(f, x, u0, u1, h):
    gamma = 1 - np.sqrt(0.5)
    matrix, d = np.eye(len(x)) - gamma * h * jacobian(f, x, u0), gamma * drift(f, x, u0, u1)
    k1 = np.linalg.solve(matrix, f(x, u0) + d)
    k2 = np.linalg.solve(matrix, f(x + h * k1, u1) - 2 * k1 - d)
    return x + h * (1.5 * k1 + 0.5 * k2)


def rk4(f, x, u0, u1, h):
    middle = 0.5 * (u0 + u1)
    k1 = f(x, u0)
    k2 = f(x + h / 2 * k1, middle)
    k3 = f(x + h / 2 * k2, middle)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3, u1))


PLAIN = {"exponential": exponential, "rosenbrock": rosenbrock, "rk4": rk4}
