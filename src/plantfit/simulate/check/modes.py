"""Events, dry friction and backlash followed mode by mode with scipy's DOP853, for the check of simulations.

In a mode every velocity with friction slides one way or sticks, and every state with play is pushed by one flank or
rests. Surfaces end a mode: conditions of events, velocities that meet zero, the breakaway force, flanks that touch or
turn back.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from plantfit.simulate.check.mode_equations import ModeEquations, Values, mode_equations
from plantfit.simulate.steps.vector import VectorModel

LOOKS = 8  # at the surfaces in every step of the solver
HALVINGS = 60
NEAR = 1e-9  # of a span's travel: a start as near to a surface is on it
AHEAD = 1e-6  # of a span: where the way off a surface is looked at
TOUCH = 1e-13  # of where a flank stands
CHANGES = 200  # of the mode in one span


@dataclass(frozen=True, eq=False)
class Modes:
    """The motion of a model with parameters `p`. A mode is a vector: per friction 1, -1 or 0 (sticks), per play 1,
    -1 or 0 (rests)."""

    equations: ModeEquations
    p: Values

    @classmethod
    def of(cls, vector: VectorModel, p: Sequence[Any]) -> "Modes":
        return cls(mode_equations(vector), Values.of(p))

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
        return self.equations.jumps[k](
            x, u, np.zeros(len(u)), np.zeros(len(self.velocities) + len(self.plays)), self.p
        )[0]

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

        resting, slack = self._resting(x, inputs(t), mode)

        def surfaces(t, x):
            found = np.array(self.motion(x, inputs(t), du, mode)[2])
            found[resting] += slack
            return found

        if stop - t <= 1e-14 * (abs(stop) + length):
            return stop, x, None
        first, f = surfaces(t, x), rate(t, x)
        ahead = AHEAD * min(length, stop - t)
        travel = (surfaces(t + ahead, x + ahead * f) - first) / ahead * length
        at = np.abs(first) <= NEAR * np.abs(travel)
        side = np.where(at, np.sign(travel), np.sign(first))
        side[resting] = 1.0
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

    def _resting(self, x: np.ndarray, u: np.ndarray, mode: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which surfaces are flanks that touch what rests, and by how much they pass it before they push.

        What begins at a flank that stands still is on neither side of it, but whatever moves next may push.
        """
        first, resting, slack = len(self.signs) + len(self.velocities), [], []
        if self.plays:
            for k, (low, high) in enumerate(self.flanks(x, u)):
                if mode[len(self.velocities) + k] == 0.0:
                    resting += [first + 2 * k, first + 2 * k + 1]
                    slack += 2 * [TOUCH * (abs(low) + abs(high))]
        return np.array(resting, dtype=int), np.array(slack)

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
