"""Where steps end between samples: a mesh of its own for every recording, made at candidates and frozen afterwards.

Every interval between two times of a `Drive` is halved as often as its share of the error asks for: a mesh is a set of
dyadic fractions of the intervals. The error e_k of one step is that against two of half its length from the same state.
What it does to all later outputs is |e_k|_G = sqrt(e_k' G_(k+1) e_k) with the observability Gramian of the linearised
steps,

    G_k = A_k' G_(k+1) A_k + C_k' C_k,                                                                   (1)

A_k the Jacobian of step k and C_k that of the scaled outputs where they are scored: a goal-oriented estimate (R. Becker
and R. Rannacher, Acta Numerica 10 (2001) 1, sec. 2) for all outputs at once. A step of order q in n parts adds |e_k|_G
/ n^q; the fewest steps for a given sum have n proportional to the (q+1)th root of |e_k|_G. How far that sum is from the
error itself shows a run with all steps halved.

A mesh is data: costs, gradients and Jacobians are exact for it, whatever candidates are simulated side by side.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from plantfit.problem.accuracy.course import Course
from plantfit.problem.problem import Problem
from plantfit.runtime import jit
from plantfit.simulate.check.tight import follow
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.array_steppers import Rates, Step, propagator
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp

ROUNDS = 40  # refinements of one mesh, at most
# errors of a step as shares of the state: behind it nothing is known, and too large for the estimate to hold
LOST, ROUGH = (0.3, 0.01)
NEGLIGIBLE = 1e-9  # error of a step as a share of the state, below which halving it changes nothing
FAR = 10.0  # times the tolerance, above which only the worst steps are halved
WORST = 8.0  # times less than the worst, down to which steps are among them
FASTEST = 5  # halvings of an interval in one refinement, at most
BLIND = 12  # refinements of a record that cannot be followed, at most
MOST_STEPS = 100_000  # of a mesh, all recordings together
SPARSE = 3_000  # samples of all recordings together, up to which a mesh is made
ROWS = 512  # single steps that are taken at once
AIM = 0.5  # of the tolerance that a refinement aims at


def can_mesh(problem: Problem) -> bool:
    """Whether a mesh can be made: sparse records of a smooth model without late states, and a stepper that has a
    step on arrays (`place_on_arrays` of `simulate.steps.registry.Stepper`)."""
    if not problem.predictor.has_steps:
        return False
    simulator = problem.predictor.stepping()
    model = simulator.vector.model
    samples = sum(len(problem.experiments[n].recording) for n in problem.whole_drives)
    return bool(
        STEPPERS[simulator.stepper].place_on_arrays and model.smooth and not model.state_delays and samples <= SPARSE
    )


@dataclass(frozen=True)
class Effects:
    """What the steps of a record do to its measured samples at one candidate.

    `error` (m,) of the scaled outputs, by halving all steps; `share` (N - 1,) is the largest |e_k|_G (eq. 1) in every
    interval of the drive, `local` (N - 1,) the error of a step there as a share of the largest state. Not finite where
    the record could not be followed; `local` is then that of the first step from which on it could not, 0 behind it.
    """

    error: np.ndarray
    share: np.ndarray
    local: np.ndarray

    @property
    def finite(self) -> bool:
        return bool(np.all(np.isfinite(self.error)) and np.all(np.isfinite(self.share)))

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.error**2))) if len(self.error) else 0.0


class _Compiled(NamedTuple):
    """What is compiled once for a model, for rows of candidates."""

    rates: Rates
    course: Course
    initial: Callable  # (p, first_input, first_output) -> (C, n)
    steps: Callable  # (p, drive) -> the grid and inputs of every candidate
    outputs: Callable  # (states (C, m, n), channels (C, m, c), values) -> values (C, m, o), slopes (C, m, o, n)
    late: Callable  # (p, drive) -> channels (C, N, c)


@lru_cache(maxsize=8)  # not kept with the problem: every mesh is a problem of its own
def _compiled(vector: VectorModel, stepper: str, interpolated: tuple[str, ...]) -> _Compiled:
    simulator = Simulator(vector, stepper, 1, interpolated)

    def output(x, u, values):
        return jnp.stack([jnp.asarray(v, dtype=float) for v in vector.output(tuple(x), tuple(u), values)])

    def both(x, u, values):
        return output(x, u, values), jax.jacfwd(output)(x, u, values)

    def stacked(columns, length):
        return jnp.stack([jnp.broadcast_to(c, length.shape) for c in columns], axis=1)

    def steps(p, drive):
        grid, (u0, u1, length) = simulator.steps(p, drive)
        return grid.rank, grid.sample, stacked(u0, length), stacked(u1, length), length

    return _Compiled(
        Rates(vector),
        Course(vector, stepper),
        jit(jax.vmap(lambda p, *first: jnp.stack(simulator.initial(p, *first)), in_axes=(0, None, None))),
        jit(jax.vmap(steps, in_axes=(0, None))),
        jit(jax.vmap(jax.vmap(both, in_axes=(0, 0, None)))),
        jit(jax.vmap(lambda p, drive: stacked(simulator.channels(p, drive), drive.t), in_axes=(0, None))),
    )


def effects(problem: Problem, zs: np.ndarray, name: str, units: Mapping[str, float]) -> list[Effects]:
    """Of the steps of one moving recording at cube points (C, d), for all its measured samples, in `units` of the
    outputs."""
    own, drive = problem.predictor.stepping(), problem.whole_drives[name]
    made = _compiled(own.vector, own.stepper, own.interpolated)
    trees = [problem.space.tree(problem.space.physical(np.asarray(z, dtype=float)), name) for z in zs]
    p = {k: np.stack([np.asarray(t[k], dtype=float) for t in trees]) for k in trees[0]}
    values = tuple(p[n] for n in own.vector.parameters)
    places, counts = _scored(problem, name, units)
    with np.errstate(all="ignore"):
        x0 = np.asarray(made.initial(p, drive.first_input, drive.first_output))
        rank, sample, u0, u1, length = _grid(made, p, drive)
        coarse, fine = _followed(made, x0, (u0, u1, length), values)
        local, jacobian = _single_steps(
            STEPPERS[own.stepper].on_arrays, made.rates, fine[:, :-1], (u0, u1, length), values
        )
        channels = _channels(made, p, drive)[:, places]
        own_rank = rank[:, places]
        rows = np.arange(len(zs))[:, None]
        (y, _), (better, slopes) = (
            tuple(np.asarray(a) for a in made.outputs(x[rows, own_rank], channels, values)) for x in (coarse, fine)
        )
        error = (y - better) * counts
        slopes = np.where(counts[:, :, None] > 0, slopes * counts[:, :, None], 0.0)
        squares = np.zeros((len(zs), length.shape[1] + 1, x0.shape[1], x0.shape[1]))
        np.add.at(squares, (rows, own_rank), np.einsum("ckoi,ckoj->ckij", slopes, slopes))
        reach = _reach(local, propagators(jacobian, length), squares)
        share = np.zeros((len(zs), len(drive.t)))
        np.maximum.at(share, (rows, sample), reach)  # delayed edges cut intervals: the worst part decides
        relative = np.zeros((len(zs), len(drive.t)))
        np.maximum.at(relative, (rows, sample), _relative(local, fine))
    q = 2.0 ** STEPPERS[own.stepper].order
    factor = q / (q - 1.0)
    return [
        Effects(e[counts > 0] * factor, s[:-1] * factor, v[:-1]) for e, s, v in zip(error, share, relative, strict=True)
    ]


def effects_along(problem: Problem, z: np.ndarray, name: str, units: Mapping[str, float]) -> Effects | None:
    """As `effects` at one cube point z (d,), but every step begins at a state of the tight solution, not where the
    steps before had led.

    Errors go on by the linearised steps. None for late inputs, and where the tight solver cannot follow: steps that are
    too long may lead beside an unstable course, where no state says anything about the model's.
    """
    own, drive = problem.predictor.stepping(), problem.whole_drives[name]
    if drive.delayed:
        return None
    made = _compiled(own.vector, own.stepper, own.interpolated)
    tree = problem.space.tree(problem.space.physical(np.asarray(z, dtype=float)), name)
    p = {k: np.asarray(v, dtype=float) for k, v in tree.items()}
    tight = follow(Simulator(own.vector, own.stepper, 1, own.interpolated), p, drive)
    if tight.stopped is not None or not np.all(np.isfinite(tight.states)):
        return None
    x, rows = tight.states.T, {k: v[None] for k, v in p.items()}
    rank, _, u0, u1, length = _grid(made, rows, drive)
    alike = tuple(rows[n] for n in own.vector.parameters)
    rank = rank[0]
    with np.errstate(all="ignore"):
        local, jacobian = _single_steps(
            STEPPERS[own.stepper].on_arrays, made.rates, x[None, :-1], (u0, u1, length), alike
        )
        forwards = propagators(jacobian, length)
        places, counts = _scored(problem, name, units)
        _, slopes = (
            np.asarray(a) for a in made.outputs(x[None, rank[places]], _channels(made, rows, drive)[:, places], alike)
        )
        slopes = np.where(counts[:, :, None] > 0, slopes[0] * counts[:, :, None], 0.0)
        off = np.zeros_like(x)
        for k in range(length.shape[1]):
            off[k + 1] = forwards[0, k] @ off[k] + local[0, k]
        error = np.einsum("koi,ki->ko", slopes, off[rank[places]])
        squares = np.zeros((1, length.shape[1] + 1, x.shape[1], x.shape[1]))
        np.add.at(squares[0], rank[places], np.einsum("koi,koj->kij", slopes, slopes))
        share = _reach(local, forwards, squares)[0]
    q = 2.0 ** STEPPERS[own.stepper].order
    return Effects(error[counts > 0] * q / (q - 1.0), share * q / (q - 1.0), _relative(local, x[None])[0])


def _scored(problem: Problem, name: str, units: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Places (m,) of measured samples among the times of the drive, and one over the unit of each output (m, o), 0
    where not measured."""
    recording, drive = problem.experiments[name].recording, problem.whole_drives[name]
    scored = [drive.places(np.flatnonzero(np.isfinite(recording[o]))) for o in problem.outputs]
    places = np.unique(np.concatenate(scored))
    return places, np.stack(
        [np.isin(places, s) / units[o] for s, o in zip(scored, problem.outputs, strict=True)], axis=1
    )


def _grid(made: _Compiled, p: Mapping[str, np.ndarray], drive: Drive) -> tuple[np.ndarray, ...]:
    """Rank (C, N) of the times among K + 1 ends of steps, sample (C, K) before each, inputs (C, K, c) at both ends,
    and lengths (C, K)."""
    if drive.delayed:
        return tuple(np.asarray(a) for a in made.steps(p, drive))
    count = len(next(iter(p.values()))) if p else 1
    t, length = np.asarray(drive.t), np.diff(drive.t)
    begin = [*(np.asarray(v)[:-1] for v in drive.value), t[:-1]]
    end = [
        *(np.asarray(v)[:-1] + np.asarray(s)[:-1] * length for v, s in zip(drive.value, drive.slope, strict=True)),
        t[1:],
    ]
    alike = (np.arange(len(t)), np.arange(len(length)), np.stack(begin, axis=1), np.stack(end, axis=1), length)
    return tuple(np.broadcast_to(a, (count, *a.shape)) for a in alike)


def _channels(made: _Compiled, p: Mapping[str, np.ndarray], drive: Drive) -> np.ndarray:
    """Every channel (C, N, c) at the times of the drive."""
    if drive.delayed:
        return np.asarray(made.late(p, drive))
    count = len(next(iter(p.values()))) if p else 1
    own = np.stack([*(np.asarray(v) for v in drive.value), np.asarray(drive.t)], axis=1)
    return np.broadcast_to(own, (count, *own.shape))


def _followed(
    made: _Compiled, x0: np.ndarray, inputs: tuple[np.ndarray, ...], values: Any
) -> tuple[np.ndarray, np.ndarray]:
    """States (C, K + 1, n) at the ends of these steps, by them and by half of them."""
    u0, u1, length = inputs
    middle = 0.5 * (u0 + u1)
    begin, end = (np.stack(pair, axis=2).reshape(len(u0), -1, u0.shape[2]) for pair in ((u0, middle), (middle, u1)))
    fine = made.course.states(x0, begin, end, np.repeat(0.5 * length, 2, axis=1), values)
    return made.course.states(x0, u0, u1, length, values), fine[:, ::2]


def _single_steps(
    step: Step, rates: Rates, x: np.ndarray, inputs: tuple[np.ndarray, ...], values: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (C, K, n) of single steps from these states (C, K, n), and Jacobians there (C, K, n, n).

    All steps of all candidates are rows, which are worked off `ROWS` at once, so that rates are compiled for one number
    of rows.
    """
    shape, (u0, u1, length) = x.shape, inputs
    x, u0, u1, length = (
        x.reshape(-1, shape[2]),
        u0.reshape(-1, u0.shape[2]),
        u1.reshape(-1, u1.shape[2]),
        length.reshape(-1),
    )
    local, jacobian = np.empty(x.shape), np.empty((*x.shape, shape[2]))
    for begin in range(0, len(x), ROWS):
        stop = min(begin + ROWS, len(x))
        rows = np.minimum(np.arange(begin, begin + ROWS), len(x) - 1)
        own = jax.device_put(tuple(v[rows // shape[1]] for v in values))
        at, a, b, h = x[rows], u0[rows], u1[rows], length[rows]
        middle, half = 0.5 * (a + b), 0.5 * h
        begun = step(rates, at, a, middle, half, own)
        error = step(rates, at, a, b, h, own) - step(rates, begun, middle, b, half, own)
        local[begin:stop] = error[: stop - begin]
        jacobian[begin:stop] = rates.linear(at, a, np.zeros_like(a), own)[1][: stop - begin]
    return local.reshape(shape), jacobian.reshape(*shape, shape[2])


def _relative(local: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Errors of steps (C, K) as shares of the largest states so far; 1 at the first that is not finite, 0 behind it."""
    size = np.maximum.accumulate(np.where(np.isfinite(states), np.abs(states), 0.0), axis=1)[:, 1:]
    found = np.max(np.abs(local) / np.where(size > 0.0, size, 1.0), axis=2)
    lost = ~np.isfinite(found)
    behind = np.cumsum(lost, axis=1)
    return np.where(behind == 0, np.minimum(found, 1.0), (behind == 1) & lost)


def propagators(jacobian: np.ndarray, length: np.ndarray) -> np.ndarray:
    """How a small change of the state goes on (C, K, n, n), from Jacobians and lengths (C, K) of steps."""
    shape = jacobian.shape
    return propagator(jacobian.reshape(-1, *shape[2:]), length.reshape(-1)).reshape(shape)


def _reach(local: np.ndarray, forwards: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """|e_k|_G (C, K), eq. (1); `squares` (C, K + 1, n, n) are C_k' C_k."""
    gram, found = np.zeros_like(squares[:, 0]), np.zeros(local.shape[:2])
    for k in range(local.shape[1] - 1, -1, -1):
        gram = gram + squares[:, k + 1]
        found[:, k] = np.einsum("ci,cij,cj->c", local[:, k], gram, local[:, k])
        gram = np.swapaxes(forwards[:, k], 1, 2) @ gram @ forwards[:, k]
    return np.sqrt(np.maximum(found, 0.0))


def mesh_at(
    problem: Problem,
    zs: np.ndarray,
    units: Mapping[str, float],
    tolerance: float,
    part: float = 1.0,
    *,
    quarter: bool = False,
    most: float = np.inf,
) -> Problem:
    """The problem on a mesh with one step in each interval, whose error at the cube points zs (C, d) is below
    `tolerance` (rms) in `units`.

    It is made anew, from samples and known times alone, or with `quarter` from a quarter of the steps there are:
    halving too long steps can change nothing and say nothing. It is below at this `part` of the points at least; points
    that no mesh lets follow are left out. The problem itself where one step between samples is enough. A mesh that has
    come to more than `most` steps a sample is left as it is.
    """
    own = problem.predictor.stepping()
    base = problem.with_simulator(Simulator(own.vector, own.stepper, 1, own.interpolated))
    current = base.with_mesh({}) if problem.mesh else base
    if quarter:
        current = evenly(problem, 4)
    blind = 0
    for _ in range(ROUNDS):
        finer, seen = _refined(current, zs, units, tolerance, part)
        blind += not seen
        if not finer or blind > BLIND or sum(map(len, finer.values())) > MOST_STEPS:
            break
        current = base.with_mesh(finer)
        if current.steps_a_sample > most:
            break
    return current


def evenly(problem: Problem, factor: int) -> Problem:
    """The problem with `factor` (a power of 2) times as many steps, all of them in its mesh."""
    own = problem.predictor.stepping()
    halvings = round(np.log2(own.substeps * factor))
    even = problem.with_simulator(Simulator(own.vector, own.stepper, 1, own.interpolated))
    if not halvings:
        return even
    every = {n: _between(np.asarray(d.t), np.full(len(d.t) - 1, halvings)) for n, d in problem.whole_drives.items()}
    return even.with_mesh({n: np.union1d(problem.mesh.get(n, np.zeros(0)), t) for n, t in every.items()})


def errors_at(problem: Problem, zs: np.ndarray, units: Mapping[str, float], factor: int = 1) -> np.ndarray:
    """Step errors (C,) of the measured samples at cube points (C, d), rms in `units`, with `factor` (a power of 2)
    times as many steps."""
    even = evenly(problem, factor)
    found = [effects(even, zs, name, units) for name in even.whole_drives]
    with np.errstate(all="ignore"):
        return np.array(
            [np.sqrt(np.mean(np.concatenate([r.error for r in row]) ** 2)) for row in zip(*found, strict=True)]
        )


def _refined(
    problem: Problem, zs: np.ndarray, units: Mapping[str, float], tolerance: float, part: float
) -> tuple[Any, bool]:
    """Times of a finer mesh by recording, None where this one is fine enough; and whether all recordings could be
    followed somewhere."""
    finer, changed, seen = {}, False, True
    for name, drive in problem.whole_drives.items():
        along = effects_along(problem, zs[0], name, units) if len(zs) == 1 else None
        every = effects(problem, np.asarray(zs), name, units) if along is None else [along]
        levels = [v for v in (_levels(found, tolerance) for found in every) if v is not None]
        seen = seen and bool(levels)
        wanted = np.quantile(levels, part, axis=0, method="higher") if levels else np.ones(len(drive.t) - 1)
        wanted = np.minimum(np.asarray(wanted, dtype=int), FASTEST)
        changed = changed or bool(np.any(wanted > 0))
        finer[name] = np.union1d(problem.mesh.get(name, np.zeros(0)), _between(drive.t, wanted))
    return (finer if changed else None), seen


def _between(t: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Times that halve the intervals of t (N,) as often as `levels` (N - 1,) says."""
    found = [np.zeros(0)]
    for level in np.unique(levels[levels > 0]):
        begin, end = t[:-1][levels == level], t[1:][levels == level]
        shares = np.arange(1, 2**level) / 2.0**level
        found.append((begin[:, None] + (end - begin)[:, None] * shares).ravel())
    return np.setdiff1d(np.concatenate(found), t)


def _levels(found: Effects, tolerance: float) -> np.ndarray | None:
    """Halvings (N - 1,) on the way to an error below a tolerance (rms); None where nothing is known.

    While the error is large, the linearisation says which steps are worst but not how many are needed: only these are
    halved.
    """
    if not found.finite:
        worst = found.local >= np.max(found.local, initial=0.0) / WORST
        return worst.astype(int) if np.any(found.local > 0.0) else None
    if found.rms <= tolerance:
        return np.zeros(len(found.share), dtype=int)
    q = 2.0  # steppers of higher order get there in fewer rounds
    if found.rms > FAR * tolerance and np.any(found.local > ROUGH):
        return _followed_further(found.local)
    root = found.share ** (1.0 / (q + 1.0))
    if not np.sum(root) > 0.0:
        return np.ones(len(found.share), dtype=int)
    # the sum of shares, in units of the error that was seen
    parts = (found.rms / np.sum(found.share) * np.sum(root) / (AIM * tolerance)) ** (1.0 / q) * root
    if found.rms > FAR * tolerance:
        parts = np.minimum(parts, WORST * root / np.max(root))
    parts = np.where(np.isfinite(parts), parts, 0.0)  # nothing is known of such a step
    levels = np.maximum(np.round(np.log2(np.maximum(parts, 1e-3))).astype(int), 0)
    return levels if np.any(levels > 0) else (parts >= np.max(parts)).astype(int)


def _followed_further(local: np.ndarray) -> np.ndarray:
    """Halvings (N - 1,) where some steps are far off, from the errors of single steps (N - 1,).

    Behind the first such step the states are not those of the model, and what is worst there is of no interest. It may
    be far off because earlier errors have led beside an unstable course: the worst of those before it are halved as
    well.
    """
    places = np.arange(len(local))
    cut = int(np.argmax(local > LOST)) if np.any(local > LOST) else len(local)
    worst = np.max(local[:cut], initial=0.0)
    rough = (places == cut) | ((places < cut) & (local > max(worst / WORST, NEGLIGIBLE)))
    return np.where(rough, np.maximum(np.ceil(np.log2(np.maximum(local, ROUGH) / ROUGH) / 3.0), 1), 0).astype(int)


__all__ = ["Effects", "can_mesh", "effects", "errors_at", "mesh_at"]
