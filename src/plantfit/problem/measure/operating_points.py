"""Where on its tables a model works along the recordings, and which entries that touches."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tables import Table
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.simulator import Drive

import jax.numpy as jnp


def operating_points(problem: Problem, values: Any) -> dict[str, dict[str, np.ndarray]]:
    """By fitted recording the signals that the model's tables are over, each (n,), simulated at `values` (d,).

    The n samples are those up to the last fitted one: what comes before the fitted part is simulated too.
    """
    wanted = {signal for table in getattr(problem.model, "tables", ()) for signal in table.over}
    if not wanted:
        return {}
    found, values = {}, jnp.asarray(values)
    for name, (drive, n) in _drives(problem).items():
        signals = problem.compiled["trajectories"](problem.space.tree(values, name), drive)
        found[name] = {s: np.asarray(v)[:n] for s, v in signals.items() if s in wanted}
    return found


def _drives(problem: Problem) -> dict[str, tuple[Any, int]]:
    """The drives of the fitted parts and their samples n; moving records held on to the length of the longest share
    one program."""
    drives = problem.data["drive"]
    # a drive has other times between its samples, as those of nodes in time
    moving = {n: len(d.t if d.samples is None else d.samples) for n, d in drives.items() if isinstance(d, Drive)}
    most = max(moving.values(), default=0)
    made = {}
    for name, drive in drives.items():
        if name not in moving:
            made[name] = drive, len(drive.value[0])
        elif moving[name] == most or getattr(problem.model, "state_delays", ()):
            made[name] = drive, moving[name]
        else:
            made[name] = problem.predictor.drive(_held_on(problem.experiments[name], moving[name], most)), moving[name]
    return made


def _held_on(experiment: Experiment, n: int, most: int) -> Experiment:
    """The first n samples of a recording, then its last values up to `most`."""
    r = experiment.recording
    t = np.r_[r.t[:n], r.t[n - 1] + np.arange(1, most - n + 1) * np.median(np.diff(r.t[:n]))]
    signals = {k: Signal(np.r_[s.values[:n], np.full(most - n, s.values[n - 1])], s.unit) for k, s in r.signals.items()}
    return replace(experiment, recording=Recording(t, signals, r.name))


def hat_weights(table: Table, points: Mapping[str, np.ndarray]) -> np.ndarray:
    """Weight (n, *shape) of every entry at every operating point (n,); those of one point add up to 1.

    The value that a table gives is the sum of its entries by these weights (`models.parts.tables.lookup`, eq. 3). A
    point that is not finite has no weight.
    """
    parts = [
        _of_axis(np.asarray(nodes), np.asarray(points[signal]))
        for signal, nodes in zip(table.over, table.nodes, strict=True)
    ]
    return parts[0] if len(parts) == 1 else parts[0][:, :, None] * parts[1][:, None, :]


def _of_axis(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    here = np.isfinite(x)
    inside = np.clip(np.where(here, x, nodes[0]), nodes[0], nodes[-1])
    cell = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, len(nodes) - 2)
    share = (inside - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    weights, row = np.zeros((len(x), len(nodes))), np.arange(len(x))
    weights[row, cell], weights[row, cell + 1] = 1.0 - share, share
    return weights * here[:, None]
