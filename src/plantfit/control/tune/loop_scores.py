"""What a loop is judged by: a step of the set point from rest, then a step of load at the plant's input."""

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple, Protocol

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Settings, checked, pid_law
from plantfit.control.tune.one_loop import LEVEL, LOAD, REST, OneLoop, Rest
from plantfit.simulate.loop.closed_loop import ClosedLoop, Controller, Observer

import jax
import jax.numpy as jnp
from jax.scipy.special import erf

MOVES = "moves by noise"


class LoopScores(NamedTuple):
    """Of one loop: `iae` integral of |set point - y| over the size of the step (s), `overshoot` beyond it in percent
    of the step, `settling` (s) of the first sample from which y stays within 2 % (inf if never), `left` the largest
    |set point - y| of the last fifth of the step as a share of it, `load_iae` integral of |set point - y| after the
    load (unit of y, s), `load_peak` its largest, `travel` sum of the moves of the input, those by noise included,
    `outside` how far y was beyond its limits at most (unit of y), `itae` integral of t |set point - y| of the step over
    its size (s^2)."""

    iae: Any
    overshoot: Any
    settling: Any
    left: Any
    load_iae: Any
    load_peak: Any
    travel: Any
    outside: Any
    itae: Any


@dataclass(frozen=True)
class StepAndLoad:
    """From rest at `start` to `level`, at `seconds` / 2 a step of `load` at the plant's input, until `seconds`; y is
    to stay between `lowest` and `highest`."""

    start: float
    level: float
    load: float
    seconds: float
    period: float
    lowest: float = -math.inf
    highest: float = math.inf

    @property
    def samples(self) -> int:
        return round(self.seconds / self.period)

    @property
    def begin(self) -> int:
        """The sample of the load."""
        return self.samples // 2

    def loads(self) -> np.ndarray:
        """The load (N,) of every sample."""
        return np.where(np.arange(self.samples) >= self.begin, self.load, 0.0)

    def reference(self) -> dict[str, float]:
        """What the loop follows and what its observer judges by."""
        return {LEVEL: self.level, "step": self.level - self.start, "lowest": self.lowest, "highest": self.highest}


def from_rest(controller: Controller) -> Controller:
    """A controller whose parameters are (its own, the input at rest), with commands counted from that input, as
    loops here take them."""

    def update(state, measurement, reference, parameters):
        state, command = controller.update(state, measurement, reference, parameters)
        return state, command - parameters[1]

    return Controller(controller.init, update)


@lru_cache(maxsize=32)
def slewed(controller: Controller, most: float) -> Controller:
    """A controller whose commands, counted from rest, reach the plant through an actuator that moves by `most` a
    sample at most."""
    if math.isinf(most):
        return controller

    def init(measurement, parameters):
        return controller.init(measurement, parameters), jnp.zeros(())

    def update(state, measurement, reference, parameters):
        own, last = state
        own, command = controller.update(own, measurement, reference, parameters)
        given = jnp.clip(command, last - most, last + most)
        return (own, given), given

    return Controller(init, update)


def limited_pid(period: float, lower: float, upper: float, anti_windup: str, tracking_time: float | None) -> Controller:
    """`control.pid` that begins at rest at any input; parameters (gains, input at rest), commands counted from that
    input."""
    follow = checked(Settings(period, lower, upper, anti_windup, tracking_time)).follow
    base, limits = pid_of_limits(period, anti_windup), Limits(lower, upper, follow)

    def init(measurement, parameters):
        return base.init(measurement, (*parameters, limits))

    def update(state, measurement, reference, parameters):
        return base.update(state, measurement, reference, (*parameters, limits))

    return Controller(init, update)


class Limits(NamedTuple):
    """Of a PID's command, and the share of an excess that back-calculation takes off its integral in a sample."""

    lower: Any
    upper: Any
    follow: Any


@lru_cache(maxsize=32)  # one identity for a choice, so that loops compile once
def pid_of_limits(period: float, anti_windup: str) -> Controller:
    """`limited_pid` whose limits are data: parameters (gains, input at rest, `Limits`)."""
    init_pid, update_pid = pid_law(period, anti_windup)

    def init(measurement, parameters):
        gains, rest, _ = parameters
        return init_pid(measurement, gains).at_rest(measurement, rest, gains)

    def update(state, measurement, reference, parameters):
        gains, rest, limits = parameters
        state, command = update_pid(state, measurement, reference, gains, *limits)
        return state, command - rest

    return Controller(init, update)


def expected_size(move: Any, spread: Any) -> Any:
    """E |move + n| of a normal n of mean 0 and standard deviation `spread`; |move| where that is 0. jax-traceable."""
    spread = jnp.maximum(spread, 1e-300)
    far = jnp.abs(move) / spread
    return spread * math.sqrt(2.0 / math.pi) * jnp.exp(-0.5 * far**2) + jnp.abs(move) * erf(far / math.sqrt(2.0))


@lru_cache(maxsize=32)  # one identity for a choice, so that loops compile once
def observer(begin: int, period: float, output: str | None = None, noisy: bool = False) -> Observer:
    """Folds a loop whose input is counted from rest, with the load from sample `begin` on, into `LoopScores`; its
    reference is that of `StepAndLoad.reference`. `output` names the one that is judged where several are measured.

    The loop is simulated without noise. With `noisy` the reference also holds `MOVES`, the standard deviation of what
    noise adds to every move of the input, and the travel is the expected one.
    """
    half = begin * period
    late = 0.8 * half

    def init(y, reference):
        y = y if output is None else y[output]
        zero = 0.0 * y
        return {
            "size": zero + jnp.abs(reference["step"]),
            "iae": zero, "beyond": zero, "settled": zero, "left": zero, "load_iae": zero, "peak": zero, "travel": zero,
            "u": zero,
            "outside": zero, "itae": zero,
        }  # fmt: skip

    def update(seen, t, y, u, reference):
        y = y if output is None else y[output]
        off, size = jnp.abs(reference[LEVEL] - y), seen["size"]
        step = t < half - 1e-9 * period
        beyond = jnp.sign(reference["step"]) * (y - reference[LEVEL])
        last = step & (t >= late)
        return {
            "size": size,
            "iae": seen["iae"] + jnp.where(step, period * off, 0.0),
            "beyond": jnp.where(step, jnp.maximum(seen["beyond"], beyond), seen["beyond"]),
            # nan is outside of every band
            "settled": jnp.where(step & ~(off <= 0.02 * size), t + period, seen["settled"]),
            "left": jnp.where(last, jnp.maximum(seen["left"], off), seen["left"]),
            "load_iae": seen["load_iae"] + jnp.where(step, 0.0, period * off),
            "peak": jnp.where(step, 0.0, jnp.maximum(seen["peak"], off)),
            "travel": seen["travel"]
            + (expected_size(u - seen["u"], reference[MOVES]) if noisy else jnp.abs(u - seen["u"])),
            "u": u,
            "outside": jnp.maximum(seen["outside"], jnp.maximum(y - reference["highest"], reference["lowest"] - y)),
            "itae": seen["itae"] + jnp.where(step, period * (t + 0.5 * period) * off, 0.0),
        }

    def result(seen):
        gone = jnp.where(jnp.isfinite(seen["load_iae"]), 0.0, jnp.nan)
        settled = jnp.where(seen["settled"] < half - 0.5 * period, seen["settled"], jnp.inf)
        size = seen["size"]
        return LoopScores(
            seen["iae"] / size + gone, 100.0 * seen["beyond"] / size + gone, settled + gone, seen["left"] / size + gone,
            seen["load_iae"],
            seen["peak"] + gone, seen["travel"] + gone, seen["outside"] + gone, seen["itae"] / size + gone,
        )  # fmt: skip

    return Observer(init, update, result)


@dataclass(frozen=True, eq=False)
class Judge:
    """The loop of a `OneLoop` with one form of controller; `start` where its plants rest before the step.

    Every number but the period and the counts of samples is data of one compiled program: loops of other plants of the
    same model, with other limits and another step, do not compile it again.
    """

    plant: OneLoop
    start: Rest
    course: StepAndLoad
    loop: ClosedLoop
    given: tuple[Any, ...] = ()

    @classmethod
    def of(
        cls,
        plant: OneLoop,
        start: Rest,
        course: StepAndLoad,
        quantum: float,
        form: "Looped",
        inner_quantum: float = 0.0,
    ) -> "Judge":
        """With sensors of steps `quantum`, and a form's controller, whose parameters are (its own, the input at
        rest, *`form.given`)."""
        inner = inner_quantum if form.inner else None
        return cls(plant, start, course, plant.closed(form.loop, course.period, quantum, inner), form.given)

    def part(self, rows: slice) -> "Judge":
        """The same on some of the plants."""
        start = Rest(*(getattr(self.start, n)[rows] for n in ("x", "u", "A", "B", "C", "D", "late")))
        return Judge(self.plant.part(rows), start, self.course, self.loop, self.given)

    @property
    def program(self) -> "Program":
        """What is compiled."""
        judged = None if self.loop.parts.single_output else self.plant.output
        return Program(self.loop, self.course.begin, self.course.samples, self.plant.vector.states, judged)

    def data(self) -> "LoopData":
        """What it is compiled for: numbers."""
        reference = {k: jnp.asarray(v, dtype=float) for k, v in self.course.reference().items()}
        inputs = {n: jnp.asarray(v, dtype=float) for n, v in self.plant.others.items()}
        return LoopData(
            self.rows(),
            reference,
            {**inputs, LOAD: jnp.asarray(self.course.loads())},
            jax.tree.map(jnp.asarray, self.given),
        )

    def rows(self) -> tuple[Any, Any, Any]:
        """Parameters, states and input at rest of every plant, with a leading axis."""
        p = {n: jnp.asarray(v, dtype=float) for n, v in self.plant.plants.items()}
        return p, jnp.asarray(self.start.x), jnp.asarray(self.start.u)

    def scores(self, controllers: Any, moves: Any = 0.0) -> LoopScores:
        """Every controller (a pytree of parameters with a leading axis) on every plant: arrays (controllers,
        plants); jax-traceable. `moves` is the standard deviation of what noise adds to every move of the input, one or
        (controllers, plants)."""
        count = len(jax.tree.leaves(controllers)[0])
        every = jnp.broadcast_to(jnp.asarray(moves, dtype=float), (count, self.plant.count))
        return scores_of(self.program, controllers, self.data(), every)

    def responses(self, gains: Any) -> dict[str, np.ndarray]:
        """t (N,), outputs y and inputs u (plants, N) of one controller."""
        y, u = _responses(self.program, jax.tree.map(lambda v: jnp.asarray(v, dtype=float), gains), self.data())
        return {"t": self.course.period * np.arange(self.course.samples), "y": np.asarray(y), "u": np.asarray(u)}


class Looped(Protocol):
    """A controller `loop` whose parameters are (its own, the input at rest, *`given`)."""

    @property
    def loop(self) -> Controller: ...

    @property
    def inner(self) -> bool: ...

    @property
    def given(self) -> tuple[Any, ...]: ...


class LoopData(NamedTuple):
    """Numbers of a `Judge`: its `rows`, reference, inputs, and what its controller is given."""

    rows: tuple[Any, Any, Any]
    reference: dict[str, Any]
    inputs: dict[str, Any]
    given: tuple[Any, ...]


@dataclass(frozen=True)
class Program:
    """A loop, the sample of the load and the count of samples, the states of the plant, the output that is judged
    where several are measured: equal ones share compiled functions."""

    loop: ClosedLoop
    begin: int
    samples: int
    states: tuple[str, ...]
    output: str | None = None

    def one(self, controller: Any, row: tuple[Any, Any, Any], data: LoopData) -> tuple[Any, Any, Any, dict[str, Any]]:
        """Arguments of a loop with the plant of a row."""
        p, x, u = row
        x0 = dict(zip(self.states, x, strict=True))
        return (controller, u, *data.given), {**p, REST: u}, data.reference, {"x0": x0, "inputs": data.inputs}


@partial(jax.jit, static_argnums=0)
def scores_of(program: Program, controllers: Any, data: LoopData, moves: Any = None) -> LoopScores:
    """`Judge.scores` of a program; without `moves` (controllers, plants) noise is left out."""
    noisy = moves is not None
    seen = observer(program.begin, program.loop.period, program.output, noisy)

    def one(gains, row, moved):
        parameters, values, reference, given = program.one(gains, row, data)
        reference = reference | {MOVES: moved} if noisy else reference
        return program.loop.observe(seen, parameters, values, reference, **given)

    over_plants = jax.vmap(one, in_axes=(None, 0, 0 if noisy else None))
    return jax.vmap(over_plants, in_axes=(0, None, 0 if noisy else None))(controllers, data.rows, moves)


@partial(jax.jit, static_argnums=0)
def _responses(program: Program, gains: Any, data: LoopData) -> tuple[Any, Any]:
    def one(row):
        parameters, values, reference, given = program.one(gains, row, data)
        seen = program.loop.simulate(parameters, values, reference, **given)
        return seen.y if program.output is None else seen.y[program.output], seen.u + row[2]

    return jax.vmap(one)(data.rows)
