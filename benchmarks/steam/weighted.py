"""Workload S with the cost that its page defines, a noise draw of one's own, and the static solution to start from."""

import dataclasses

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.data import Steam, steam
from benchmarks.steam.ours import TABLES
from plantfit.models import steam_chamber
from plantfit.optimize import minimise
from plantfit.optimize.contract import Objective, RunResult
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

import jax.numpy as jnp

WORKLOAD_SEED = 1  # of the noise in benchmarks/data.py
NOISE, OPENINGS, NODES = 0.05, 10, 10
FLOOR = OPENINGS * NOISE**2  # bar^2, expected cost of the truth
PAPER_START = {"k": 0.2, "A1": 45.0, "A2": 15.0, "Td": 0.5}  # SYSTEMS.md D


def record(seed: int) -> Steam:
    """Workload S with its noise drawn from `seed`; the clean responses are the same."""
    data = steam()
    return dataclasses.replace(data, y=data.clean + np.random.default_rng(seed).normal(0, NOISE, data.clean.shape))


def weighted(data: Steam) -> Problem:
    """The 310-parameter problem whose cost is the sum over openings of the mean squared error, bar^2.

    plantfit's cost is the mean over all samples. Here each opening's output is multiplied by sqrt(samples / own
    samples), a constant input, in the model as in the record, which makes the two the same number.
    """
    plain = steam_chamber()
    model = dataclasses.replace(
        plain,
        name="weighted_steam_chamber",
        inputs={**plain.inputs, "weight": "1"},
        output=lambda x, u, p: {"y": x["x1"] * u["weight"]},
    )
    records = {}
    for i, n in enumerate(data.samples):
        t = np.r_[0.0, data.period * np.arange(1, n + 1)]
        weight = float(np.sqrt(data.samples.sum() / n))
        signals = {
            "u": Signal(np.full(n + 1, data.opening[i]), "%"),
            "weight": Signal(np.full(n + 1, weight), "1"),
            "y": Signal(weight * np.r_[np.nan, data.y[i, :n]], "bar"),
        }
        records[f"opening{i}"] = Experiment(Recording(t, signals, f"opening{i}"), before={"u": 0.0, "weight": weight})
    own = {name: Parameter(per_recording=True) for name in (*TABLES, "Td")}
    return Problem(model, records, own, substeps=1)


def static(problem: Problem, objective: Objective, seed: int) -> tuple[np.ndarray, RunResult]:
    """The cube point (310,) of four constants for each opening that fit best, and the run that found them.

    Least squares from the paper's start, then from random ones, on the 40 constants: each is one cube coordinate that
    all nodes of a table share, as they share their bounds.
    """
    expand, groups = _expansion(problem)
    assert objective.residuals_and_jacobian is not None
    assert objective.blocks is not None
    assert objective.separable is not None
    whole, blocks, own = objective.residuals_and_jacobian, objective.blocks, objective.separable

    def residuals_and_jacobian(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, jacobian = whole(expand @ c)
        return r, jacobian @ expand

    def chained(c: np.ndarray, wanted: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        found = blocks(expand @ c, wanted)
        return [
            (r, j @ expand[np.ix_(rows, columns)]) for (r, j), rows, columns in zip(found, own, groups, strict=True)
        ]

    guess = problem.space.cube(_physical(problem, PAPER_START)[None])[0]
    small = Objective(
        expand.shape[1],
        lambda zs: objective.costs(zs @ jnp.asarray(expand).T),
        residuals_and_jacobian=residuals_and_jacobian,
        separable=groups,
        blocks=chained,
        start=(guess @ expand / expand.sum(axis=0))[None],
    )
    [found] = minimise(small, "least_squares", budget=3000, seed=seed)
    return expand @ found.x, found


def _expansion(problem: Problem) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """The 0/1 matrix (310, 40) from constants to coordinates, and the columns of each opening."""
    columns: dict[str, int] = {}
    expand = np.zeros((problem.space.dimension, OPENINGS * (len(TABLES) + 1)))
    for row, name in enumerate(problem.space.names):
        constant = f"{name.split('[')[0]}@{_opening(name)}"
        expand[row, columns.setdefault(constant, len(columns))] = 1.0
    groups = [np.array([c for n, c in columns.items() if n.endswith(f"@{i}")]) for i in range(OPENINGS)]
    return expand, tuple(groups)


def _opening(name: str) -> int:
    return int(name.rsplit("[opening", 1)[1].rstrip("]"))


def _physical(problem: Problem, values: dict[str, float]) -> np.ndarray:
    return np.array([values[name.split("[")[0]] for name in problem.space.names])
