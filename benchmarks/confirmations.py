"""What an answer's confirmation costs: whole records by the tight solver with rates on floats, and with the compiled
rate.

    python -m benchmarks.confirmations

Both ways alternate in one process; the ratio is that of processor time. States must agree to the solver's tolerance.
"""

import contextlib
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.library.catalogue import make
from plantfit.models.model import Model
from plantfit.models.text.equations import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.check import mode_equations, tight
from plantfit.space import Parameter

PAIRS = 3
T = 0.02 * np.arange(600)
STICKS = "x' = v\nv' = (k*u - c*x - d*v - friction(v, Fc, Fs))/1.3\ny = x"


def run(pairs: int = PAIRS) -> dict[str, float]:
    """Print and return how many times the processor time falls, by kind of model."""
    found = {}
    for name, (problem, p) in _problems().items():
        [drive], simulator = problem.data["drive"].values(), problem.predictor.stepping()
        times, states = [], []
        for k in range(pairs + 1):  # the first pair compiles
            both = []
            for floats in (True, False) if k % 2 else (False, True):
                seconds, followed = _timed(lambda s=simulator, p=p, d=drive: tight.follow(s, p, d), floats)
                both.append((floats, seconds))
                states.append(followed.states)
            times.append([seconds for _, seconds in sorted(both)])
        size = np.maximum(np.max(np.abs(states[0]), axis=1, keepdims=True), 1e-12)
        if not all(np.max(np.abs(s - states[0]) / size) < 1e-6 for s in states):
            raise SystemExit(f"{name}: the two ways do not end in the same states.")
        compiled, floats = np.median(np.array(times[1:]), axis=0)
        found[f"confirmation_{name.replace(' ', '_')}"] = float(compiled / floats)
        print(
            f"{name:28s} {1e3 * compiled:7.0f} ms compiled, {1e3 * floats:6.0f} "
            f"ms on floats: {compiled / floats:5.1f} times less"
        )
    return found


def _timed(work: Callable[[], Any], floats: bool) -> tuple[float, Any]:
    with contextlib.ExitStack() as compiled:
        if not floats:
            compiled.enter_context(patch.object(tight, "plain_rate", lambda *_: None))
            compiled.enter_context(patch.object(mode_equations.ModeFunction, "__call__", _by_jax))
        began = time.process_time()
        result = work()
        return time.process_time() - began, result


def _by_jax(
    self: mode_equations.ModeFunction, x: np.ndarray, u: np.ndarray, du: np.ndarray, mode: np.ndarray, p: Any
) -> Any:
    """The equations of a mode by their compiled program."""
    return self.by_jax([v.tolist() for v in (x, u, du, mode)], p.arrays)


def _problems() -> dict[str, tuple[Problem, dict[str, Any]]]:
    steps = np.where(np.arange(len(T)) // 50 % 2 == 0, 6.0, -4.0)
    random = np.random.default_rng(1).uniform(-6.0, 6.0, len(T))
    motor = make("dc_motor", tied=True)
    constants = {"Rm": 2.8, "Lm": 0.045, "Kb": 0.09, "Jm": 0.0023, "Cm": 0.0023, "Tf": 5e-5}
    chamber = make("steam_chamber", opening_nodes=[0, 50, 100], nodes=[0, 5, 20], dead_time=False)
    surrogate = make("hammerstein_wiener", order=2, input_curve="table", output_curve="none")
    assert isinstance(motor, Model)
    assert isinstance(chamber, Model)
    assert isinstance(surrogate, Model)
    declared = {n: {"bounds": (0.1, 9.0)} for n in ("k", "c", "d", "Fc", "Fs")}
    sticks = equations(STICKS, states=["x", "v"], inputs=["u"], outputs=["y"], parameters=declared)
    return {
        "motor, held input": _problem(motor, random, constants),
        "motor, square wave": _problem(motor, steps, constants),
        "tables over two signals": _problem(chamber, 50.0 + 5.0 * steps, _middle(chamber)),
        "table at the input": _problem(surrogate, 0.2 * random, _middle(surrogate)),
        "friction that sticks": _problem(
            sticks, 3.0 * np.sin(0.9 * T), {"k": 2.0, "c": 3.0, "d": 0.4, "Fc": 0.7, "Fs": 1.1}
        ),
    }


def _middle(model: Model) -> dict[str, Any]:
    """Values in the middle of the bounds."""
    found = {}
    for d in model.parameters:
        low, high = d.bounds or (0.5, 2.0)
        middle = np.sqrt(low * high) if d.scale == "log" else 0.5 * (low + high)
        found[d.name] = np.full(d.shape, middle) + (
            0.1 * abs(middle) * np.arange(np.prod(d.shape)).reshape(d.shape) if d.shape else 0.0
        )
    return found


def _problem(model: Model, u: np.ndarray, values: dict[str, Any]) -> tuple[Problem, dict[str, Any]]:
    signals = {n: Signal(u) for n in model.inputs} | {n: Signal(np.zeros(len(T))) for n in model.outputs}
    held = {d.name: values[d.name] for d in model.parameters}
    return Problem(model, Recording(T, signals), {n: Parameter(value=v) for n, v in held.items()}), held


if __name__ == "__main__":
    run()
