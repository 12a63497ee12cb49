"""A record followed by solvers of scipy at tight tolerances, independent of the steppers: what a simulation is compared
with.

Smooth models are followed by LSODA (A. C. Hindmarsh, ODEPACK, 1983), begun anew at every edge of an input. Events, dry
friction that sticks, backlash and late states are followed by DOP853 (E. Hairer, S. P. Norsett, G. Wanner, Solving
Ordinary Differential Equations I, sec. II.10) mode by mode: where its dense output passes a surface, the moment is
found by bisection and the solver begins anew there. Late states come from the dense outputs before (method of steps). A
record that cannot be followed ends in `Stopped`.
"""

import warnings
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import scipy  # scipy.integrate is loaded at its first use

import plantfit.runtime  # noqa: F401
from plantfit.native.kept_programs import kept
from plantfit.simulate.check.modes import Modes
from plantfit.simulate.check.on_floats import plain_rate
from plantfit.simulate.records.of_one_length import as_long_as_others
from plantfit.simulate.simulator import Drive, Simulator

import jax
import jax.numpy as jnp

EVALUATIONS = 6_000_000  # of the rate, for a whole record
STEPS = 5_000  # of a solver between two edges of the inputs
GROWTH = 1e6  # times what a state was before, from which on it is said to grow without bound
ECHOES = 6
STUCK = 10  # times as many evaluations at one time as a Jacobian takes, by which LSODA's steps are too short to move it


@dataclass(frozen=True)
class Stopped:
    """Where a record could not be followed any further: time (s), the state that is to blame, and its value there."""

    time: float
    state: str
    value: float
    reason: str
    spent: bool = False  # the evaluations allowed were, which says nothing about the answer

    @property
    def sentence(self) -> str:
        return f"at t = {self.time:.6g} s state {self.state} ({self.value:.6g}) {self.reason}"


@dataclass(frozen=True)
class Tight:
    """States (n, N) at the times of the drive and outputs (n,) at its samples, NaN from where it `stopped`."""

    states: np.ndarray
    outputs: dict[str, np.ndarray]
    stopped: Stopped | None
    evaluations: int
    checked_with: str


class _Failed(Exception):
    def __init__(self, stopped: Stopped):
        self.stopped = stopped


@dataclass
class _Run:
    """What is known while a record is followed."""

    vector: Any
    rtol: float
    atol: np.ndarray
    scale: np.ndarray  # the largest size of every state so far
    most: int
    briefly: bool = False
    evaluations: int = 0
    past: list[Any] = field(default_factory=list)  # dense outputs, in order of time
    ends: list[float] = field(default_factory=list)

    def failed(self, t: float, x: np.ndarray, reason: str | None = None) -> _Failed:
        return _Failed(self.stop(t, x, reason))

    def stop(self, t: float, x: np.ndarray, reason: str | None = None) -> Stopped:
        size = np.abs(np.where(np.isfinite(x), x, np.inf)) / self.scale
        worst = int(np.argmax(size))
        grows = size[worst] >= 1e-3 * GROWTH
        reason = reason or ("grows without bound" if grows else "changes too fast for the tight solver to follow")
        spent = self.evaluations > self.most and not grows  # beside a pole evaluations run out, too
        return Stopped(
            float(t),
            self.vector.states[worst],
            float(x[worst]),
            "was reached with the evaluations allowed" if spent else reason,
            spent,
        )


def follow(
    simulator: Simulator,
    p: Mapping[str, Any],
    drive: Drive,
    *,
    rtol: float = 1e-9,
    atol: float = 1e-11,
    evaluations: int = EVALUATIONS,
    briefly: bool = False,
    others: Iterable[Drive] = (),
) -> Tight:
    """Follow a whole record; `atol` is relative to the largest size of each state. It never raises for what a model
    does. With `others` that are followed too, one program serves records of unequal length.

    Beside a pole LSODA spends its steps at one time, and a method for stiff plants then comes up to it once more to
    tell where it is. `briefly` ends at the first sign, for whoever asks only whether a record can be followed.

    24 000 samples with a held input that changes at each take 800 000 evaluations for two states (two minutes on a busy
    machine).
    """
    vector, model = simulator.vector, simulator.vector.model
    p = {k: np.asarray(v, dtype=float) for k, v in p.items()}
    values = simulator.positional(p)
    n, count = len(vector.states), len(drive.t)
    record = _record(simulator, p, drive, others)
    grid, u0, u1, sample = _inputs(simulator, p, drive, record.steps)
    x = np.array([float(v) for v in simulator.initial(p, drive.first_input, drive.first_output)])
    ours = np.asarray(record.states) if n else np.zeros((0, count))
    size = np.max(np.abs(np.where(np.isfinite(ours), ours, 0.0)), axis=1, initial=1e-9) if n else np.zeros(0)
    run = _Run(vector, rtol, atol * size, size, evaluations, briefly)
    reached = np.abs(x)
    states, stopped = np.full((n, count), np.nan), None
    late = np.full((len(model.state_delays), count), np.nan)
    lags = [(vector.states.index(d.state), float(p[d.parameter])) for d in model.state_delays]
    first = x.copy()
    for j in np.flatnonzero(sample == 0):
        states[:, j] = x
    smooth = model.smooth
    motion: Any = _Smooth(vector, values) if smooth or lags else Modes.of(vector, values)
    k = 0
    try:
        while n and k < len(grid) - 1:
            end = k + 1
            while end < len(grid) - 1 and not lags and _goes_on(u0, u1, grid, k, end):  # late kinks end spans
                end += 1
            inside = grid[k + 1 : end + 1]
            if grid[end] > grid[k]:
                span = (grid[k], grid[end], u0[:, k], u1[:, end - 1])
                # a simulation that runs away must not make the tolerance coarse
                reached = np.maximum(reached, np.abs(x))
                run.scale = np.where(reached > 0.0, np.minimum(reached, size), size)
                run.atol = atol * run.scale
                if smooth:
                    found = _by_lsoda(run, motion, x, span, inside)
                elif lags:
                    found = _by_steps(run, motion, x, span, inside, lags, first)
                else:
                    found = motion.follow(run, x, span, inside)
            else:
                found = np.repeat(x[:, None], len(inside), axis=1)
            for j, column in zip(range(k + 1, end + 1), found.T, strict=True):
                states[:, sample == j] = column[:, None]
            x, k = found[:, -1], end
            if not np.all(np.isfinite(x)):
                raise _Failed(run.stop(grid[k], x))
    except _Failed as failed:
        stopped = failed.stopped
    for i, (state, delay) in enumerate(lags):
        late[i] = [_past(run, first, state, s - delay) if s <= grid[k] else np.nan for s in drive.t]
    channels = (*record.channels[: len(record.channels) - 1], *late, record.channels[-1])
    y = _compiled(simulator).output(tuple(states), channels, values)
    y = [np.broadcast_to(np.asarray(v, dtype=float), (count,)) for v in y]
    places = np.arange(count) if drive.samples is None else np.asarray(drive.samples)
    told = "scipy LSODA" if smooth else "scipy DOP853 with late states" if lags else "scipy DOP853 with located events"
    exact = f"{rtol:g}".replace("e-0", "e-")
    return Tight(
        states,
        {o: v[places] for o, v in zip(vector.outputs, y, strict=True)},
        stopped,
        run.evaluations,
        f"{told}, rtol {exact}",
    )


def _record(simulator: Simulator, p: Mapping[str, Any], drive: Drive, others: Iterable[Drive]) -> "Record":
    """What the simulator gives over a record, of a program for the longest of `others`."""
    longer = as_long_as_others(drive, others)
    found = jax.tree.map(np.asarray, _compiled(simulator).record(p, longer))
    count = len(drive.t)
    if len(longer.t) == count:
        return found
    steps, (u0, u1, length) = found.steps
    rank = steps.rank[:count]
    own = slice(rank[-1])
    steps = steps._replace(start=steps.start[own], length=length[own], rank=rank)
    ends = tuple(tuple(np.broadcast_to(c, length.shape)[own] for c in u) for u in (u0, u1))
    return Record((steps, (*ends, length[own])), *(tuple(a[:count] for a in of) for of in found[1:]))


def _inputs(
    simulator: Simulator, p: Mapping[str, Any], drive: Drive, given: tuple[Any, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Grid (K + 1,) s, channels at both ends of every step (m, K), and the place on the grid of every time of the
    drive (N,)."""
    steps, (u0, u1, length) = given
    grid = np.append(steps.start, steps.start[-1] + length[-1]) if len(length) else np.asarray(drive.t)
    a, b = (np.stack([np.broadcast_to(c, length.shape) for c in u]) for u in (u0, u1))
    delays = simulator.vector.model.state_delays
    if not delays:
        return grid, a, b, np.asarray(steps.rank)
    taus = [float(p[d.parameter]) for d in delays]
    kinks = [drive.t[0] + tau * np.arange(1, ECHOES + 1) for tau in taus] + [
        np.asarray(drive.jumps) + tau for tau in taus
    ]
    most = np.arange(drive.t[0], drive.t[-1], min(taus))  # a late value has to lie in a span before
    every = np.unique(np.concatenate([grid, *kinks, most]))
    every = every[every <= grid[-1]]
    own = np.clip(np.searchsorted(grid, every[:-1], side="right") - 1, 0, len(length) - 1)
    slope = (b - a) / np.where(length > 0, length, 1.0)
    begin, end = (a[:, own] + slope[:, own] * (s - grid[own]) for s in (every[:-1], every[1:]))
    nothing = np.zeros((len(delays), len(own)))
    begin, end = (np.concatenate([v[:-1], nothing, v[-1:]]) for v in (begin, end))
    return every, begin, end, np.searchsorted(every, np.asarray(drive.t))


def _goes_on(u0: np.ndarray, u1: np.ndarray, grid: np.ndarray, first: int, k: int) -> bool:
    """Whether step k continues the straight inputs of step `first`; time itself always does."""
    length = grid[first + 1] - grid[first]
    a, b = u0[:-1, first], u1[:-1, first]
    slope = (b - a) / length if length > 0 else np.zeros_like(a)
    size = 1e-12 * (1.0 + np.abs(a))
    there, after = a + slope * (grid[k] - grid[first]), a + slope * (grid[k + 1] - grid[first])
    return bool(np.all(np.abs(u0[:-1, k] - there) <= size) and np.all(np.abs(u1[:-1, k] - after) <= size))


class Record(NamedTuple):
    """What a simulator gives over one record: `Simulator.steps`, `states` and `channels` (without late states)."""

    steps: tuple[Any, Any]
    states: tuple[Any, ...]
    channels: tuple[Any, ...]


class _Compiled(NamedTuple):
    """What is compiled once for all recordings of a simulator: every shape costs tenths of a second."""

    record: Callable[[Any, Any], Record]
    output: Callable


@lru_cache(maxsize=32)
def _compiled(simulator: Simulator) -> _Compiled:
    def record(p, drive):
        return Record(simulator.steps(p, drive), simulator.states(p, drive), simulator.channels(p, drive))

    settings = simulator.vector.model, simulator.stepper, simulator.substeps, simulator.interpolated
    output = jax.vmap(simulator.vector.output, in_axes=(0, 0, None))
    return _Compiled(*(kept(f, f"tight {name}", settings) for name, f in (("record", record), ("output", output))))


def simulated(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> dict[str, np.ndarray]:
    """Every output (N,) at every sample by the simulator's own steps, by what `follow` compiles."""
    p = {k: np.asarray(v, dtype=float) for k, v in p.items()}
    if simulator.vector.model.state_delays:
        return {o: np.asarray(y) for o, y in jax.jit(simulator.outputs)(p, drive).items()}
    record, places = (
        _compiled(simulator).record(p, drive),
        slice(None) if drive.samples is None else np.asarray(drive.samples),
    )
    y = _compiled(simulator).output(record.states, record.channels, simulator.positional(p))
    return {
        o: np.broadcast_to(np.asarray(v), (len(drive.t),))[places]
        for o, v in zip(simulator.vector.outputs, y, strict=True)
    }


@lru_cache(maxsize=32)
def _rates(vector: Any) -> tuple[Callable, Callable]:
    """The rate of a model as a function of the parameters and of (x, u), and its derivatives by these."""
    n = len(vector.states)

    def rate(values, q):
        return jnp.stack(vector.rate(tuple(q[:n]), tuple(q[n:]), values))

    return jax.jit(rate), jax.jit(jax.jacfwd(rate, argnums=1))


class _Smooth:
    """The rate of a model as a function of one vector (x, u), and on floats where the model has a form for these."""

    def __init__(self, vector: Any, values: tuple[Any, ...]):
        call, slopes = _rates(vector)
        self.call, self.slopes = partial(call, values), partial(slopes, values)
        self.plain = plain_rate(vector, values)


def _line(span: tuple[float, float, np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    start, stop, a, b = span
    return a, (b - a) / (stop - start)


def _by_lsoda(run: _Run, motion: _Smooth, x: np.ndarray, span: Any, inside: np.ndarray) -> np.ndarray:
    """States (n, k) at the times `inside`, the last of them the end of the span."""
    (a, slope), start, n = _line(span), span[0], len(x)
    q = np.empty(n + len(a))
    plain = None if motion.plain is None else motion.plain(start, a, slope)
    at, since, held = start, 0, STUCK * (n + 4)

    def rate(x, t):
        nonlocal at, since
        run.evaluations += 1
        if run.briefly:
            at, since = (at, since + 1) if abs(t - at) <= 1e-15 * abs(t) else (t, 0)
            if since > held and np.any(np.abs(x) > GROWTH * run.scale):
                raise _Failed(run.stop(t, x))
        if plain is not None:
            with suppress(ArithmeticError, ValueError):  # infinite, NaN, or nothing that math has: jax knows what it is
                return plain(x, t)
        q[:n], q[n:] = x, a + slope * (t - start)
        return np.asarray(motion.call(q))

    if run.evaluations > run.most:
        raise _Failed(run.stop(start, x))
    times = np.concatenate([[start], inside])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found, told = scipy.integrate.odeint(
            rate, x, times, rtol=run.rtol, atol=run.atol, mxstep=STEPS, full_output=True, tcrit=[inside[-1]]
        )
    if told["message"] == "Integration successful." and np.all(np.isfinite(found)):
        return found[1:].T

    def jacobian(t, x):
        q[:n], q[n:] = x, a + slope * (t - start)
        return np.asarray(motion.slopes(q))[:, :n]

    # where LSODA gives up, a method for stiff plants goes on, or tells where the end is
    solver = scipy.integrate.Radau(
        lambda t, x: rate(x, t), start, x, inside[-1], rtol=run.rtol, atol=run.atol, jac=jacobian
    )
    result = np.full((n, len(inside)), np.nan)
    for _ in range(STEPS):
        t, y = solver.t, solver.y
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                solver.step()
        except (ValueError, np.linalg.LinAlgError):
            raise _Failed(run.stop(t, y)) from None
        if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
            raise _Failed(run.stop(t, y))
        if np.any(np.abs(solver.y) > GROWTH * run.scale):
            raise _Failed(run.stop(solver.t, solver.y))
        passed = (inside > t) & (inside <= solver.t)
        if np.any(passed):
            result[:, passed] = solver.dense_output()(inside[passed])
        if solver.status == "finished":
            result[:, -1] = solver.y
            return result
    raise _Failed(run.stop(solver.t, solver.y))


def _by_steps(run: _Run, motion: _Smooth, x, span, inside, lags, first) -> np.ndarray:
    """The same with late states from the dense outputs before."""
    (a, slope), start, n = _line(span), span[0], len(x)
    late = len(a) - 1 - len(lags)
    q = np.empty(n + len(a))

    def rate(t, x):
        run.evaluations += 1
        q[:n], q[n:] = x, a + slope * (t - start)
        for i, (state, delay) in enumerate(lags):
            q[n + late + i] = _past(run, first, state, t - delay)
        return np.asarray(motion.call(q))

    solver = scipy.integrate.DOP853(rate, start, x, inside[-1], rtol=run.rtol, atol=run.atol)
    result = np.full((n, len(inside)), np.nan)
    for _ in range(STEPS):
        t, y = solver.t, solver.y
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solver.step()
        if solver.status == "failed" or not np.all(np.isfinite(solver.y)) or run.evaluations > run.most:
            raise _Failed(run.stop(t, y))
        dense = solver.dense_output()
        run.past.append(dense)
        run.ends.append(solver.t)
        passed = (inside > t) & (inside <= solver.t)
        if np.any(passed):
            result[:, passed] = dense(inside[passed])
        if solver.status == "finished":
            result[:, -1] = solver.y
            return result
    raise _Failed(run.stop(solver.t, solver.y))


def _past(run: _Run, first: np.ndarray, state: int, t: float) -> float:
    """A state at a time before, its first value before the record."""
    if not run.past or t <= run.past[0].t_old:
        return float(first[state])
    return float(run.past[min(bisect_right(run.ends, t - 1e-12 * (1 + abs(t))), len(run.past) - 1)](t)[state])


__all__ = ["Stopped", "Tight", "follow"]
