"""From four numbers to an LQ servo for one identified plant: its sampled matrices with dead time, both Riccati equations, its set point."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.doubling import doubled
from plantfit.control.linear.kalman import sampled_noise
from plantfit.control.linear.servo import Servo
from plantfit.control.tune.frequency import input_matrices
from plantfit.control.tune.one_loop import Rest
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError

import jax.numpy as jnp

MOST_PAST = 300  # inputs on their way through dead time


@dataclass(frozen=True, eq=False)
class ServoPlant:
    """One plant at rest as `linear.servo` takes it: A (n, n), B (n, p + 1), C (n,), D (), u0, y0, and what its weights are counted in.

    `noise` (n, n) is the covariance that a wander of the input by `u_size` in `slow` seconds adds in a period; `target` (n + 1,) states and
    input at rest where the output is 1 higher; the first `ahead` of the past inputs have not yet reached any state.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: float
    u0: float
    y0: float
    period: float
    step: float
    u_size: float
    noise: np.ndarray
    target: np.ndarray
    ahead: int

    @classmethod
    def of(cls, rest: Rest, small: Reduced, wishes: Wishes, at: int = 0) -> "ServoPlant":
        """Plant number `at`; raises SimulationError for a dead time of too many samples, and for what no servo can hold."""
        period, n = wishes.period, rest.A.shape[-1]
        one = Rest(*(getattr(rest, name)[at : at + 1] for name in ("x", "u", "A", "B", "C", "D", "late")))
        a, b = input_matrices(one, period)
        if len(b) - 1 > MOST_PAST:
            raise SimulationError(
                f"The dead time is {len(b) - 1} samples of {period:g} s, and LQI keeps as many past inputs; give a longer period "
                f"([control] period, or --period), such as {period * len(b) / 50:.2g} s."
            )
        d = float(rest.D[at])
        if d and len(b) < 2:
            b = np.concatenate([b, np.zeros((1, n))])
        b, c = b.T, rest.C[at]
        moved = np.flatnonzero(np.any(b != 0, axis=0))
        ahead = 0 if d else int(moved[0])
        whole = np.block([[a - np.eye(n), b.sum(axis=1)[:, None]], [c[None, :], np.array([[d]])]])
        if np.linalg.matrix_rank(whole) < n + 1:
            raise SimulationError(
                "No input holds the output at another level: LQI needs a plant whose states the output and the input fix."
            )
        k, slow = small.first_order[0], slowest(small)
        u_size = abs(wishes.step / (k * slow if small.integrating else k))
        drive = rest.B[at].sum(axis=0) * u_size / np.sqrt(slow)
        noise = sampled_noise(rest.A[at], np.outer(drive, drive), period)
        target = np.linalg.solve(whole, np.r_[np.zeros(n), 1.0])
        return cls(a, b, c, d, float(rest.u[at]), wishes.set_point, period, abs(wishes.step), u_size, noise, target, ahead)

    def servo(self, rho: Any, ti: Any, wander: Any, b: Any) -> Servo:
        """The servo of least sum of (y/step)^2 + (integral of y/(step ti))^2 + rho (u/u_size)^2, with the filter for an input that wanders
        and for a measurement noise of a step; jax-traceable. The set point enters with weight `b`: 1 asks at once for the input and
        states that rest there, 0 leaves it to the integral.

        The inputs that are still ahead of the plant cannot be changed: the gain is that of the plant without this dead time, on the state
        that they lead to. Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., sections 11.2 - 11.4.
        """
        n, size = len(self.A), self.B.shape[1]
        late = size - 1 - self.ahead  # past inputs, after those ahead, that are states of the plant without dead time
        moves, drive = np.zeros((n + late + 1,) * 2), np.zeros((n + late + 1, 1))
        moves[:n, :n], drive[:n, 0] = self.A, self.B[:, self.ahead]
        moves[:n, n : n + late] = self.B[:, self.ahead + 1 :]
        if late:
            drive[n, 0] = 1.0
            moves[n + 1 : n + late, n : n + late - 1] = np.eye(late - 1)
        seen = np.r_[self.C, [self.D] * bool(late), np.zeros(max(late - 1, 0)), 0.0]
        moves[-1, -1] = 1.0
        moves[-1] -= self.period * seen
        last = np.eye(n + late + 1)[-1]
        q = (jnp.outer(seen, seen) + jnp.outer(last, last) / ti**2) / self.step**2
        k = doubled(jnp.asarray(moves), jnp.asarray(drive), q, jnp.reshape(rho / self.u_size**2, (1, 1)))[0][0]
        # the state after the inputs ahead: powers of `moves`, known beforehand
        powers = [np.eye(n + late + 1)]
        for _ in range(self.ahead):
            powers.append(powers[-1] @ moves)
        now = k @ powers[-1]
        ahead = jnp.stack([k @ (p @ drive[:, 0]) for p in powers[:-1]]) if self.ahead else jnp.zeros(0)
        states, past = now[:n], jnp.concatenate([ahead, now[n : n + late]])
        gain = doubled(jnp.asarray(self.A.T), jnp.asarray(self.C[:, None]), jnp.asarray(self.noise) * wander**2,
                       jnp.reshape(self.step**2, (1, 1)))[1]  # fmt: skip
        gain = gain @ self.C / (self.C @ gain @ self.C + self.step**2)
        f = b * (states @ self.target[:n] + (1.0 + jnp.sum(past)) * self.target[n])
        fixed = (jnp.asarray(v) for v in (self.A, self.B, self.C, self.D))
        return Servo(*fixed, gain, states, past, -now[-1], f, jnp.asarray(self.u0), jnp.asarray(self.y0))
