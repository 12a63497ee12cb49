"""Records that forget their start: a deviation of the states at the first sample grows until it is as large as the motion itself."""

from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Drive

import jax

DEVIATION = 1e-7  # of the spread of each state, at the first sample
FORGOTTEN = 1e3  # times a deviation grows, from which on the start is forgotten: a thousandth of the motion becomes all of it


@dataclass(frozen=True)
class Forgetting:
    """A deviation of the start of `recording` grows `growth` times at most, and on the way there tenfold in `tenfold` seconds."""

    recording: str
    growth: float
    tenfold: float


def forgetting(problem: Problem, z: np.ndarray) -> list[Forgetting]:
    """The recordings that forget their start at a cube point z (d,), the one that does so soonest first.

    None of models without states or with late ones. Growth is that of a deviation of one state, the most of all states.
    """
    if not problem.predictor.has_steps or problem.predictor.stepping().vector.model.state_delays:
        return []
    simulator, values = problem.predictor.stepping(), problem.space.physical(z)
    states = jax.jit(simulator.states)
    found = []
    for name, drive in problem.data["drive"].items():
        if not isinstance(drive, Drive):
            continue
        p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
        x = np.stack([np.asarray(v) for v in states(p, drive)])
        if not np.all(np.isfinite(x)):
            continue
        spread = np.std(x, axis=1)
        moves, growth = np.flatnonzero(spread > 0), np.zeros(x.shape[1])
        for i in moves:  # one state after the other: a deviation of all may lie where it shrinks
            moved = tuple(x[:, 0] + DEVIATION * spread * (np.arange(len(x)) == i))
            deviation = np.abs(np.stack([np.asarray(v) for v in states(p, drive, moved)]) - x)[moves]
            growth = np.fmax(growth, np.max(deviation / (DEVIATION * spread[moves, None]), axis=0))
        there = np.flatnonzero(growth > FORGOTTEN)
        if len(there):
            first, decades = int(there[0]), np.log10(growth[there[0]])
            t = np.asarray(drive.t)
            found.append(Forgetting(name, float(np.max(growth[np.isfinite(growth)])), float((t[first] - t[0]) / decades)))
    return sorted(found, key=lambda f: f.tenfold)
