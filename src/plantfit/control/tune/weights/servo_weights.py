"""From four numbers to an LQ servo for one identified plant: sampled matrices with dead time, both Riccati
equations, the set point."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

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


class Advanced(NamedTuple):
    """x+ = moves x + drive u, y = seen x: states of the plant, then inputs that act late on some of its ways. The
    state after the inputs ahead is later x + ways (u[k-1], .., u[k-ahead]); x there as the plant had it without dead
    time."""

    moves: np.ndarray
    drive: np.ndarray
    seen: np.ndarray
    later: np.ndarray
    ways: np.ndarray


@dataclass(frozen=True, eq=False)
class ServoPlant:
    """One plant at rest as `linear.servo` takes it: A (n, n), B (n, p + 1), C (n,), D (), u0, y0, and what its weights
    are counted in.

    `wander` and `shake` (n + 1, n + 1) are covariances, of states and load, that a load which wanders by `u_size` in
    `slow` seconds and a white noise on the input of that size add in a period; `target` (n + 1,) states and input at
    rest where the output is 1 higher; the first `ahead` of the past inputs have not yet reached any state.
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
    slow: float
    wander: np.ndarray
    shake: np.ndarray
    target: np.ndarray
    ahead: int

    @classmethod
    def of(cls, rest: Rest, small: Reduced, wishes: Wishes, at: int = 0) -> "ServoPlant":
        """Plant number `at`; raises SimulationError for a dead time of too many samples, and for what no servo can
        hold."""
        period, n = wishes.period, rest.A.shape[-1]
        one = Rest(*(getattr(rest, name)[at : at + 1] for name in ("x", "u", "A", "B", "C", "D", "late")))
        a, b = input_matrices(one, period)
        if len(b) - 1 > MOST_PAST:
            raise SimulationError(
                f"The dead time is {len(b) - 1} samples of {period:g} s, and LQI keeps as many past inputs; "
                f"give a longer period ([control] period, or --period), such as {period * len(b) / 50:.2g} s."
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
                "No input holds the output at another level: LQI needs "
                "a plant whose states the output and the input fix."
            )
        k, slow = small.first_order[0], slowest(small)
        u_size = abs(wishes.step / (k * slow if small.integrating else k))
        moves, size = np.zeros((n + 1, n + 1)), u_size / np.sqrt(slow)
        moves[:n, :n], moves[:n, n] = rest.A[at], rest.B[at].sum(axis=0)
        sources = np.r_[np.zeros(n), size], np.r_[moves[:n, n] * u_size * np.sqrt(slow), 0.0]
        wander, shake = (sampled_noise(moves, np.outer(v, v), period) for v in sources)
        target = np.linalg.solve(whole, np.r_[np.zeros(n), 1.0])
        u0, y0, step = float(rest.u[at]), wishes.set_point, abs(wishes.step)
        return cls(a, b, c, d, u0, y0, period, step, u_size, slow, wander, shake, target, ahead)

    @cached_property
    def advanced(self) -> Advanced:
        """The plant without the dead time that all inputs share."""
        n, size = len(self.A), self.B.shape[1]
        late = size - 1 - self.ahead  # past inputs, after those ahead, that are states of the plant without dead time
        moves, drive = np.zeros((n + late,) * 2), np.zeros((n + late, 1))
        moves[:n, :n], drive[:n, 0] = self.A, self.B[:, self.ahead]
        moves[:n, n:] = self.B[:, self.ahead + 1 :]
        if late:
            drive[n, 0] = 1.0
            moves[n + 1 :, n:-1] = np.eye(late - 1)
        seen = np.r_[self.C, [self.D] * bool(late), np.zeros(max(late - 1, 0))]
        later, ways = np.eye(n + late), np.zeros((n + late, self.ahead))
        for j in range(self.ahead):
            ways[:, j] = later @ drive[:, 0]
            later = later @ moves
        return Advanced(moves, drive, seen, later, ways)

    def regulator(self, rho: Any) -> tuple[Any, Any]:
        """Gain (m,) and cost-to-go (m, m) on the states of `advanced`, of least sum of (y/step)^2 + rho
        (u/u_size)^2; jax-traceable."""
        ahead = self.advanced
        q, r = jnp.asarray(np.outer(ahead.seen, ahead.seen)) / self.step**2, jnp.reshape(rho / self.u_size**2, (1, 1))
        gain, cost = doubled(jnp.asarray(ahead.moves), jnp.asarray(ahead.drive), q, r)
        return gain[0], cost

    def servo(self, rho: Any, wander: Any, shake: Any, seconds: Any) -> Servo:
        """The servo of least sum of (y/step)^2 + rho (u/u_size)^2, with the filter for a load that wanders and an input
        that is shaken by these multiples of `u_size`, and a measurement noise of a step; the set point is followed
        within `seconds`. jax-traceable.

        The inputs that are still ahead of the plant cannot be changed: the gain is that of the plant without this dead
        time, on the state that they lead to. Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., sections
        11.2 - 11.4.
        """
        n, size, ahead = len(self.A), self.B.shape[1], self.advanced
        k = self.regulator(rho)[0]
        now = k @ ahead.later
        past = jnp.concatenate([k @ ahead.ways, now[n:]])
        states = jnp.append(now[:n], 1.0 + jnp.sum(past))  # the load is as good as an input that never changes
        a, b = np.zeros((n + 1, n + 1)), np.zeros((n + 1, size))
        a[:n, :n], a[:n, n], a[n, n], b[:n] = self.A, self.B.sum(axis=1), 1.0, self.B
        c, noise = np.append(self.C, self.D), self.wander * wander**2 + self.shake * shake**2
        spread = doubled(jnp.asarray(a.T), jnp.asarray(c[:, None]), noise, jnp.full((1, 1), self.step**2))[1]
        gain = spread @ c / (c @ spread @ c + self.step**2)
        f = now[:n] @ self.target[:n] + (1.0 + jnp.sum(past)) * self.target[n]
        plant = [jnp.asarray(v) for v in (a, b, c, self.D)]
        share = self.period / (self.period + seconds)
        rest = [jnp.asarray(v) for v in (self.target, self.u0, self.y0)]
        return Servo._make([*plant, gain, states, past, f, share, *rest])
