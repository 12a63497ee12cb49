"""Events, dry friction and backlash followed mode by mode with scipy's DOP853, for the check of simulations.

In a mode every velocity with friction slides one way or sticks, and every state with play is pushed by one flank or rests. Surfaces end
a mode: conditions of events, velocities that meet zero, the breakaway force, flanks that touch or turn back.
"""

import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

import plantfit.runtime  # noqa: F401
from plantfit.simulate.check.on_floats import floats, on_floats
from plantfit.simulate.steps.switching import bind_backlash, bind_event, bind_friction
from plantfit.simulate.steps.vector import VectorModel, placeholders

import jax
import jax.numpy as jnp

LOOKS = 8  # at the surfaces in every step of the solver
HALVINGS = 60
NEAR = 1e-9  # of a span's travel: a start as near to a surface is on it
AHEAD = 1e-6  # of a span: where the way off a surface is looked at
CHANGES = 200  # of the mode in one span


class _Equations(NamedTuple):
    """Functions of a mode, of tuples of numbers (x, u, du, mode, p); each gives a tuple of tuples."""

    signs: np.ndarray  # per event, 1 falling, -1 rising, 0 both
    velocities: tuple[int, ...]
    plays: tuple[int, ...]
    motion: "_Function"  # rates, x with what is pushed, surfaces
    forces: "_Function"  # force needed to hold and breakaway force of every friction
    jumps: tuple["_Function", ...]  # per event: x
    flanks: "_Function"  # lowest and highest value of every play


class _Values(NamedTuple):
    """Parameters as they are, and as functions on floats take them."""

    arrays: tuple[np.ndarray, ...]
    floats: list[Any]


class _Function:
    """A function of tuples of numbers on floats where it has such a form and a number comes out, else by jax."""

    def __init__(self, vector: VectorModel, function: Callable[..., Any]):
        x, u, p = placeholders(vector.model)
        ways = (1.0,) * (len(vector.model.frictions) + len(vector.model.backlashes))
        self.plain = on_floats(vector.model.name, function, (x, u, u, ways, p))
        self.compiled = jax.jit(lambda *given: tuple(jnp.asarray(part, dtype=float) for part in function(*given)))

    def __call__(self, x: np.ndarray, u: np.ndarray, du: np.ndarray, mode: np.ndarray, p: _Values) -> list[np.ndarray]:
        groups = [np.asarray(v, dtype=float).tolist() for v in (x, u, du, mode)]
        if self.plain is not None:
            with suppress(ArithmeticError, ValueError):
                return [np.array(part) for part in self.plain(*groups, p.floats)]
        return [np.asarray(part) for part in self.compiled(*map(tuple, groups), p.arrays)]


@lru_cache(maxsize=32)
def _equations(vector: VectorModel) -> _Equations:
    model = vector.model
    events = [bind_event(e, vector) for e in model.events]
    frictions = [bind_friction(f, vector) for f in model.frictions]
    plays = [bind_backlash(b, vector) for b in model.backlashes]
    count = len(frictions)

    def ends(play, x, u, p):
        drive, gap = play.drive(x, u, p), play.gap(x, u, p)
        return drive - gap, drive + gap

    def followed(x, u, mode, p):
        for play, way in zip(plays, mode[count:], strict=True):
            low, high = ends(play, x, u, p)
            z = jnp.where(way > 0, low, jnp.where(way < 0, high, x[play.state]))
            x = (*x[: play.state], z, *x[play.state + 1 :])
        return x

    def rubbed(x, u, mode, p):
        rates = list(vector.rate(x, u, p))
        needs, limits = [], []
        for law, way in zip(frictions, mode[:count], strict=True):
            effect, sliding = law.effect(x, u, p), law.sliding(x, u, p)
            need = -rates[law.velocity] / effect[law.velocity]
            needs.append(need)
            limits.append(jnp.maximum(law.breakaway(x, u, p), sliding))
            force = jnp.where(way == 0, need, -way * sliding)
            rates = [r + e * force for r, e in zip(rates, effect, strict=True)]
            rates[law.velocity] = jnp.where(way == 0, 0.0, rates[law.velocity])
        return rates, needs, limits

    def motion(x, u, du, mode, p):
        x = followed(x, u, mode, p)
        rates, needs, limits = rubbed(x, u, mode, p)
        # what is pushed moves with what pushes it
        for play, way in zip(plays, mode[count:], strict=True):
            _, (low, high) = jax.jvp(lambda x, u, play=play: ends(play, x, u, p), (x, u), (tuple(rates), du))
            rates[play.state] = jnp.where(way > 0, low, jnp.where(way < 0, high, 0.0))
        surfaces = [e.when(x, u, p) for e in events]
        surfaces += [
            jnp.where(way == 0, limit - jnp.abs(need), way * x[law.velocity])
            for law, way, need, limit in zip(frictions, mode[:count], needs, limits, strict=True)
        ]
        for play, way in zip(plays, mode[count:], strict=True):
            low, high = ends(play, x, u, p)
            pushed = way * rates[play.state]
            surfaces += [jnp.where(way == 0, x[play.state] - low, pushed), jnp.where(way == 0, high - x[play.state], pushed)]
        return tuple(rates), tuple(x), tuple(surfaces)

    def forces(x, u, du, mode, p):
        _, needs, limits = rubbed(x, u, mode, p)
        return tuple(needs), tuple(limits)

    def jump(event):
        return lambda x, u, du, mode, p: (tuple(event.then(x, u, p)),)

    def flanks(x, u, du, mode, p):
        found = [ends(play, x, u, p) for play in plays]
        return tuple(low for low, _ in found), tuple(high for _, high in found)

    return _Equations(
        np.array([e.sign for e in events], dtype=int),
        tuple(f.velocity for f in frictions),
        tuple(b.state for b in plays),
        _Function(vector, motion),
        _Function(vector, forces),
        tuple(_Function(vector, jump(e)) for e in events),
        _Function(vector, flanks),
    )


@dataclass(frozen=True, eq=False)
class Modes:
    """The motion of a model with parameters `p`. A mode is a vector: per friction 1, -1 or 0 (sticks), per play 1, -1 or 0 (rests)."""

    equations: _Equations
    p: _Values

    @classmethod
    def of(cls, vector: VectorModel, p: Sequence[Any]) -> "Modes":
        return cls(_equations(vector), _Values(tuple(np.asarray(v, dtype=float) for v in p), floats(p)))

    @property
    def signs(self) -> np.ndarray:
        return self.equations.signs

    @property
    def velocities(self) -> tuple[int, ...]:
        return self.equations.velocities

    @property
    def plays(self) -> tuple[int, ...]:
        return self.equations.plays

    def motion(self, x: np.ndarray, u: np.ndarray, du: np.ndarray, mode: np.ndarray) -> list[np.ndarray]:
        """Rates, x with what is pushed, surfaces."""
        return self.equations.motion(x, u, du, mode, self.p)

    def forces(self, x: np.ndarray, u: np.ndarray, mode: np.ndarray) -> list[np.ndarray]:
        """Force needed to hold and breakaway force of every friction."""
        return self.equations.forces(x, u, np.zeros(len(u)), mode, self.p)

    def jump(self, k: int, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The states behind event k."""
        return self.equations.jumps[k](x, u, np.zeros(len(u)), np.zeros(len(self.velocities) + len(self.plays)), self.p)[0]

    def flanks(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Lowest and highest value of every play (k, 2)."""
        still = np.zeros(len(self.velocities) + len(self.plays))
        return np.stack(self.equations.flanks(x, u, np.zeros(len(u)), still, self.p), axis=-1)

    def follow(self, run: Any, x: np.ndarray, span: Any, inside: np.ndarray) -> np.ndarray:
        """States (n, k) at the times `inside`, the last of them the end of the span."""
        start, stop, a, b = span
        du = (b - a) / (stop - start)
        inputs = lambda t: a + du * (t - start)  # noqa: E731
        mode, result, t, x = None, np.full((len(x), len(inside)), np.nan), start, np.array(x)
        for _ in range(CHANGES):
            if mode is None:
                mode, x = self._begin(x, inputs(t), du, stop - start)
            t, x, passed = self._in_one_mode(run, x, t, stop, inputs, du, mode, stop - start, inside, result)
            if passed is None:
                result[:, -1] = x
                return result
            mode, x = self._changed(x, inputs(t), du, mode, passed, stop - start)
            result[:, inside == t] = x[:, None]
            if t >= stop:
                return result
        raise run.failed(t, x, "changes its mode without end")

    def _begin(self, x: np.ndarray, u: np.ndarray, du: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
        mode = np.zeros(len(self.velocities) + len(self.plays))
        flanks = self.flanks(x, u)
        for k, (i, (low, high)) in enumerate(zip(self.plays, flanks, strict=True)):
            x[i] = np.clip(x[i], low, high)
            size = NEAR * (abs(low) + abs(high) + 1e-300)
            mode[len(self.velocities) + k] = 1.0 if x[i] - low <= size else -1.0 if high - x[i] <= size else 0.0
        for k, i in enumerate(self.velocities):
            mode[k] = np.sign(x[i])
        need, limit = self.forces(x, u, mode)
        for k, i in enumerate(self.velocities):
            if x[i] == 0.0 and abs(need[k]) > limit[k]:
                mode[k] = -np.sign(need[k])
        return self._turned_back(x, u, du, mode), x

    def _turned_back(self, x, u, du, mode) -> np.ndarray:
        """The mode with flanks at rest that do not push."""
        rates = self.motion(x, u, du, mode)[0]
        for k, i in enumerate(self.plays, len(self.velocities)):
            if mode[k] * rates[i] <= 0.0:
                mode[k] = 0.0
        return mode

    def _in_one_mode(self, run, x, t, stop, inputs, du, mode, length, inside, result):
        """Time, states and passed surfaces at the end of a mode; None for the surfaces at the end of the span."""

        def rate(t, x):
            run.evaluations += 1
            return self.motion(x, inputs(t), du, mode)[0]

        def surfaces(t, x):
            return self.motion(x, inputs(t), du, mode)[2]

        if stop - t <= 1e-14 * (abs(stop) + length):
            return stop, x, None
        first, f = surfaces(t, x), rate(t, x)
        ahead = AHEAD * min(length, stop - t)
        travel = (surfaces(t + ahead, x + ahead * f) - first) / ahead * length
        at = np.abs(first) <= NEAR * np.abs(travel)
        side = np.where(at, np.sign(travel), np.sign(first))
        # what is at its surface and on its way through has passed it
        solver = scipy.integrate.DOP853(rate, t, x, stop, rtol=run.rtol, atol=run.atol)
        for _ in range(20_000):
            before, y = solver.t, solver.y
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                solver.step()
            if solver.status == "failed" or not np.all(np.isfinite(solver.y)) or run.evaluations > run.most:
                raise run.failed(before, y)
            dense, low = solver.dense_output(), before
            for high in before + (solver.t - before) * np.arange(1, LOOKS + 1) / LOOKS:
                high = min(float(high), solver.t)
                value = surfaces(high, dense(high))
                if high == stop:  # an end as near to a surface passes it
                    value = np.where((np.abs(value) <= NEAR * np.abs(travel)) & (np.sign(value) == side), 0.0, value)
                passed = self._passed(side, value)
                if np.any(passed):
                    for _ in range(HALVINGS):
                        middle = 0.5 * (low + high)
                        found = self._passed(side, surfaces(middle, dense(middle)))
                        low, high, passed = (low, middle, found) if np.any(found) else (middle, high, passed)
                    self._keep(inside, result, before, high, dense, mode, inputs, du)
                    x = self.motion(dense(high), inputs(high), du, mode)[1]
                    return high, x, passed
                side, low = np.where(value != 0.0, np.sign(value), side), high
            self._keep(inside, result, before, solver.t, dense, mode, inputs, du)
            if solver.status == "finished":
                return stop, self.motion(solver.y, inputs(stop), du, mode)[1], None
        raise run.failed(solver.t, solver.y)

    def _passed(self, side: np.ndarray, value: np.ndarray) -> np.ndarray:
        """Which surfaces were passed, those of events in their direction and others from above."""
        falling, rising = (side > 0) & (value <= 0.0), (side < 0) & (value >= 0.0)
        own = np.ones(len(value), dtype=int)
        own[: len(self.signs)] = self.signs
        return np.where(own > 0, falling, np.where(own < 0, rising, falling | rising))

    def _keep(self, inside, result, begin, end, dense, mode, inputs, du) -> None:
        for j in np.flatnonzero((inside > begin) & (inside <= end)):
            s = float(inside[j])
            result[:, j] = self.motion(dense(s), inputs(s), du, mode)[1]

    def _changed(self, x, u, du, mode, passed, length):
        """The mode and the states behind the surfaces that were passed."""
        mode, x, events = mode.copy(), np.array(x), len(self.signs)
        count = len(self.velocities)
        for k in np.flatnonzero(passed[:events]):
            x = np.array(self.jump(int(k), x, u))
        if np.any(passed[:events]):
            return self._begin(x, u, du, length)
        for k, i in enumerate(self.velocities):
            if not passed[events + k]:
                continue
            need, limit = self.forces(x, u, mode)
            if mode[k] == 0.0:
                mode[k] = -np.sign(need[k])
            else:
                x[i] = 0.0
                need, limit = self.forces(x, u, mode)
                mode[k] = 0.0 if abs(need[k]) <= limit[k] else -np.sign(need[k])
        for k in range(len(self.plays)):
            low, high = passed[events + count + 2 * k : events + count + 2 * k + 2]
            if low or high:
                mode[count + k] = 0.0 if mode[count + k] != 0.0 else 1.0 if low else -1.0
        return mode, x
