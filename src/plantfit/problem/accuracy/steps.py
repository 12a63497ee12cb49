"""How finely to simulate: step doubling before the fit, at random points of the box and at the answer.

Few equal steps between samples are tried first. Where they are not enough, a model that is smooth gets a mesh (`mesh`),
with steps as long as each place allows for all candidates, frozen during a search. Where that would be many steps at
each of many samples, as sharp friction wants them, or the record is too long for a mesh, steps are adaptive: each
candidate has its own. Models with jumps get more equal steps.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.accuracy.delay_slopes import held_delays, slope_error, with_value
from plantfit.problem.accuracy.mesh import MOST_STEPS as MOST_MESHED
from plantfit.problem.accuracy.mesh import can_mesh, errors_at, mesh_at
from plantfit.problem.accuracy.step_errors import (
    FINE,
    all_spreads,
    largest_error,
    largest_step_error,
    least,
    scaled_error,
    small_at,
    step_error,
    uneven,
)
from plantfit.problem.evaluate.points import residuals
from plantfit.problem.problem import Problem
from plantfit.simulate.check.tight import follow
from plantfit.simulate.simulator import ADAPTIVE, Drive, Simulator
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.sobol import Sobol

COARSE = 0.003  # step error before the fit, as a share of the spread of the measured output
SLOPE = 0.01  # error of the slope by dead times before the fit, as a share of that slope
EVEN = 4  # equal steps a sample, up to which no mesh is made
# samples of all recordings together, from which on step doubling alone tells whether equal steps are short enough
SPARSE = 100
FINEST = 64  # equal steps a sample over the box, and fineness of adaptive ones
# evaluations of the tight solver, by which a candidate that explodes has done so; one that needs more is not judged
LOST = 20_000
FALSE = 0.1  # of a cost, from which on a mesh is said to give a false one
LONG_MESH = 100  # steps of a mesh between two samples, from which on adaptive ones are taken
SENSITIVE, MOST_FINE = 16, 1000  # their fineness to begin with there, and at most
LONG = 16  # equal steps a sample that take as long as adaptive ones
MOST_STEPS = 1_000_000  # of all recordings together, at the answer
MESH = 0.001  # step error on a mesh before the fit, as a share of the spread of the measured output
MESH_PART = 0.9  # of the points of the box, at which the steps of sparse records are fine enough
# step error on a mesh at the answer, as a share of the residual: where errors are correlated with it, 1 % of the cost
EXACT = 0.005
ROUNDS = 4  # of choosing steps at one answer
DEFAULT = "exponential"  # the only stepper that is replaced by adaptive steps


def choose_substeps(problem: Problem, points: int = 16) -> Problem:
    """The problem with the fewest substeps (1, 2, 4 .. 64) whose step error is small over most of the box, or with a
    mesh.

    At the points of a fixed Sobol sequence the median of rms(step error) / std(output) has to fall
    under 0.3 %; points that cannot be simulated are left out. Where a mesh can be made and 4 equal steps are not
    enough, it is a mesh with less than 0.1 % at 90 % of the points. Up to 100 samples, 90 % of the points have to be
    under 0.3 % with equal steps, too.

    Where a late input is held, the error of the slope by its dead time has to fall under 1 % too, or the steps are a
    quarter: steps are cut at the jumps, and the slope is uneven where these cross samples. It is looked at where bounds
    of the dead time put a jump on a sample (at three of four points), and anywhere if there are jumps at many samples.
    Nothing is done when the user has chosen.
    """
    if problem.substeps_chosen or not steps_taken(problem):
        return problem
    z = Sobol(problem.space.dimension, np.random.default_rng(0)).random(points)
    problem = (
        _proven(_even_or_meshed(problem, z), z)
        if can_mesh(problem)
        else _even_or_adaptive(problem, step_error, z, COARSE)
    )
    delays, rows = held_delays(problem), z[: len(z) // 2]
    most = min(4 * problem.predictor.stepping().substeps, FINEST)
    for delay in delays:
        for bound, side in delay.bounds_on_samples(problem):
            error = partial(slope_error, places=[delay.place], sides=(side,))
            problem = _refined_until(problem, error, with_value(problem, rows, delay.place, bound), SLOPE, most, 0.75)
    often = [delay for delay in delays if delay.often]
    for delay in often:
        rows = delay.on_samples(problem, rows)
    places = [delay.place for delay in often]
    return _refined_until(problem, partial(slope_error, places=places), rows, SLOPE, most) if often else problem


def _proven(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with adaptive steps, which show that a candidate explodes, where its mesh gives false costs at a
    tenth of the rows of z.

    A mesh is made at points that can be followed; elsewhere it may step over a pole, and a search would end in what is
    not there. Adaptive steps that are lost where an independent solver is not are none to search with.
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
        stopped = follow(single, p, drive, evaluations=LOST, briefly=True).stopped
        if stopped is not None and not stopped.spent:
            return True
    return False


def _refined_until(
    problem: Problem,
    error: Callable[[Problem, np.ndarray], float],
    z: np.ndarray,
    small: float,
    most: int,
    part: float = 0.5,
) -> Problem:
    """The problem with steps halved until `error` is below `small` for this part of the rows of z, or there are
    `most` substeps."""
    while problem.predictor.stepping().substeps < most and not _small(problem, error, z, small, part):
        problem = problem.with_simulator(problem.predictor.stepping().refined(2))
    return problem


def _small(
    problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float, part: float = 0.5
) -> bool:
    """Whether `error` is below `small` for this part of the rows of z that can be simulated."""
    return _quantile(problem, error, z, part) < small


def _quantile(problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, part: float) -> float:
    """The error that this part of the rows of z stays below, of those that can be simulated; infinite where none
    can."""
    shares = [s for s in (error(problem, row) for row in z) if np.isfinite(s)]
    return float(np.quantile(shares, part)) if shares else np.inf


def _even_or_adaptive(
    problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float
) -> Problem:
    """Equal steps that are halved until their error is small, or adaptive ones where a model has them and equal ones
    would be many."""
    if not _can_adapt(problem):
        return _refined_until(problem, error, z, small, FINEST)
    even = _refined_until(problem, error, z, small, LONG)
    short = even.predictor.stepping().substeps < LONG or _small(even, error, z, small)
    return even if short else _adaptive(problem, error, z, small)


def _adaptive(
    problem: Problem,
    error: Callable[[Problem, np.ndarray], float],
    z: np.ndarray,
    small: float,
    first: int = 1,
    most: int = FINEST,
) -> Problem:
    """The problem with adaptive steps, as fine as the error at half of the rows of z asks for, from the `first`
    fineness on.

    Where steps are 1e8 times as long as the quickest time constant and more, rounding is larger than the error that a
    high fineness allows, and a candidate cannot be followed: the finest that can is taken.
    """
    own = problem.predictor.stepping()
    problem = problem.with_mesh({}) if problem.mesh else problem
    made = problem.with_simulator(Simulator(own.vector, ADAPTIVE, first, own.interpolated))
    best, least_error = None, np.inf
    while True:
        found = _quantile(made, error, z, 0.5)
        if found < least_error:
            best, least_error = made, found
        if found < small or made.predictor.stepping().substeps >= most or (best is not None and not np.isfinite(found)):
            break
        made = made.with_simulator(made.predictor.stepping().refined(2))
    coarser = first // 2
    while best is None and coarser >= 1:
        coarse = problem.with_simulator(Simulator(own.vector, ADAPTIVE, coarser, own.interpolated))
        best, coarser = coarse if np.isfinite(_quantile(coarse, error, z, 0.5)) else None, coarser // 2
    return best or made


def _long(problem: Problem) -> bool:
    """Whether a mesh is so long that adaptive steps, whose order is higher, are fewer."""
    return bool(problem.mesh) and _can_adapt(problem) and problem.steps_a_sample > LONG_MESH


def _mesh_or_longer(
    problem: Problem, z: np.ndarray, units: dict[str, float], tolerance: float, part: float = 1.0, **how: bool
) -> Problem:
    """A mesh that is given up where it gets so long that adaptive steps are taken in its place: some points of a box
    may ask for any."""
    return mesh_at(problem, z, units, tolerance, part, most=LONG_MESH if _can_adapt(problem) else np.inf, **how)


def _can_adapt(problem: Problem) -> bool:
    simulator = problem.predictor.stepping()
    return simulator.vector.model.smooth and simulator.stepper == DEFAULT


def _many(problem: Problem, error: float, small: float) -> bool:
    """Whether adaptive steps can be had, and this error tells by its order that more than 16 equal ones a sample
    were needed."""
    simulator = problem.predictor.stepping()
    more = (error / small) ** (1.0 / STEPPERS[simulator.stepper].order)
    return _can_adapt(problem) and _dense(problem) and not simulator.substeps * more <= LONG


def _even_or_meshed(problem: Problem, z: np.ndarray) -> Problem:
    """The fewest equal steps (1, 2, 4) with a small error at most of the points, or a mesh."""
    spreads, steps = all_spreads(problem), 1
    if _dense(problem):
        even = _refined_until(problem, step_error, z, COARSE, EVEN)
        short = even.predictor.stepping().substeps < EVEN or _small(even, step_error, z, COARSE)
        if short:
            return even
        many = _many(even, _quantile(even, step_error, z, 0.5), COARSE)
        made = problem if many else _mesh_or_longer(problem, z, spreads, MESH, MESH_PART)
        return _adaptive(problem, step_error, z, COARSE) if many or _long(made) else made
    while steps <= EVEN:
        errors = errors_at(problem, z, spreads, steps)
        errors = errors[np.isfinite(errors)]
        if len(errors) and np.quantile(errors, MESH_PART) < COARSE:
            return problem if steps == 1 else problem.with_simulator(problem.predictor.stepping().refined(steps))
        steps *= 2
    return mesh_at(problem, z, spreads, MESH, MESH_PART)


def steps_taken(problem: Problem) -> bool:
    """Whether any recording is simulated over time: not where the model has no states, or all rows are at rest."""
    return problem.predictor.has_steps and any(isinstance(d, Drive) for d in problem.data["drive"].values())


def _dense(problem: Problem) -> bool:
    """Whether samples are many: steps as long as their distance are then hardly so long that halving them changes
    nothing."""
    return sum(len(problem.experiments[n].recording) for n in problem.whole_drives) > SPARSE


def refined_at(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with steps halved until their error at the cube point z is under 3 % of the residual; a mesh is made
    anew there.

    Equal steps are halved until it is under 5 % in each recording, too: what many recordings hide in their mean is an
    error of one.
    """
    if problem.substeps_chosen or not steps_taken(problem):
        return problem
    meshed = can_mesh(problem)
    if not meshed or (_dense(problem) and not problem.mesh):
        small, most = small_at(problem, z), EVEN if meshed else LONG if _can_adapt(problem) else FINEST
        while (error := scaled_error(problem, z)) > small and problem.predictor.stepping().substeps < most:
            problem = problem.with_simulator(problem.predictor.stepping().refined(2))
        while error <= small and uneven(problem, z) and problem.predictor.stepping().substeps < most:
            problem = problem.with_simulator(problem.predictor.stepping().refined(2))
        if _can_adapt(problem) and error > small and (not meshed or _many(problem, error, small)):
            return _adaptive(problem, scaled_error, z[None, :], small)
        if error <= small or not meshed:
            return problem
    for _ in range(ROUNDS):  # the residual of coarse steps may be their error, and finer steps leave less of it
        finer = _finer_once(problem, z, small_at(problem, z))
        if finer is problem:
            break
        problem = finer
        if problem.predictor.stepping().stepper == ADAPTIVE:  # as fine as it has to be, and no mesh to refine
            break
    return problem


def _finer_once(problem: Problem, z: np.ndarray, small: float) -> Problem:
    """The problem itself where its error at z is small, a few equal steps where they are enough, else a mesh."""
    steps, factor = problem.predictor.stepping().substeps, 1
    while factor * steps <= (steps if problem.mesh else EVEN):
        # halving steps that are far too long may change little: so it has to be with half of them
        if max(errors_at(problem, z[None, :], problem.scales, k)[0] for k in (factor, 2 * factor, 4 * factor)) <= small:
            return problem if factor == 1 else problem.with_simulator(problem.predictor.stepping().refined(factor))
        factor *= 2
    made = _mesh_or_longer(problem, z[None, :], problem.scales, small * EXACT / FINE)
    return (
        _adaptive(problem, scaled_error, z[None, :], small * EXACT / FINE, SENSITIVE, MOST_FINE)
        if _long(made)
        else made
    )


def steps_for(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with steps that make its simulation at z exact to 0.1 % of the spread of the outputs, by a mesh or
    adaptive ones.

    No measured sample is off by more than 0.1 % of the range of its output then, which is twice its standard deviation
    at least. For what is simulated at given values; a search keeps the steps that serve all its candidates.
    """
    return steps_and_error(problem, z)[0]


def steps_and_error(problem: Problem, z: np.ndarray) -> tuple[Problem, float | None]:
    """As `steps_for`, and the largest error of a measured sample where no steps came to that.

    It is a share of the spread of the sample's output, 1 also where it is larger or nobody knows.
    """
    made, error = _made_for(problem, z)
    return made, None if error is None else min(error, 1.0) if np.isfinite(error) else 1.0


def _made_for(problem: Problem, z: np.ndarray) -> tuple[Problem, float | None]:
    own, z = problem.predictor.stepping() if steps_taken(problem) else None, np.asarray(z, dtype=float)
    if problem.substeps_chosen or own is None:
        return problem, None
    if own.stepper == ADAPTIVE:
        return _told(_adaptive(problem, largest_step_error, z[None, :], 2.0 * MESH, own.substeps, MOST_FINE), z)
    if not can_mesh(problem):
        return problem, None
    spreads = all_spreads(problem)
    if _dense(problem) and not problem.mesh:
        error = step_error(problem, z)
        if error <= MESH:
            return problem, None
        if _many(problem, error, MESH):
            return _adaptive(problem, step_error, z[None, :], MESH), None
    even = max(errors_at(problem, z[None, :], spreads, k)[0] for k in (1, 2, 4))
    if even <= MESH and largest_error(problem, z, spreads) <= 2.0 * MESH:
        return problem, None
    made, worst, tolerance = problem, np.inf, MESH
    for _ in range(ROUNDS):  # the error may stand in a few samples: after a peak that steps are late at
        made = _mesh_or_longer(problem, z[None, :], spreads, tolerance)
        worst = np.inf if _long(made) else largest_error(made, z, spreads)
        if worst <= 2.0 * MESH:
            return made, None
        if not np.isfinite(worst):
            break
        tolerance *= max(1.6 * MESH / worst, 0.1)
    if not _can_adapt(problem):
        return made, worst
    exact, error = _told(_adaptive(problem, largest_step_error, z[None, :], 2.0 * MESH, SENSITIVE, MOST_FINE), z)
    return (made, worst) if error is not None and worst <= error else (exact, error)


def _told(problem: Problem, z: np.ndarray) -> tuple[Problem, float | None]:
    """The problem, and its largest step error at z where that is not small."""
    error = largest_step_error(problem, z)
    return problem, None if error <= 2.0 * MESH else error


def finer_at(problem: Problem, z: np.ndarray, share: float) -> Problem | None:
    """The problem with a step error below this share of the residual at z; None where steps are as many as are allowed.

    `share` is what an independent solver asked for; how exact the steps are by their own account does not count here.
    """
    if problem.substeps_chosen or not steps_taken(problem):
        return None
    rms = float(np.sqrt(np.mean(residuals(problem, z) ** 2)))
    if can_mesh(problem):
        if 4 * _count(problem) > MOST_MESHED:
            return None
        small = max(share * rms, 0.1 * least(problem))
        if not problem.mesh and _many(problem, scaled_error(problem, z), small):
            return _adaptive(problem, scaled_error, z[None, :], small)
        made = _mesh_or_longer(problem, z[None, :], problem.scales, small, quarter=True)
        return _adaptive(problem, scaled_error, z[None, :], small, SENSITIVE, MOST_FINE) if _long(made) else made
    simulator = problem.predictor.stepping()
    more = 4 * simulator.substeps <= MOST_FINE if simulator.stepper == ADAPTIVE else 4 * _count(problem) <= MOST_STEPS
    made = problem.with_simulator(simulator.refined(4)) if more else None
    # rounding may be larger than what a high fineness allows
    return made if made is not None and np.all(np.isfinite(residuals(made, z))) else None


def _count(problem: Problem) -> int:
    """Steps of all recordings for one candidate."""
    drives = problem.data["drive"].values()
    return problem.predictor.stepping().substeps * sum(len(d.t) for d in drives if isinstance(d, Drive))
