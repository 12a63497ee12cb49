"""From the weights of an LQ servo to a predictive one: how far it looks ahead, its moves, and the program of every
sample."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.predictive.quadratic import prepared
from plantfit.control.linear.predictive.servo_mpc import Plan, Predictive, growing
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError

import jax.numpy as jnp
from jax import lax

MOVES = 16  # inputs that are planned
MOST_AHEAD = 400  # samples of the plan
SOFTNESS = 1e3  # a violation of the output's limits, over an error of the set point: squares


def look_ahead(plant_dead: float, small: Reduced) -> float:
    """Seconds that a plan is proposed to look ahead: its dead time, and then as long as the plant takes (lag and
    dead time)."""
    return plant_dead + slowest(small)


@dataclass(frozen=True, eq=False)
class PlanShape:
    """Moves of a plan: `lengths` (k,) in samples, from the first input that is not on its way yet; `rated` and
    `watched` say whether the rate of the input and the output have limits."""

    plant: ServoPlant
    lengths: np.ndarray
    low: tuple[float, float, float]  # deviations of input, change of input and output
    high: tuple[float, float, float]
    rated: bool
    watched: bool

    @classmethod
    def of(cls, plant: ServoPlant, small: Reduced, wishes: Wishes) -> "PlanShape":
        """As `wishes` say, or as proposed; raises SimulationError for a plan that ends before an input acts."""
        dead = plant.ahead * plant.period
        seconds = look_ahead(dead, small) if wishes.prediction is None else wishes.prediction
        samples = round(seconds / plant.period) - plant.ahead
        if samples < 2:
            raise SimulationError(
                f"The plan looks {seconds:.4g} s ahead and an input acts after {dead:.4g} s of dead time, so that "
                f"it sees nothing of what it does; give a prediction of at least {dead + 2 * plant.period:.4g} s "
                f"([control] prediction, or --prediction), such as {look_ahead(dead, small):.3g} s, or leave it out."
            )
        if samples > MOST_AHEAD and wishes.prediction is not None:
            raise SimulationError(
                f"A prediction of {seconds:.4g} s is {samples} samples of {plant.period:g} s after the "
                f"dead time; give at most {MOST_AHEAD * plant.period + dead:.4g} s, or a longer period."
            )
        change = wishes.rate * plant.period
        low = wishes.lower - plant.u0, -change, wishes.output_lower - plant.y0
        high = wishes.upper - plant.u0, change, wishes.output_upper - plant.y0
        watched = bool(np.isfinite(low[2]) or np.isfinite(high[2]))
        return cls(plant, growing(min(samples, MOST_AHEAD), MOVES), low, high, bool(np.isfinite(change)), watched)

    @property
    def seconds(self) -> float:
        """How far the plan looks ahead, dead time and all."""
        return float(self.plant.period * (self.plant.ahead + np.sum(self.lengths)))

    def predictive(self, rho: Any, wander: Any, shake: Any, seconds: Any) -> Predictive:
        """The servo of these weights (`ServoPlant.servo`) with its plan; jax-traceable.

        Least cost of the servo within the limits, inputs u = u of the servo + v, v constant over each move: after the
        last move the servo goes on without limits. Inputs and their changes are hard at the begin of each move, outputs
        soft at the end of each.
        """
        plant, lengths = self.plant, self.lengths
        servo, ahead = plant.servo(rho, wander, shake, seconds), plant.advanced
        k, cost = plant.regulator(rho)
        total, size = int(np.sum(lengths)), len(ahead.moves)
        closed = jnp.asarray(ahead.moves) - jnp.asarray(ahead.drive) @ k[None, :]
        # u at sample j = -k closed^j z + sum of v_i by[j - i],  y after it = seen closed^(j + 1) z + sum of v_i out[j -
        # i]
        _, powers = lax.scan(lambda at, _: (closed @ at, at), jnp.eye(size), None, length=total + 1)
        u_free, y_free = -k @ powers[:-1], ahead.seen @ powers[1:]
        by = jnp.concatenate([jnp.ones(1), u_free[:-1] @ ahead.drive[:, 0]])
        out = (ahead.seen @ powers[:-1]) @ ahead.drive[:, 0]
        starts, ends = np.r_[0, np.cumsum(lengths)[:-1]], np.cumsum(lengths) - 1
        held = np.repeat(np.eye(len(lengths)), lengths, axis=0)  # (samples, moves)

        def answered(shape: Any, rows: np.ndarray) -> Any:
            lag = rows[:, None] - np.arange(total)[None, :]
            return jnp.where(lag >= 0, shape[np.maximum(lag, 0)], 0.0) @ held

        def with_rest(rows: Any, input_: float, output: float) -> Any:
            return jnp.concatenate([rows, jnp.full((len(rows), 1), input_), jnp.full((len(rows), 1), output)], axis=1)

        free, moved, count = [with_rest(u_free[starts], 1.0, 0.0)], [answered(by, starts)], len(lengths)
        low, high, weights = [np.full(count, self.low[0])], [np.full(count, self.high[0])], [np.full(count, np.inf)]
        if self.rated:
            first = with_rest(u_free[:1], 1.0, 0.0)
            free.append(jnp.concatenate([first, with_rest(u_free[starts[1:]] - u_free[starts[1:] - 1], 0.0, 0.0)]))
            moved.append(
                jnp.concatenate([answered(by, starts[:1]), answered(by, starts[1:]) - answered(by, starts[1:] - 1)])
            )
            low.append(np.full(count, self.low[1]))
            high.append(np.full(count, self.high[1]))
            weights.append(np.full(count, np.inf))
        if self.watched:
            free.append(with_rest(y_free[ends], 0.0, 1.0))
            moved.append(answered(out, ends))
            low.append(np.full(count, self.low[2]))
            high.append(np.full(count, self.high[2]))
            weights.append(np.full(count, SOFTNESS / plant.step**2))
        weight = rho / plant.u_size**2 + ahead.drive[:, 0] @ cost @ ahead.drive[:, 0]
        task = prepared(
            jnp.diag(jnp.asarray(lengths, dtype=float)) * weight, jnp.concatenate(moved), np.concatenate(weights)
        )
        x, q, g = self._from_state()
        least, most = (jnp.asarray(np.concatenate(v)) for v in (low, high))
        plan = Plan(x, q, g, jnp.concatenate(free), task, least, most, jnp.asarray(self.high[1]))
        return Predictive(servo, plan)

    def _from_state(self) -> tuple[Any, Any, Any]:
        """X, Q, g of `Plan`: the states when the inputs on their way have arrived, the load as good as an input that
        never changes."""
        plant, ahead = self.plant, self.plant.advanced
        n, size = len(plant.A), len(ahead.moves)
        past = np.concatenate([ahead.ways, ahead.later[:, n:]], axis=1)
        x = np.zeros((size + 2, n + 1))
        x[:size, :n], x[:size, n], x[size, n] = ahead.later[:, :n], past.sum(axis=1), -1.0
        g = np.r_[-np.r_[plant.target[:n], np.full(size - n, plant.target[n])], plant.target[n], 1.0]
        return jnp.asarray(x), jnp.asarray(np.concatenate([past, np.zeros((2, past.shape[1]))])), jnp.asarray(g)
