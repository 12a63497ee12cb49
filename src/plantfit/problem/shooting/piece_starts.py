"""Between which values the states of a record's pieces begin, for a problem in which each piece has a start of its
own."""

from dataclasses import replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.start import LOOSE, Shooting
from plantfit.simulate.simulator import Drive

STARTS = 4  # of multiple shooting
STEPS = 4  # between samples, at which states are looked for
WIDER = 1.0  # of the range in which states were found, on either side
CLEAR = 0.5  # of the standard deviation about the line, beyond which a value is on one side of it
SURE = 5.0  # times the sample-to-sample noise of an output that a state begins at
LEAST = 1e-4  # of the range of an output, what its noise is taken to be at least


def piece_starts(problem: Problem, length: float) -> dict[str, tuple[float, float]]:
    """By state the bounds (low, high), in its unit, of how far above the model's initial value pieces of the records
    begin.

    States that begin at measured outputs do so in each piece, off by the noise of a sample. Others are where they were
    found at the joints of segments of `length` seconds that follow the records, joined loosely. Raises SearchError
    where segments cannot be simulated, and as `Shooting.of` does.
    """
    simulator = problem.predictor.stepping()
    for steps in (replace(simulator, substeps=max(STEPS, simulator.substeps)), None):
        problem = choose_substeps(problem) if steps is None else problem.with_simulator(steps)
        shooting = Shooting.of(problem, length=length)
        shot = shooting.search(starts=STARTS, weights=LOOSE)
        if np.isfinite(shot.cost):
            break
    else:
        raise SearchError(
            "No segments of the records can be simulated, which would tell where states begin; write `pieces` and "
            "`start` by hand."
        )
    values = problem.space.physical(shot.z)
    states = simulator.vector.states
    low, high = np.full(len(states), np.inf), np.full(len(states), -np.inf)
    for k, (name, drive) in enumerate((n, d) for n, d in problem.data["drive"].items() if isinstance(d, Drive)):
        p = {key: np.asarray(v) for key, v in problem.space.tree(values, name).items()}
        first = np.array(drive.first_output, dtype=float)
        begin = _initial(simulator, p, drive, first)
        off = np.diag(_noises(problem, name))
        reach = np.max([np.abs(_initial(simulator, p, drive, first + e) - begin) for e in (*off, *-off)], axis=0)
        at = shot.states[shooting.cut.record == k] - begin
        room = WIDER * np.ptp(at, axis=0)
        low = np.minimum(low, np.where(reach > 0.0, -reach, np.min(at, axis=0) - room))
        high = np.maximum(high, np.where(reach > 0.0, reach, np.max(at, axis=0) + room))
    return {s: (_rounded(a), _rounded(b)) for s, a, b in zip(states, low, high, strict=True)}


def half_waves(y: np.ndarray) -> int:
    """How often measured values (n,) cross the straight line through them: half the waves that they make; noise
    about it is no wave."""
    at = np.flatnonzero(np.isfinite(y))
    if len(at) < 3:
        return 0
    rest = y[at] - np.polyval(np.polyfit(at, y[at], 1), at)
    far = rest[np.abs(rest) > CLEAR * np.std(rest)]
    return int(np.sum(np.sign(far[1:]) != np.sign(far[:-1])))


def _initial(simulator, p, drive: Drive, first: np.ndarray) -> np.ndarray:
    return np.array([float(x) for x in simulator.initial(p, drive.first_input, tuple(first))])


def _noises(problem: Problem, name: str) -> np.ndarray:
    """How far off one sample of each output may be."""
    found = []
    for output in problem.outputs:
        y = problem.experiments[name].recording[output]
        y = y[np.isfinite(y)]
        found.append(SURE * np.fmax(white_part(y), LEAST * float(np.ptp(y)) if len(y) else 0.0))
    return np.array(found)


def _rounded(value: float) -> float:
    """To two digits, away from zero."""
    if value == 0.0:
        return 0.0
    step = 10.0 ** (np.floor(np.log10(abs(value))) - 1)
    return float(f"{np.sign(value) * np.ceil(abs(value) / step - 1e-9) * step:.2g}")
