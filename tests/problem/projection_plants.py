"""Plants and curves in which some parameters are linear, with records of noise: what is linear does not depend on
the data."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models import equations
from plantfit.models.model import Declared, Model
from plantfit.problem import Experiment, Problem
from plantfit.problem.linear.affine import affine_by_structure
from plantfit.recording.record import Recording, Signal

N = 60
LAG_TEXT = "x' = (K*u - x)/T; y = x + c", "K T c"


def record(model: Any, seed: int = 0, n: int = N, period: float = 0.1, name: str = "r") -> Recording:
    """Rectangular inputs with noise on them and noisy outputs, all away from zero."""
    rng = np.random.default_rng(seed)
    t = period * np.arange(n)
    signals = dict.fromkeys(getattr(model, "inputs", None) or model.signals)
    values = {s: 1.5 + np.sign(np.sin(3.0 * t + i)) + 0.2 * rng.normal(size=n) for i, s in enumerate(signals)}
    values |= {o: 2.0 + np.cos(2.0 * t) + 0.3 * rng.normal(size=n) for o in model.outputs}
    return Recording(t, {s: Signal(v) for s, v in values.items()}, name)


def problem(
    model: Any, parameters: Mapping[str, Any] | None = None, records: int = 1, steady: bool = False, **settings: Any
) -> Problem:
    made = {f"r{i}": record(model, i, name=f"r{i}") for i in range(records)}
    given: Any = {k: Experiment(r, steady=True) for k, r in made.items()} if steady else made
    return Problem(model, given, parameters or {}, **settings)


def text(lines: str, names: str, **settings: Any) -> Model:
    """A model of equations with input u and output y unless told otherwise; `names` are its parameters."""
    inputs, outputs = settings.pop("inputs", ["u"]), settings.pop("outputs", ["y"])
    parameters = {n: {"bounds": (0.2, 3.0)} for n in names.split()}
    return equations(lines, inputs=inputs, outputs=outputs, parameters=parameters, **settings)


def curve(output: Any, shapes: Mapping[str, tuple[int, ...]]) -> Model:
    """A static Python model y = output(u, p)."""
    parameters = tuple(Declared(n, bounds=(0.2, 3.0), shape=s) for n, s in shapes.items())
    return Model(
        name="curve", states={}, inputs={"u": None}, outputs={"y": None}, parameters=parameters,
        output=lambda x, u, p: {"y": output(u["u"], p)},
    )  # fmt: skip


def linear_names(model: Any, parameters: Mapping[str, Any] | None = None, **settings: Any) -> list[str]:
    """What the equations alone say."""
    made = problem(model, parameters, **settings)
    return [made.space.names[i] for i in affine_by_structure(made)]


NIST = Path(__file__).parents[1] / "models" / "nist_strd"
