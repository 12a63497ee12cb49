"""Answers that searches over whole records miss: found by multiple shooting where an answer does not follow its
record."""

from functools import lru_cache

import numpy as np

from plantfit.errors import SearchError, SimulationError
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.settling import settles
from plantfit.problem.shooting.start import Shooting
from plantfit.simulate.simulator import Drive

SEGMENTS, SHORTEST = 100, 5  # of the longest record, and samples of each at least
STARTS = 4  # of multiple shooting
LONG, MANY = 20_000, 60  # samples of all records, and coordinates, beyond which that takes too long
FOLLOWED = 0.8  # of the spread of what was measured is explained where a record is followed
SLOW = 0.5  # correlation of a residual from sample to sample, below which it is mostly noise


def in_segments(problem: Problem) -> Shooting | None:
    """The problem cut into many short segments; None where that takes too long or the model cannot be cut."""
    samples = [len(d.t) for d in problem.data["drive"].values() if isinstance(d, Drive)]
    if not samples or max(samples) < 2 * SHORTEST or sum(samples) > LONG or problem.space.dimension > MANY:
        return None
    return _cut(problem, min(SEGMENTS, max(samples) // SHORTEST))


@lru_cache(maxsize=2)
def _cut(problem: Problem, segments: int) -> Shooting | None:
    """Kept for the next question about the same problem: its functions take seconds to compile."""
    try:
        return Shooting.of(problem, segments=segments)
    except (SearchError, SimulationError):  # models that shooting does not take
        return None


def missed_answer(problem: Problem, z: np.ndarray) -> tuple[np.ndarray, int] | None:
    """A cube point (d,) from which a local search may end lower than at the answer z (d,), and the number of segments
    that found it.

    Only where z does not follow a record, and misses it by more than noise; None where nothing was found. A linear
    model that settles under inputs has its answer where searches from several starts end.
    """
    model = problem.model
    if not isinstance(model, Model) or _follows(problem, z) or (model.inputs and settles(problem)):
        return None
    if (shooting := in_segments(problem)) is None:
        return None
    try:
        shot = shooting.search(starts=STARTS)
    except (SearchError, SimulationError):  # it cannot be simulated in segments
        return None
    better = shot.closed and shot.cost < float(problem.costs(z[None])[0])
    return (shot.z, int(np.max(np.bincount(shooting.cut.record)))) if better else None


def _follows(problem: Problem, z: np.ndarray) -> bool:
    """Whether every output of every record is followed but for noise."""
    for name, drive in problem.data["drive"].items():
        if not isinstance(drive, Drive):
            continue
        simulated = problem.predict(problem.space.physical(z), name)
        for output, y in problem.data["measured"][name].items():
            residual = np.asarray(simulated[output])[problem.data["index"][name][output]] - np.asarray(y)
            if len(residual) < 2 * SHORTEST or not np.all(np.isfinite(residual)):
                continue
            explained = 1.0 - np.sqrt(np.mean(residual**2)) / max(float(np.std(y)), 1e-300)
            around = residual - np.mean(residual)
            alike = float(around[1:] @ around[:-1]) / max(float(around @ around), 1e-300)
            if explained < FOLLOWED and alike > SLOW:
                return False
    return True
