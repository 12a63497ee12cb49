"""Workload S as a plantfit problem."""

from collections.abc import Callable

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.data import Steam, steam
from plantfit.models import steam_chamber
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

import jax
import jax.numpy as jnp

TABLES = ("k", "A1", "A2")


def problem(data: Steam, substeps: int | None = 1, stepper: str = "exponential") -> Problem:
    """Ten records, each a step from rest, with tables and dead time of their own: 310 parameters."""
    records = {}
    for i, n in enumerate(data.samples):
        t = np.r_[0.0, data.period * np.arange(1, n + 1)]
        signals = {"u": Signal(np.full(n + 1, data.opening[i]), "%"), "y": Signal(np.r_[np.nan, data.y[i, :n]], "bar")}
        records[f"opening{i}"] = Experiment(Recording(t, signals, f"opening{i}"), before={"u": 0.0})
    own = {name: Parameter(per_recording=True) for name in (*TABLES, "Td")}
    return Problem(steam_chamber(), records, own, substeps=substeps, stepper=stepper)


def cube(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """Cube points (P, 310) from candidates (P, 310) in the layout of benchmarks/data.py: rows of k[10], A1[10],
    A2[10], Td."""
    rows = np.asarray(theta, dtype=float).reshape(len(theta), 10, 31)
    place = {name: i for i, name in enumerate(problem.space.names)}
    values = np.empty((len(theta), 310))
    for i in range(10):
        for t, name in enumerate(TABLES):
            for j in range(10):
                values[:, place[f"{name}[{j}][opening{i}]"]] = rows[:, i, 10 * t + j]
        values[:, place[f"Td[opening{i}]"]] = rows[:, i, 30]
    return problem.space.cube(values)


def ours() -> dict[str, tuple[Callable, int]]:
    """{label: (call, batch)} for the table."""
    data = steam()
    whole = problem(data)
    truth = jnp.asarray(cube(whole, data.truth.reshape(1, -1)))
    rows: dict[str, tuple[Callable, int]] = {}
    compiled, arguments = whole.compiled, whole.arguments
    for batch in (1, 20, 200):
        zs = truth if batch == 1 else jnp.asarray(cube(whole, data.draw(batch, 5)))
        rows[f"plantfit {batch}"] = (lambda zs=zs: jax.block_until_ready(compiled["costs"](zs, arguments)), batch)
    several = jnp.asarray(cube(whole, data.draw(20, 5)))
    rows["plantfit gradient 1"] = (lambda: jax.block_until_ready(compiled["values_and_gradients"](truth, arguments)), 1)
    rows["plantfit gradient 20"] = (
        lambda: jax.block_until_ready(compiled["values_and_gradients"](several, arguments)),
        20,
    )
    rows["plantfit block jacobian 1"] = (lambda: jax.block_until_ready(compiled["blocks"](truth[0], arguments)), 1)
    return rows
