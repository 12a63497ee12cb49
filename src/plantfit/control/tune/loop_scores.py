"""What a loop is judged by: a step of the set point from rest, then a step of load at the plant's input."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import pid
from plantfit.control.tune.one_loop import LOAD, REST, OneLoop, Rest
from plantfit.simulate.loop.closed_loop import ClosedLoop, Controller, Observer

import jax
import jax.numpy as jnp


class LoopScores(NamedTuple):
    """Of one loop: `iae` integral of |set point - y| over the size of the step (s), `overshoot` beyond it in percent of the step,
    `settling` (s) of the first sample from which y stays within 2 % (inf if never), `left` the largest |set point - y| of the last fifth of
    the step as a share of it, `load_iae` integral of |set point - y| after the load (unit of y, s), `load_peak` its largest,
    `travel` sum of
    the moves of the input, `outside` how far y was beyond its limits at most (unit of y)."""

    iae: Any
    overshoot: Any
    settling: Any
    left: Any
    load_iae: Any
    load_peak: Any
    travel: Any
    outside: Any


@dataclass(frozen=True)
class StepAndLoad:
    """From rest at `start` to `level`, at `seconds` / 2 a step of `load` at the plant's input, until `seconds`; y is to stay between
    `lowest` and `highest`."""

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


def from_rest(controller: Controller) -> Controller:
    """A controller whose parameters are (its own, the input at rest), with commands counted from that input, as loops here take them."""

    def update(state, measurement, reference, parameters):
        state, command = controller.update(state, measurement, reference, parameters)
        return state, command - parameters[1]

    return Controller(controller.init, update)


def slewed(controller: Controller, most: float) -> Controller:
    """A controller whose commands, counted from rest, reach the plant through an actuator that moves by `most` a sample at most."""
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
    """`control.pid` that begins at rest at any input; parameters (gains, input at rest), commands counted from that input."""
    base = pid(period, lower=lower, upper=upper, anti_windup=anti_windup, tracking_time=tracking_time)

    def init(measurement, parameters):
        gains, rest = parameters
        return base.init(measurement, gains)._replace(integral=rest - gains.Kp * (gains.b - 1.0) * measurement)

    def update(state, measurement, reference, parameters):
        gains, rest = parameters
        state, command = base.update(state, measurement, reference, gains)
        return state, command - rest

    return Controller(init, update)


@lru_cache(maxsize=32)  # one identity for a choice, so that loops compile once
def observer(course: StepAndLoad) -> Observer:
    """Folds a loop whose input is counted from rest into `LoopScores`."""
    size, sign, half = abs(course.level - course.start), np.sign(course.level - course.start), course.begin * course.period
    late = 0.8 * half

    def init(y, reference):
        zero = 0.0 * y
        return {
            "iae": zero, "beyond": zero, "settled": zero, "left": zero, "load_iae": zero, "peak": zero, "travel": zero, "u": zero,
            "outside": zero,
        }  # fmt: skip

    def update(seen, t, y, u, reference):
        off = jnp.abs(course.level - y)
        step = t < half - 1e-9 * course.period
        last = step & (t >= late)
        return {
            "iae": seen["iae"] + jnp.where(step, course.period * off, 0.0),
            "beyond": jnp.where(step, jnp.maximum(seen["beyond"], sign * (y - course.level)), seen["beyond"]),
            # nan is outside of every band
            "settled": jnp.where(step & ~(off <= 0.02 * size), t + course.period, seen["settled"]),
            "left": jnp.where(last, jnp.maximum(seen["left"], off), seen["left"]),
            "load_iae": seen["load_iae"] + jnp.where(step, 0.0, course.period * off),
            "peak": jnp.where(step, 0.0, jnp.maximum(seen["peak"], off)),
            "travel": seen["travel"] + jnp.abs(u - seen["u"]),
            "u": u,
            "outside": jnp.maximum(seen["outside"], jnp.maximum(y - course.highest, course.lowest - y)),
        }

    def result(seen):
        gone = jnp.where(jnp.isfinite(seen["load_iae"]), 0.0, jnp.nan)
        settled = jnp.where(seen["settled"] < half - 0.5 * course.period, seen["settled"], jnp.inf)
        return LoopScores(
            seen["iae"] / size + gone, 100.0 * seen["beyond"] / size + gone, settled + gone, seen["left"] / size + gone, seen["load_iae"],
            seen["peak"] + gone, seen["travel"] + gone, seen["outside"] + gone,
        )  # fmt: skip

    return Observer(init, update, result)


@dataclass(frozen=True, eq=False)
class Judge:
    """The loop of a `OneLoop` with one form of controller; `start` where its plants rest before the step."""

    plant: OneLoop
    start: Rest
    course: StepAndLoad
    loop: ClosedLoop

    @classmethod
    def of(cls, plant: OneLoop, start: Rest, course: StepAndLoad, quantum: float, controller: Controller) -> "Judge":
        """With a sensor of steps `quantum`, and a controller whose parameters are (its own, the input at rest)."""
        return cls(plant, start, course, plant.closed(controller, course.period, quantum))

    def part(self, rows: slice) -> "Judge":
        """The same on some of the plants."""
        start = Rest(*(getattr(self.start, n)[rows] for n in ("x", "u", "A", "B", "C", "D", "late")))
        return Judge(self.plant.part(rows), start, self.course, self.loop)

    def rows(self) -> tuple[Any, Any, Any]:
        """Parameters, states and input at rest of every plant, with a leading axis."""
        p = {n: jnp.asarray(v, dtype=float) for n, v in self.plant.plants.items()}
        return p, jnp.asarray(self.start.x), jnp.asarray(self.start.u)

    def _given(self, p: Any, x: Any, u: Any) -> tuple[Any, dict[str, Any]]:
        x0 = dict(zip(self.plant.vector.states, x, strict=True))
        return {**p, REST: u}, {"x0": x0, "inputs": {**self.plant.others, LOAD: jnp.asarray(self.course.loads())}}

    def scores(self, controllers: Any) -> LoopScores:
        """Every controller (a pytree of parameters with a leading axis) on every plant: arrays (controllers, plants); jax-traceable."""
        seen, level = observer(self.course), self.course.level

        def one(gains, row):
            p, x, u = row
            values, given = self._given(p, x, u)
            return self.loop.observe(seen, (gains, u), values, level, **given)

        return jax.vmap(lambda g: jax.vmap(lambda r: one(g, r))(self.rows()))(controllers)

    def responses(self, gains: Any) -> dict[str, np.ndarray]:
        """t (N,), outputs y and inputs u (plants, N) of one controller."""

        def one(row):
            p, x, u = row
            values, given = self._given(p, x, u)
            seen = self.loop.simulate((gains, u), values, self.course.level, **given)
            return seen.y, seen.u + u

        y, u = jax.jit(jax.vmap(one))(self.rows())
        return {"t": self.course.period * np.arange(self.course.samples), "y": np.asarray(y), "u": np.asarray(u)}
