"""Records that forget their start: a deviation of the states at the first sample grows until it is as large as the
motion itself."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plantfit.errors import SearchError, SimulationError
from plantfit.native.kept_programs import Kept, kept
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.start import LOOSE, Shooting
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.structure import is_linear
from plantfit.sobol import Sobol

import jax
import jax.numpy as jnp

DEVIATION = 1e-7  # of the spread of each state, at the first sample
FORGOTTEN = (
    1e3  # times a deviation grows, from which on the start is forgotten: a thousandth of the motion becomes all of it
)
SEGMENTS, SHORTEST = 100, 5  # of the longest record, and samples of each at least
STARTS = 4  # of multiple shooting
LONG, MANY = 20_000, 60  # samples of all records, and coordinates, beyond which that takes too long
BETTER = 0.1
POINTS = 256  # of the box, and as many corners, at which a linear model is asked whether it is stable
SLOW = 0.3 * np.log(FORGOTTEN)  # growth, as a logarithm, that is far from forgetting


@dataclass(frozen=True)
class Forgetting:
    """A deviation of the start of `recording` grows `growth` times at most, and on the way there tenfold in
    `tenfold` seconds."""

    recording: str
    growth: float
    tenfold: float


def forgetting_of_lost(problem: Problem, z: np.ndarray) -> list[Forgetting]:
    """The recordings that forget their start, of a problem whose records are not followed at the cube point z (d,).

    A search may end where the model does not move as the plant does, and deviations do not grow. So where none is found
    at z, they are looked for where segments of the records fit best, joined loosely: closing the gaps leads chaos back
    to where z is. Of segments that follow the records at less than `BETTER` of the cost only, and of no linear model
    whose deviations grow nowhere in the box.
    """
    if found := forgetting(problem, z):
        return found
    if _settles(problem):
        return []
    samples = [len(d.t) for d in problem.data["drive"].values() if isinstance(d, Drive)]
    if not samples or max(samples) < 2 * SHORTEST or sum(samples) > LONG or problem.space.dimension > MANY:
        return []
    try:
        shot = Shooting.of(problem, segments=min(SEGMENTS, max(samples) // SHORTEST)).search(
            starts=STARTS, weights=LOOSE
        )
    except (
        SearchError,
        SimulationError,
    ):  # models that it does not take, or that cannot be simulated in segments either
        return []
    return forgetting(problem, shot.z) if shot.cost < BETTER * float(problem.costs(z[None])[0]) else []


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


def _settles(problem: Problem) -> bool:
    """Whether the model is linear and stable in the box, or grows too slowly to forget: a deviation follows x' = A x
    then, wherever the states are and whatever drives them. A is asked for at corners and at Sobol points."""
    if not problem.predictor.has_steps or not problem.predictor.stepping().vector.model.smooth:
        return False
    simulator, space = problem.predictor.stepping(), problem.space
    if simulator.vector.model.state_delays or not is_linear(simulator.vector):
        return False
    drives = {n: d for n, d in problem.data["drive"].items() if isinstance(d, Drive)}
    longest = max((float(d.t[-1] - d.t[0]) for d in drives.values()), default=0.0)
    inside = Sobol(space.dimension, np.random.default_rng(0)).random(POINTS)
    values = np.asarray(space.physical(np.concatenate([inside, np.round(inside)])))
    slopes, own = _slopes(simulator), any(c.recording is not None for c in space.coordinates)
    for name in drives if own else list(drives)[:1]:
        trees = [space.tree(v, name) for v in values]
        a = np.asarray(slopes({n: np.stack([np.asarray(tree[n], dtype=float) for tree in trees]) for n in trees[0]}))
        if not np.all(np.isfinite(a)) or np.max(np.linalg.eigvals(a).real) * longest > SLOW:
            return False
    return True


@lru_cache(maxsize=16)
def _slopes(simulator: Simulator) -> Kept:
    """The derivatives (k, n, n) of a linear model's rates by its states, of parameters that each have k rows."""
    vector = simulator.vector
    n, inputs = len(vector.states), (jnp.zeros(()),) * len(vector.channels)

    def slopes(p):
        return jax.jacfwd(lambda x: jnp.stack(vector.rate(tuple(x), inputs, simulator.positional(p))))(jnp.zeros(n))

    return kept(jax.vmap(slopes), "slopes by states", vector.model)


@lru_cache(maxsize=16)
def _states(simulator: Simulator) -> Kept:
    """The states of a record of which the first are moved by `offset` (n,): one program for all of them."""

    def states(p, drive, offset):
        first = simulator.initial(p, drive.first_input, drive.first_output)
        return simulator.states(p, drive, tuple(a + b for a, b in zip(first, offset, strict=True)))

    settings = simulator.vector.model, simulator.stepper, simulator.substeps, simulator.interpolated
    return kept(states, "states moved", settings)
