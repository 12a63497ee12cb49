"""Simulate a model over the time axis and inputs of one recording."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.simulate.records.rollout import make_rollout
from plantfit.simulate.steps.adaptive import FINEST, adaptive
from plantfit.simulate.steps.grid import Held, Pieces, Steps, delayed_pieces, merge, sampled_pieces
from plantfit.simulate.steps.history import Lag, delayed_rollout, history_grid, ring_length
from plantfit.simulate.steps.linear import exact_step
from plantfit.simulate.steps.registry import ADAPTIVE, EXACT, STEPPERS
from plantfit.simulate.steps.structure import is_linear
from plantfit.simulate.steps.switching import (
    bind_backlash,
    bind_event,
    bind_friction,
    values_of,
    with_backlash,
    with_events,
    with_friction,
)
from plantfit.simulate.steps.times import known_times
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax
import jax.numpy as jnp

EARLY = 1000  # steps before the first sample, at most; as many as the record has samples where these are more


class Drive(NamedTuple):
    """The numbers of one recording that a simulation needs; a pytree, passed rather than compiled in."""

    t: Any  # (N,) s: the samples, and times before or between them at which steps have to end
    value: tuple[Any, ...]  # per input (N,)
    slope: tuple[Any, ...]  # per input (N,), 1/s
    delayed: tuple[Pieces, ...]  # per delayed channel
    first_input: tuple[Any, ...]  # per channel, at the first sample
    first_output: tuple[Any, ...]  # per output, first measured value or nan
    jumps: Any = None  # (E,) s where held inputs jump; only for models with state delays
    ring: Any = None  # (slots,): as many past steps are kept for state delays
    samples: Any = None  # (n,) places of the samples among the times; None: every time is a sample

    def places(self, index: np.ndarray) -> np.ndarray:
        """Places among the times of samples by their number."""
        return index if self.samples is None else np.asarray(self.samples)[index]


@dataclass(frozen=True, eq=False)
class Simulator:
    """`outputs(p, drive)` and `states(p, drive)` for named parameter values; pure jax functions.

    `stepper` is "exponential" (stiff, default), "rosenbrock" (stiff), "rk4", "exact" (matrix exponential, linear models
    only), or "adaptive" (as long as their error allows, smooth models only); `substeps` divides every step of the grid,
    and is the fineness of adaptive ones (see `adaptive`). A smooth input that is interpolated, or a right-hand side
    that uses t, makes steps `varying`.
    """

    vector: VectorModel
    stepper: str = "exponential"
    substeps: int = 1
    interpolated: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, model: Model, *, stepper: str = "exponential", substeps: int = 1, hold: Mapping[str, str] | None = None
    ) -> "Simulator":
        """Raises SimulationError for an unknown stepper, hold or input, or substeps below 1."""
        hold = dict(hold or {})
        if stepper not in STEPPERS:
            raise SimulationError(f"Stepper {stepper!r} is unknown; use one of {sorted(STEPPERS)}.")
        vector = vectorise(model)
        if stepper == EXACT and (model.state_delays or not model.states or not is_linear(vector)):
            raise SimulationError(
                f"Model {model.name!r} is not linear in its states and inputs, "
                "so that no step is exact; use stepper = 'exponential'."
            )
        if stepper == EXACT and (model.frictions or model.backlashes):
            raise SimulationError(
                f"Model {model.name!r} has dry friction or backlash, which "
                "no matrix exponential follows; use stepper = 'exponential'."
            )
        if stepper == ADAPTIVE and (not model.smooth or model.state_delays):
            raise SimulationError(
                f"Model {model.name!r} has late states, events, dry friction that sticks or "
                "backlash, whose steps have a length of their own; use stepper = 'exponential'."
            )
        if stepper == ADAPTIVE and substeps > FINEST:
            raise SimulationError(
                f"substeps = {substeps} is a fineness of adaptive steps "
                f"beyond that of the numbers; give at most {FINEST}."
            )
        if substeps < 1:
            raise SimulationError(f"substeps = {substeps}; give a whole number of at least 1.")
        for delay in model.delays:
            if model.declared(delay.parameter).shape:
                raise SimulationError(
                    f"Model {model.name!r}: the dead time {delay.parameter!r} is "
                    "a table, which only closed loops follow; give one number."
                )
        if model.state_delays and (model.events or model.frictions or model.backlashes):
            raise SimulationError(
                f"Model {model.name!r} has late states together with events, dry friction or "
                "backlash, whose jumps the history would not see; use a smooth form of one of them."
            )
        for name, kind in hold.items():
            if name not in model.inputs:
                raise SimulationError(f"hold names {name!r}, which is not one of the inputs {list(model.inputs)}.")
            if kind not in (Held.PREVIOUS, Held.LINEAR):
                raise SimulationError(f"hold of input {name!r} is {kind!r}; use 'previous' or 'linear'.")
        return cls(vector, stepper, substeps, tuple(n for n, k in hold.items() if k == Held.LINEAR))

    def refined(self, factor: int) -> "Simulator":
        """The same with `factor` times as many substeps."""
        return Simulator(self.vector, self.stepper, self.substeps * factor, self.interpolated)

    @property
    def parts(self) -> int:
        """Into how many equal parts every step of the grid is divided."""
        return 1 if self.stepper == ADAPTIVE else self.substeps

    @property
    def step(self) -> Callable:
        """The stepper, with what the model declares about events, dry friction and backlash around it."""
        return adaptive(self.substeps) if self.stepper == ADAPTIVE else _step(self.vector, self.stepper)

    @property
    def varying(self) -> bool:
        return bool(self.interpolated) or self.vector.uses_time

    def drive(
        self,
        t: np.ndarray,
        inputs: Mapping[str, np.ndarray],
        *,
        before: Mapping[str, float] | None = None,
        measured: Mapping[str, np.ndarray] | None = None,
        longest: Mapping[str, float] | None = None,
        initial_time: float | None = None,
        mesh: np.ndarray | None = None,
    ) -> Drive:
        """Prepare times (N,) in seconds and inputs (N,); `before` gives the inputs ahead of t[0] (default: their first
        value).

        The states begin at `initial_time` (s), by default at t[0]; until t[0] the inputs are those `before`. Times
        known beforehand (see `times`) become times of the drive, and so do those of a `mesh` (k,) that fall inside:
        steps end there as well.

        `measured` outputs are used only for `initial_state`, through their first value that is not missing. `longest`
        gives the largest value (s) of every parameter that delays a state.
        """
        before, measured = dict(before or {}), dict(measured or {})
        model = self.vector.model
        t = np.asarray(t, dtype=float)
        times, samples = self._times(t, initial_time, mesh)
        value: list[np.ndarray] = []
        slope: list[np.ndarray] = []
        history: dict[str, float] = {}
        for name in model.inputs:
            if name not in inputs:
                raise SimulationError(
                    f"Model {model.name!r} needs the input {name!r}, which the recording does not have."
                )
            u = np.asarray(inputs[name], dtype=float)
            if not np.all(np.isfinite(u)):
                k = int(np.argmin(np.isfinite(u)))
                raise SimulationError(
                    f"Input {name!r} is missing at sample {k} ({t[k]:g} s); "
                    "an input needs a value everywhere: fill its gaps or cut the recording there."
                )
            history[name] = float(before[name]) if name in before else float(u[0])
            v, s = sampled_pieces(t, u, self._hold(name))
            v, s = (v, s) if samples is None else _between_samples(times, t, v, s, history[name])
            value.append(v)
            slope.append(s)
        delayed = tuple(
            delayed_pieces(t, np.asarray(inputs[d.input], dtype=float), self._hold(d.input), history[d.input])
            for d in model.delays
        )
        # a state's own past is no input: whoever starts from it gets a missing value
        late = [np.nan for _ in model.state_delays]
        first = [*(v[0] for v in value), *(history[d.input] for d in model.delays), *late, times[0]]
        seen = []
        for name in model.outputs:
            y = np.asarray(measured.get(name, [np.nan]), dtype=float)
            finite = y[np.isfinite(y)]
            seen.append(finite[0] if len(finite) else np.nan)
        jumps, ring = self._history(times, value, longest or {})
        first, seen = (tuple(float(v) for v in values) for values in (first, seen))
        return Drive(times, tuple(value), tuple(slope), delayed, first, seen, jumps, ring, samples)

    def _times(
        self, t: np.ndarray, initial_time: float | None, mesh: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The times at which steps end, and the places of the samples among them; None where they are the samples."""
        early = np.zeros(0)
        if initial_time is not None and initial_time != t[0]:
            if not initial_time < t[0]:
                raise SimulationError(
                    f"initial_time = {initial_time:g} s is not before the first sample at {t[0]:g} "
                    "s; give a time before it, on the recording's own axis, or leave it out."
                )
            pace = float(np.median(np.diff(t))) if len(t) > 1 else t[0] - initial_time
            count = min(int(np.ceil((t[0] - initial_time) / pace)), max(len(t), EARLY))
            early = np.linspace(initial_time, t[0], count + 1)[:-1]
        begun = np.concatenate([early, t])
        known = known_times(self.vector, begun)
        if len(known):  # what lies at a sample but for rounding needs no step of its own
            nearest = np.min(np.abs(known[:, None] - begun), axis=1)
            known = known[nearest > 1e-9 * np.median(np.diff(begun))]
        if mesh is not None:
            own = np.setdiff1d(mesh, begun)
            known = np.union1d(known, own[(own > begun[0]) & (own < begun[-1])])
        if not len(early) and not len(known):
            return t, None
        times = np.sort(np.concatenate([begun, known]))
        return times, np.searchsorted(times, t)

    def _history(self, t: np.ndarray, values: list[np.ndarray], longest: Mapping[str, float]) -> tuple[Any, Any]:
        """Jumps of held inputs, and an array as long as the history that state delays need; None without such."""
        delays = self.vector.model.state_delays
        if not delays:
            return None, None
        missing = [d.parameter for d in delays if d.parameter not in longest]
        if missing:
            raise SimulationError(
                f"The state delay {missing[0]!r} needs its largest value: give longest = {{{missing[0]!r}: seconds}}."
            )
        held = [v for n, v in zip(self.vector.model.inputs, values, strict=True) if self._hold(n) == Held.PREVIOUS]
        jumps = np.unique(np.concatenate([t[np.flatnonzero(np.diff(v, prepend=v[:1]))] for v in held] or [np.zeros(0)]))
        most = [longest[d.parameter] for d in delays]
        # twice: for the check by halving the steps
        return jumps, np.zeros(ring_length(t, 2 * self.substeps, jumps, most))

    def _hold(self, name: str) -> str:
        return Held.LINEAR if name in self.interpolated else Held.PREVIOUS

    def outputs(self, p: Mapping[str, Any], drive: Drive) -> dict[str, Any]:
        """Every output at every sample, name -> (n,)."""
        vector = self.vector
        y = jax.vmap(vector.output, in_axes=(0, 0, None))(*self.trajectories(p, drive), self.positional(p))
        return dict(zip(vector.outputs, y, strict=True))

    def trajectories(self, p: Mapping[str, Any], drive: Drive) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Every state and every channel of the model at every sample, two tuples of (n,)."""
        late_states = bool(self.vector.model.state_delays)
        x, late = self._states_with_history(p, drive) if late_states else (self.states(p, drive), ())
        found = x, self.channels(p, drive, late)
        return found if drive.samples is None else jax.tree.map(lambda a: jnp.take(a, drive.samples), found)

    def channels(self, p: Mapping[str, Any], drive: Drive, late_states: tuple[Any, ...] = ()) -> tuple[Any, ...]:
        """Every channel of the model at every time, a tuple of (N,): inputs, late inputs, `late_states`, time."""
        return (*drive.value, *self._late_inputs(p, drive), *late_states, drive.t)

    def states(
        self, p: Mapping[str, Any], drive: Drive, x0: tuple[Any, ...] | None = None, *, forwards: bool = False
    ) -> tuple[Any, ...]:
        """Every state at every time of the drive, a tuple of (N,) in the order of the model; from x0 (by default
        `initial`) at the first.

        Models with late states always begin at `initial`. With `forwards` only derivatives in forward mode can be
        taken, in less time.
        """
        if not self.vector.states:
            return ()
        if self.vector.model.state_delays:
            return self._states_with_history(p, drive)[0]
        steps, z = self.steps(p, drive)
        x0 = self.initial(p, drive.first_input, drive.first_output) if x0 is None else x0
        later = _rollout(self, forwards)(self.positional(p), x0, _divided(z, self.parts, self.vector.timed_events))
        fine = (jnp.concatenate([jnp.reshape(a, (1,)), x]) for a, x in zip(x0, later, strict=True))
        return tuple(jnp.take(x, steps.rank * self.parts) for x in fine)

    def _states_with_history(self, p, drive: Drive):
        """States at the samples, and the late states there (linear between steps)."""
        vector = self.vector
        lists = tuple(c.knots + d for c, d in zip(drive.delayed, self._delays(p), strict=True))
        late = [p[d.parameter] for d in vector.model.state_delays]
        grid = history_grid(drive.t, self.substeps, drive.jumps, late, lists)
        begin, end = grid.times[:-1], grid.times[1:]
        u0, u1 = [], []
        for value, slope in zip(drive.value, drive.slope, strict=True):
            v, s, origin = (jnp.take(a, grid.sample) for a in (value, slope, drive.t))
            u0.append(v + s * (begin - origin))
            u1.append(v + s * (end - origin))
        for pieces, delay in zip(drive.delayed, self._delays(p), strict=True):
            index = jnp.searchsorted(pieces.knots, 0.5 * (begin + end) - delay, side="right")
            v, s, origin = (jnp.take(a, index) for a in (pieces.value, pieces.slope, pieces.origin))
            u0.append(v + s * (begin - delay - origin))
            u1.append(v + s * (end - delay - origin))
        first = len(u0)
        lags = [
            Lag(first + i, vector.states.index(d.state), delay)
            for i, (d, delay) in enumerate(zip(vector.model.state_delays, late, strict=True))
        ]
        nothing = [jnp.zeros_like(begin) for _ in lags]
        u0, u1 = (*u0, *nothing, begin), (*u1, *nothing, end)
        x0 = self.initial(p, drive.first_input, drive.first_output)
        x = delayed_rollout(
            self.step, vector.rate, x0, u0, u1, self.positional(p), grid.times, lags, drive.ring.shape[0]
        )
        after = tuple(jnp.interp(drive.t - lag.delay, grid.times, x[lag.state]) for lag in lags)
        return tuple(jnp.take(a, grid.rank) for a in x), after

    def initial(
        self, p: Mapping[str, Any], first_input: tuple[Any, ...], first_output: tuple[Any, ...]
    ) -> tuple[Any, ...]:
        """The states at the first sample, from every channel there and the first measured outputs (see `Drive`)."""
        model = self.vector.model
        if model.initial_state is None:
            return tuple(jnp.zeros(()) for _ in self.vector.states)
        u0 = dict(zip(self.vector.channels, first_input, strict=True))
        y0 = dict(zip(self.vector.outputs, first_output, strict=True))
        x0 = model.initial_state(dict(p), u0, y0)
        missing = [n for n in self.vector.states if n not in x0]
        if missing:
            raise SimulationError(
                f"Model {model.name!r}: initial_state gives no value for the state {missing[0]!r}; return every state."
            )
        return tuple(jnp.asarray(x0[n], dtype=float) for n in self.vector.states)

    def positional(self, p: Mapping[str, Any]) -> tuple[Any, ...]:
        """Named parameter values in the order of the model."""
        return tuple(jnp.asarray(p[n], dtype=float) for n in self.vector.parameters)

    def _delays(self, p):
        return tuple(p[d.parameter] for d in self.vector.model.delays)

    def steps(self, p: Mapping[str, Any], drive: Drive) -> tuple[Steps, tuple[tuple[Any, ...], tuple[Any, ...], Any]]:
        """The grid, and per step (inputs at its start, inputs at its end, length)."""
        delays = self._delays(p)
        if delays:
            steps = merge(drive.t, tuple(c.knots for c in drive.delayed), delays)
        else:
            n = drive.t.shape[0]
            steps = Steps(drive.t[:-1], drive.t[1:] - drive.t[:-1], jnp.arange(n - 1), (), jnp.arange(n))
        end = steps.start + steps.length
        at_start, at_end = [], []
        for value, slope in zip(drive.value, drive.slope, strict=True):
            v, s, origin = (jnp.take(a, steps.sample) for a in (value, slope, drive.t))
            at_start.append(v + s * (steps.start - origin))
            at_end.append(v + s * (end - origin))
        for pieces, index, delay in zip(drive.delayed, steps.piece, delays, strict=True):
            v, s, origin = (jnp.take(a, index) for a in (pieces.value, pieces.slope, pieces.origin))
            at_start.append(v + s * (steps.start - delay - origin))
            at_end.append(v + s * (end - delay - origin))
        at_start.append(steps.start)
        at_end.append(exact_ends(steps.start, end) if self.vector.timed_events else end)
        return steps, (tuple(at_start), tuple(at_end), steps.length)

    def _late_inputs(self, p, drive: Drive):
        """Delayed inputs at the samples, for outputs that read them."""
        for pieces, delay in zip(drive.delayed, self._delays(p), strict=True):
            late = drive.t - delay
            index = jnp.searchsorted(pieces.knots, late, side="right")
            v, s, origin = (jnp.take(a, index) for a in (pieces.value, pieces.slope, pieces.origin))
            yield v + s * (late - origin)


@lru_cache(maxsize=16)
def _step(vector: VectorModel, stepper: str) -> Callable:
    """One function for all simulators of a model, which is traced once."""

    def exact(rate, x, u0, u1, h, p, varying, pattern=None):
        return exact_step(vector, p, h, varying)(x, u0, u1)

    model, step = vector.model, exact if stepper == EXACT else STEPPERS[stepper].step
    step = with_backlash(step, *(bind_backlash(backlash, vector) for backlash in model.backlashes))
    for friction in model.frictions:
        step = with_friction(step, bind_friction(friction, vector))
    return with_events(step, [bind_event(e, vector) for e in model.events])


def exact_ends(start: Any, end: Any) -> Any:
    """Ends (K,) of steps as the starts of those that follow, so that no moment falls between two steps or into both."""
    return jnp.concatenate([start[1:], end[-1:]])


def _between_samples(times, t, value, slope, before):
    """Value and slope (N,) at `times`, of those (n,) at the samples `t`; `before` the first."""
    k = np.maximum(np.searchsorted(t, times, side="right") - 1, 0)
    early = times < t[0]
    return np.where(early, before, value[k] + slope[k] * (times - t[k])), np.where(early, 0.0, slope[k])


def _divided(z, m: int, timed: bool = False):
    """Every step in m equal parts, the inputs linear inside; `timed`: the last of them, time, without a gap between
    parts."""
    if m == 1:
        return z
    start, end, length = z
    share = jnp.arange(m) / m

    def between(a, b, offset):
        return (a[:, None] + (b - a)[:, None] * (share + offset)).reshape(-1)

    begins = tuple(between(a, b, 0.0) for a, b in zip(start, end, strict=True))
    ends = tuple(between(a, b, 1.0 / m) for a, b in zip(start, end, strict=True))
    if timed:
        ends = (*ends[:-1], exact_ends(begins[-1], end[-1]))
    return begins, ends, jnp.repeat(length / m, m)


def _rollout(simulator: Simulator, forwards: bool):
    vector, varying = simulator.vector, simulator.varying

    def one(step, p, x, z):
        u0, u1, h = z
        return step(vector.rate, x, u0, u1, h, p, varying, vector.pattern)

    return make_rollout(partial(one, simulator.step), partial(one, values_of(simulator.step)), forwards=forwards)
