"""Records that forget their start: a deviation of the states at the first sample grows until it is as large as the
motion itself."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plantfit.errors import SearchError, SimulationError
from plantfit.native.kept_programs import Kept, kept
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.missed import STARTS, in_segments
from plantfit.problem.shooting.settling import settles
from plantfit.problem.shooting.start import LOOSE
from plantfit.simulate.simulator import Drive, Simulator

DEVIATION = 1e-7  # of the spread of each state, at the first sample
FORGOTTEN = (
    1e3  # times a deviation grows, from which on the start is forgotten: a thousandth of the motion becomes all of it
)
BETTER = 0.1


@dataclass(frozen=True)
class Forgetting:
    """A deviation of the start of `recording` grows `growth` times at most, and on the way there tenfold in
    `tenfold` seconds."""

    recording: str
    growth: float
    tenfold: float


def forgetting_of_lost(problem: Problem, z: np.ndarray) -> list[Forgetting]:
    """The recordings that forget their start, of a problem whose records are not followed at the cube point z (d,).

    A search may end where the model does not move as the plant does, and deviations grow nowhere, or slower: those of
    an unstable plant do so least at the end of its box, where the simulation runs away least. So they are looked for
    where segments of the records fit best, joined loosely: closing the gaps leads chaos back to where z is. Of segments
    that follow the records at less than `BETTER` of the cost only, else at z, and of no linear model whose deviations
    grow nowhere in the box.
    """
    found = forgetting(problem, z)
    if settles(problem) or (shooting := in_segments(problem)) is None:
        return found
    try:
        shot = shooting.search(starts=STARTS, weights=LOOSE)
    except (SearchError, SimulationError):  # it cannot be simulated in segments either
        return found
    better = shot.cost < BETTER * float(problem.costs(z[None])[0])
    return (forgetting(problem, shot.z) or found) if better else found


def forgetting(problem: Problem, z: np.ndarray) -> list[Forgetting]:
    """The recordings that forget their start at a cube point z (d,), the one that does so soonest first.

    None of models without states or with late ones. Growth is that of a deviation of one state, the most of all states.
    """
    if not problem.predictor.has_steps or problem.predictor.stepping().vector.model.state_delays:
        return []
    simulator, values = problem.predictor.stepping(), problem.space.physical(z)
    states, found = _states(simulator), []
    for name, drive in problem.data["drive"].items():
        if not isinstance(drive, Drive):
            continue
        p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
        zero = np.zeros(len(simulator.vector.states))
        x = np.stack([np.asarray(v) for v in states(p, drive, zero)])
        if not np.all(np.isfinite(x)):
            continue
        spread = np.std(x, axis=1)
        moves, growth = np.flatnonzero(spread > 0), np.zeros(x.shape[1])
        for i in moves:  # one state after the other: a deviation of all may lie where it shrinks
            moved = DEVIATION * spread * (np.arange(len(x)) == i)
            deviation = np.abs(np.stack([np.asarray(v) for v in states(p, drive, moved)]) - x)[moves]
            growth = np.fmax(growth, np.max(deviation / (DEVIATION * spread[moves, None]), axis=0))
        there = np.flatnonzero(growth > FORGOTTEN)
        if len(there):
            first, decades = int(there[0]), np.log10(growth[there[0]])
            t = np.asarray(drive.t)
            found.append(
                Forgetting(name, float(np.max(growth[np.isfinite(growth)])), float((t[first] - t[0]) / decades))
            )
    return sorted(found, key=lambda f: f.tenfold)


@lru_cache(maxsize=16)
def _states(simulator: Simulator) -> Kept:
    """The states of a record of which the first are moved by `offset` (n,): one program for all of them."""

    def states(p, drive, offset):
        first = simulator.initial(p, drive.first_input, drive.first_output)
        return simulator.states(p, drive, tuple(a + b for a, b in zip(first, offset, strict=True)))

    settings = simulator.vector.model, simulator.stepper, simulator.substeps, simulator.interpolated
    return kept(states, "states moved", settings)
