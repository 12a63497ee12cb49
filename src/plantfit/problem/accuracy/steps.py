"""How finely to simulate: step doubling before the fit, at random points of the box and at the answer.

Few equal steps between samples are tried first. Where they are not enough, a model that is smooth gets a mesh (`mesh`), with steps as
long as each place allows for all candidates, frozen during a search. Where that would be many steps at each of many samples, as sharp
friction wants them, or the record is too long for a mesh, steps are adaptive: each candidate has its own. Models with jumps get more
equal steps.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.accuracy.mesh import MOST_STEPS as MOST_MESHED
from plantfit.problem.accuracy.mesh import can_mesh, effects, errors_at, mesh_at
from plantfit.problem.evaluate.points import residuals, residuals_alone
from plantfit.problem.problem import Problem
from plantfit.simulate.check.tight import follow
from plantfit.simulate.simulator import ADAPTIVE, Drive, Simulator
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.sobol import Sobol

COARSE = 0.003  # step error before the fit, as a share of the spread of the measured output
SLOPE = 0.01  # error of the slope by dead times before the fit, as a share of that slope
FINE = 0.03  # step error at the answer, as a share of the residual
FINE_EACH = 0.05  # the same in each recording by itself; the verdict calls more not negligible
EVEN = 4  # equal steps a sample, up to which no mesh is made
SPARSE = 100  # samples of all recordings together, from which on step doubling alone tells whether equal steps are short enough
FINEST = 64  # equal steps a sample over the box, and fineness of adaptive ones
LOST = 20_000  # evaluations of the tight solver, by which a candidate that explodes has done so; one that needs more is not judged
FALSE = 0.1  # of a cost, from which on a mesh is said to give a false one
LONG_MESH = 100  # steps of a mesh between two samples, from which on adaptive ones are taken
SENSITIVE, MOST_FINE = 16, 1000  # their fineness to begin with there, and at most
LONG = 16  # equal steps a sample that take as long as adaptive ones
MOST_STEPS = 1_000_000  # of all recordings together, at the answer
MESH = 0.001  # step error on a mesh before the fit, as a share of the spread of the measured output
MESH_PART = 0.9  # of the points of the box, at which the steps of sparse records are fine enough
EXACT = 0.005  # step error on a mesh at the answer, as a share of the residual: where errors are correlated with it, 1 % of the cost
ROUNDS = 4  # of choosing steps at one answer
STILL, ROUNDED = 1e-3, 1e-9  # of the level of an output that never moves: what counts as its spread, and what is rounding of it
LEAST = 1e-6  # step error that is asked for at most, as a share of the spread of the measured outputs
DEFAULT = "exponential"  # the only stepper that is replaced by adaptive steps
OFTEN = 0.1  # jumps a sample from which on the slope by a dead time is looked at
DELAY_SHARE = 1e-5  # of its range, by which a dead time is moved to see a slope


def choose_substeps(problem: Problem, points: int = 16) -> Problem:
    """The problem with the fewest substeps (1, 2, 4 .. 64) whose step error is small over most of the box, or with a mesh.

    At the points of a fixed Sobol sequence the median of rms(step error) / std(output) has to fall
    under 0.3 %; points that cannot be simulated are left out. Where a mesh can be made and 4 equal steps are not enough, it is a mesh with
    less than 0.1 % at 90 % of the points. Up to 100 samples, 90 % of the points have to be under 0.3 % with equal steps, too.

    Where a late input is held, the error of the slope by its dead time has to fall under 1 % too, or the steps are a quarter: steps are
    cut at the jumps, and the slope is uneven where these cross samples. It is looked at where bounds of the dead time put a jump on a
    sample (at three of four points), and anywhere if there are jumps at many samples.
    Nothing is done when the user has chosen.
    """
    if problem.substeps_chosen or not problem.predictor.has_steps:
        return problem
    z = Sobol(problem.space.dimension, np.random.default_rng(0)).random(points)
    problem = _proven(_even_or_meshed(problem, z), z) if can_mesh(problem) else _even_or_adaptive(problem, _step_error, z, COARSE)
    delays, rows = _held_delays(problem), z[: len(z) // 2]
    most = min(4 * problem.predictor.stepping().substeps, FINEST)
    for delay in delays:
        for bound, side in delay.bounds_on_samples(problem):
            error = partial(_slope_error, places=[delay.place], sides=(side,))
            problem = _refined_until(problem, error, _with(problem, rows, delay.place, bound), SLOPE, most, 0.75)
    often = [delay for delay in delays if delay.often]
    for delay in often:
        rows = delay.on_samples(problem, rows)
    places = [delay.place for delay in often]
    return _refined_until(problem, partial(_slope_error, places=places), rows, SLOPE, most) if often else problem


def _proven(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with adaptive steps, which show that a candidate explodes, where its mesh gives false costs at a tenth of the rows of z.

    A mesh is made at points that can be followed; elsewhere it may step over a pole, and a search would end in what is not there. Adaptive
    steps that are lost where an independent solver is not are none to search with.
    """
    if not problem.mesh or not _can_adapt(problem):
        return problem
    own = problem.predictor.stepping()
    exact = problem.with_mesh({}).with_simulator(Simulator(own.vector, ADAPTIVE, SENSITIVE, own.interpolated))
    cost, true = (np.asarray(p.costs(z)) for p in (problem, exact))
    with np.errstate(all="ignore"):
        false = (np.isfinite(cost) != np.isfinite(true)) | (np.abs(cost - true) > FALSE * true)
    if np.mean(false) <= 1.0 - MESH_PART or not all(_explodes(problem, row) for row in z[~np.isfinite(true)]):
        return problem
    return exact


def _explodes(problem: Problem, z: np.ndarray) -> bool:
    """Whether an independent solver is lost at a cube point (d,), too."""
    values, single = problem.space.physical(z), problem.predictor.stepping()
    for name, drive in problem.whole_drives.items():
        p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
        stopped = follow(single, p, drive, evaluations=LOST).stopped
        if stopped is not None and not stopped.spent:
            return True
    return False


def _refined_until(
    problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float, most: int, part: float = 0.5
) -> Problem:
    """The problem with steps halved until `error` is below `small` for this part of the rows of z, or there are `most` substeps."""
    while problem.predictor.stepping().substeps < most and not _small(problem, error, z, small, part):
        problem = problem.with_simulator(problem.predictor.stepping().refined(2))
    return problem


def _small(problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float, part: float = 0.5) -> bool:
    """Whether `error` is below `small` for this part of the rows of z that can be simulated."""
    return _quantile(problem, error, z, part) < small


def _quantile(problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, part: float) -> float:
    """The error that this part of the rows of z stays below, of those that can be simulated; infinite where none can."""
    shares = [s for s in (error(problem, row) for row in z) if np.isfinite(s)]
    return float(np.quantile(shares, part)) if shares else np.inf


def _even_or_adaptive(problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float) -> Problem:
    """Equal steps that are halved until their error is small, or adaptive ones where a model has them and equal ones would be many."""
    if not _can_adapt(problem):
        return _refined_until(problem, error, z, small, FINEST)
    even = _refined_until(problem, error, z, small, LONG)
    short = even.predictor.stepping().substeps < LONG or _small(even, error, z, small)
    return even if short else _adaptive(problem, error, z, small)


def _adaptive(
    problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float, first: int = 1, most: int = FINEST
) -> Problem:
    """The problem with adaptive steps, as fine as the error at half of the rows of z asks for, from the `first` fineness on."""
    own = problem.predictor.stepping()
    problem = problem.with_mesh({}) if problem.mesh else problem
    return _refined_until(problem.with_simulator(Simulator(own.vector, ADAPTIVE, first, own.interpolated)), error, z, small, most)


def _long(problem: Problem) -> bool:
    """Whether a mesh is so long that adaptive steps, whose order is higher, are fewer."""
    return bool(problem.mesh) and _can_adapt(problem) and problem.steps_a_sample > LONG_MESH


def _mesh_or_longer(problem: Problem, z: np.ndarray, units: dict[str, float], tolerance: float, part: float = 1.0, **how: bool) -> Problem:
    """A mesh that is given up where it gets so long that adaptive steps are taken in its place: some points of a box may ask for any."""
    return mesh_at(problem, z, units, tolerance, part, most=LONG_MESH if _can_adapt(problem) else np.inf, **how)


def _can_adapt(problem: Problem) -> bool:
    simulator = problem.predictor.stepping()
    return simulator.vector.model.smooth and simulator.stepper == DEFAULT


def _many(problem: Problem, error: float, small: float) -> bool:
    """Whether adaptive steps can be had, and this error tells by its order that more than 16 equal ones a sample were needed."""
    simulator = problem.predictor.stepping()
    more = (error / small) ** (1.0 / STEPPERS[simulator.stepper].order)
    return _can_adapt(problem) and _dense(problem) and not simulator.substeps * more <= LONG


def _even_or_meshed(problem: Problem, z: np.ndarray) -> Problem:
    """The fewest equal steps (1, 2, 4) with a small error at most of the points, or a mesh."""
    spreads, steps = _all_spreads(problem), 1
    if _dense(problem):
        even = _refined_until(problem, _step_error, z, COARSE, EVEN)
        short = even.predictor.stepping().substeps < EVEN or _small(even, _step_error, z, COARSE)
        if short:
            return even
        many = _many(even, _quantile(even, _step_error, z, 0.5), COARSE)
        made = problem if many else _mesh_or_longer(problem, z, spreads, MESH, MESH_PART)
        return _adaptive(problem, _step_error, z, COARSE) if many or _long(made) else made
    while steps <= EVEN:
        errors = errors_at(problem, z, spreads, steps)
        errors = errors[np.isfinite(errors)]
        if len(errors) and np.quantile(errors, MESH_PART) < COARSE:
            return problem if steps == 1 else problem.with_simulator(problem.predictor.stepping().refined(steps))
        steps *= 2
    return mesh_at(problem, z, spreads, MESH, MESH_PART)


def _dense(problem: Problem) -> bool:
    """Whether samples are many: steps as long as their distance are then hardly so long that halving them changes nothing."""
    return sum(len(problem.experiments[n].recording) for n in problem.whole_drives) > SPARSE


def _all_spreads(problem: Problem) -> dict[str, float]:
    return {o: _spread(np.concatenate(_measured(problem, o)), problem.scales[o]) for o in problem.outputs}


def _spread(y: np.ndarray, scale: float) -> float:
    """The standard deviation of a measured output; of one that never moves a thousandth of its level, or its scale where that is zero."""
    level = float(np.max(np.abs(y), initial=0.0))
    return next((v for v in (float(np.std(y)) if len(y) else 0.0, STILL * level) if v > ROUNDED * level), scale)


def _measured(problem: Problem, output: str) -> list[np.ndarray]:
    return [own[output] for own in problem.data["measured"].values()]


def refined_at(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with steps halved until their error at the cube point z is under 3 % of the residual; a mesh is made anew there.

    Equal steps are halved until it is under 5 % in each recording, too: what many recordings hide in their mean is an error of one.
    """
    if problem.substeps_chosen or not problem.predictor.has_steps:
        return problem
    meshed = can_mesh(problem)
    if not meshed or (_dense(problem) and not problem.mesh):
        small, most = _small_at(problem, z), EVEN if meshed else LONG if _can_adapt(problem) else FINEST
        while (error := _scaled_error(problem, z)) > small and problem.predictor.stepping().substeps < most:
            problem = problem.with_simulator(problem.predictor.stepping().refined(2))
        while error <= small and _uneven(problem, z) and problem.predictor.stepping().substeps < most:
            problem = problem.with_simulator(problem.predictor.stepping().refined(2))
        if _can_adapt(problem) and error > small and (not meshed or _many(problem, error, small)):
            return _adaptive(problem, _scaled_error, z[None, :], small)
        if error <= small or not meshed:
            return problem
    for _ in range(ROUNDS):  # the residual of coarse steps may be their error, and finer steps leave less of it
        finer = _finer_once(problem, z, _small_at(problem, z))
        if finer is problem:
            break
        problem = finer
    return problem


def _uneven(problem: Problem, z: np.ndarray) -> bool:
    """Whether the steps are not fine enough in one of several recordings."""
    if len(problem.data["drive"]) < 2:
        return False
    errors, all_residuals, start = step_errors(problem, z), _residuals(problem, z), 0
    for name in problem.data["drive"]:
        count = sum(len(problem.data["index"][name][o]) for o in problem.outputs)
        error, residual = (float(np.sum(v[start : start + count] ** 2)) ** 0.5 for v in (errors, all_residuals))
        if error > max(FINE_EACH * residual, least(problem) * count**0.5):
            return True
        start += count
    return False


def _small_at(problem: Problem, z: np.ndarray) -> float:
    return max(FINE * float(np.sqrt(np.mean(residuals(problem, z) ** 2))), least(problem))


def _finer_once(problem: Problem, z: np.ndarray, small: float) -> Problem:
    """The problem itself where its error at z is small, a few equal steps where they are enough, else a mesh."""
    steps, factor = problem.predictor.stepping().substeps, 1
    while factor * steps <= (steps if problem.mesh else EVEN):
        # halving steps that are far too long may change little: so it has to be with half of them
        if max(errors_at(problem, z[None, :], problem.scales, k)[0] for k in (factor, 2 * factor, 4 * factor)) <= small:
            return problem if factor == 1 else problem.with_simulator(problem.predictor.stepping().refined(factor))
        factor *= 2
    made = _mesh_or_longer(problem, z[None, :], problem.scales, small * EXACT / FINE)
    return _adaptive(problem, _scaled_error, z[None, :], small * EXACT / FINE, SENSITIVE, MOST_FINE) if _long(made) else made


def steps_for(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with steps that make its simulation at z exact to 0.1 % of the spread of the outputs, by a mesh or adaptive ones.

    No measured sample is off by more than 0.1 % of the range of its output then, which is twice its standard deviation at least. For what
    is simulated at given values; a search keeps the steps that serve all its candidates.
    """
    own = problem.predictor.stepping() if problem.predictor.has_steps else None
    if not problem.substeps_chosen and own is not None and own.stepper == ADAPTIVE:
        return _adaptive(problem, _largest_step_error, np.asarray(z, dtype=float)[None, :], 2.0 * MESH, own.substeps, MOST_FINE)
    if problem.substeps_chosen or not can_mesh(problem):
        return problem
    spreads, z = _all_spreads(problem), np.asarray(z, dtype=float)
    if _dense(problem) and not problem.mesh:
        error = _step_error(problem, z)
        if error <= MESH:
            return problem
        if _many(problem, error, MESH):
            return _adaptive(problem, _step_error, z[None, :], MESH)
    even = max(errors_at(problem, z[None, :], spreads, k)[0] for k in (1, 2, 4))
    if even <= MESH and _largest_error(problem, z, spreads) <= 2.0 * MESH:
        return problem
    made, tolerance = problem, MESH
    for _ in range(ROUNDS):  # the error may stand in a few samples: after a peak that steps are late at
        made = _mesh_or_longer(problem, z[None, :], spreads, tolerance)
        if _long(made):
            return _adaptive(problem, _largest_step_error, z[None, :], 2.0 * MESH, SENSITIVE, MOST_FINE)
        worst = _largest_error(made, z, spreads)
        if not worst > 2.0 * MESH:
            break
        tolerance *= max(1.6 * MESH / worst, 0.1)
    return made


def _largest_error(problem: Problem, z: np.ndarray, spreads: dict[str, float]) -> float:
    """The largest step error of a measured sample, as a share of the spread of its output."""
    found = [effects(problem, z[None, :], name, spreads)[0].error for name in problem.whole_drives]
    return float(np.max(np.abs(np.concatenate(found)), initial=0.0))


def finer_at(problem: Problem, z: np.ndarray, share: float) -> Problem | None:
    """The problem with a step error below this share of the residual at z; None where steps are as many as are allowed.

    `share` is what an independent solver asked for; how exact the steps are by their own account does not count here.
    """
    if problem.substeps_chosen or not problem.predictor.has_steps:
        return None
    rms = float(np.sqrt(np.mean(residuals(problem, z) ** 2)))
    if can_mesh(problem):
        if 4 * _count(problem) > MOST_MESHED:
            return None
        small = max(share * rms, 0.1 * least(problem))
        if not problem.mesh and _many(problem, _scaled_error(problem, z), small):
            return _adaptive(problem, _scaled_error, z[None, :], small)
        made = _mesh_or_longer(problem, z[None, :], problem.scales, small, quarter=True)
        return _adaptive(problem, _scaled_error, z[None, :], small, SENSITIVE, MOST_FINE) if _long(made) else made
    simulator = problem.predictor.stepping()
    more = 4 * simulator.substeps <= MOST_FINE if simulator.stepper == ADAPTIVE else 4 * _count(problem) <= MOST_STEPS
    return problem.with_simulator(simulator.refined(4)) if more else None


def least(problem: Problem) -> float:
    """A step error that is small enough whatever the residuals are (rms of scaled outputs)."""
    spreads = [(_spread(y, problem.scales[o]) / problem.scales[o]) ** 2 for o in problem.outputs for y in _measured(problem, o) if len(y)]
    return LEAST * float(np.sqrt(np.mean(spreads)))


def _count(problem: Problem) -> int:
    """Steps of all recordings for one candidate."""
    drives = problem.data["drive"].values()
    return problem.predictor.stepping().substeps * sum(len(d.t) for d in drives if isinstance(d, Drive))


def _scaled_error(problem: Problem, z: np.ndarray) -> float:
    """Estimated rms of the step error in scaled residuals."""
    return float(np.sqrt(np.mean(step_errors(problem, z) ** 2)))


def _step_error(problem: Problem, z: np.ndarray) -> float:
    return float(np.sqrt(np.mean(_shares(problem, z) ** 2)))


def _largest_step_error(problem: Problem, z: np.ndarray) -> float:
    return float(np.max(np.abs(_shares(problem, z))))


def _shares(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Step errors (m,) as shares of the spread of each output."""
    spread = [
        np.full(len(y), _spread(y, problem.scales[output]) / problem.scales[output])
        for name in problem.data["drive"]
        for output in problem.outputs
        if len(y := problem.data["measured"][name][output])
    ]
    return step_errors(problem, z) / np.concatenate(spread)


def step_errors(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Estimated step error of every scaled residual (m,) at a cube point: residuals at these steps minus those at half of them,
    times q / (q - 1) with q = 2 ** order."""
    simulator = problem.predictor.stepping()
    q = 2.0 ** STEPPERS[simulator.stepper].order
    fine = _halved(problem)
    return (_residuals(problem, z) - residuals_alone(fine, z)) * q / (q - 1.0)


@lru_cache(maxsize=1)  # asked for at one point after the other, and its numbers are put on the device once
def _halved(problem: Problem) -> Problem:
    """The problem with steps of half the length."""
    return problem.with_simulator(problem.predictor.stepping().refined(2))


def _residuals(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Residuals (m,): with whole steps by what a search with them compiles anyway, of finer ones as they were compared before."""
    return residuals(problem, z) if problem.predictor.stepping().substeps == 1 else residuals_alone(problem, z)


class _HeldDelay(NamedTuple):
    """A free dead time of a held input: its coordinate, and the samples and jumps (s) of a recording that it enters."""

    place: int
    t: np.ndarray
    jumps: np.ndarray

    @property
    def often(self) -> bool:
        return len(self.jumps) > OFTEN * len(self.t)

    def bounds_on_samples(self, problem: Problem) -> list[tuple[float, float]]:
        """Bounds (s) at which a jump falls on a sample, with the side (1 or -1) of each that is inside."""
        c = problem.space.coordinates[self.place]
        ends = [(c.lower, 1.0), (c.upper, -1.0)]
        return [(b, side) for b, side in ends if len(self.jumps) and np.any(np.isin(_rounded(self.jumps + b), _rounded(self.t)))]

    def on_samples(self, problem: Problem, z: np.ndarray) -> np.ndarray:
        """The cube points z with the dead time moved, so that jumps fall on samples."""
        c, shifts = problem.space.coordinates[self.place], self.t - self.jumps[0]
        inside = shifts[(shifts > c.lower) & (shifts < c.upper)]
        if not len(inside):
            return z
        own = np.array(problem.space.physical(z))[:, self.place]
        return _with(problem, z, self.place, inside[np.argmin(np.abs(own[:, None] - inside), axis=1)])


def _rounded(t: np.ndarray) -> np.ndarray:
    return np.round(t, 9)


def _with(problem: Problem, z: np.ndarray, place: int, value: float | np.ndarray) -> np.ndarray:
    """Cube points z (n, d) with another physical value of one coordinate."""
    values = np.array(problem.space.physical(z))
    values[:, place] = value
    return problem.space.cube(values)


def _held_delays(problem: Problem) -> list[_HeldDelay]:
    """The free dead times of held inputs, once by parameter."""
    simulator, found = problem.predictor.stepping(), {}
    for channel, delay in enumerate(simulator.vector.model.delays):
        root = problem.space.root(delay.parameter)
        for i, c in enumerate(problem.space.coordinates):
            if c.parameter == root and root not in found and delay.input not in simulator.interpolated:
                drive = problem.data["drive"][c.recording or next(iter(problem.data["drive"]))]
                found[root] = _HeldDelay(i, np.asarray(drive.t), np.asarray(drive.delayed[channel].knots))
    return list(found.values())


def _slope_error(problem: Problem, z: np.ndarray, *, places: Sequence[int], sides: tuple[float, ...] = (1.0, -1.0)) -> float:
    """Step error of the residuals' slope by these coordinates together at a cube point, from the worse side, as a share of the slope."""
    values = np.array(problem.space.physical(z))
    width = DELAY_SHARE * (problem.space.upper - problem.space.lower)[list(places)]
    simulator = problem.predictor.stepping()
    q = 2.0 ** STEPPERS[simulator.stepper].order
    fine = _halved(problem)

    def slope(steps: Problem, side: float) -> np.ndarray:
        moved = values.copy()
        moved[list(places)] += side * width
        return side * (_residuals(steps, problem.space.cube(moved)) - _residuals(steps, z))

    shares = []
    for side in sides:
        exact = slope(fine, side)
        shares.append(np.sqrt(np.mean((slope(problem, side) - exact) ** 2)) * q / (q - 1.0) / max(np.sqrt(np.mean(exact**2)), 1e-300))
    return float(np.max(shares))
