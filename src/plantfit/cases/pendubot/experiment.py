"""Pendubot experiments as designs: moves between upright poses, simulated in closed loop, with the information that they give."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

import plantfit.runtime  # noqa: F401
from plantfit.models.double_pendulum import Motion, accelerations, rigid_terms, torque_columns
from plantfit.models.pendubot import motor_torque
from plantfit.rig.lqg import Weights, scheduled_lqg
from plantfit.rig.trajectories import Move

import jax
import jax.numpy as jnp

NAMES = ("b1", "b2", "b4", "b5")
SMOOTHNESS = 7  # zero derivatives at both ends of a move, as in rig.pendubot_reference
UPRIGHT = np.pi / 2


@dataclass(frozen=True)
class Limits:
    """What the bench allows: voltage (V), theta1 from .. to (rad), lean of link 2 from the vertical (rad), rate of joint 1 (rad/s)."""

    voltage: float = 24.0
    theta1: tuple[float, float] = (np.pi / 6, 5 * np.pi / 6)
    lean: float = 0.5
    rate: float = 10.0


@dataclass(frozen=True, eq=False)
class UprightMoves:
    """`moves` of theta1 between poses with link 2 upright in `duration` (s), rest to rest, with joint 2 free.

    A design holds the `moves` poses (rad), the times that the moves take (s), and `moves` + 1 weights that share out the time of
    rest. The plant with coefficients `base` (b1, b2, b4, b5) follows the flat-output reference of `rig.pendubot_reference` by
    scheduled state feedback, with samples of `period` (s). `torque_noise` (N m) at `rate_hz` samples a second scales the information.
    """

    base: Mapping[str, float]
    motor: Mapping[str, float]
    moves: int = 4
    duration: float = 25.0
    limits: Limits = field(default_factory=Limits)
    weights: Weights = Weights((0.05, 0.05, 0.0, 0.0), 4.0, 1.0, 2e-4)  # noqa: RUF009  (immutable)
    period: float = 5e-3
    fastest: float = 0.5
    torque_noise: float = 1.2e-4
    rate_hz: float = 1000.0
    l1: float = 0.15
    g: float = 9.81

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (3 moves + 1,) of a design; the longest moves leave a tenth of the time for rest."""
        k, longest = self.moves, 0.9 * self.duration / self.moves
        low, high = self.limits.theta1
        return np.r_[[low] * k, [self.fastest] * k, [0.02] * (k + 1)], np.r_[[high] * k, [longest] * k, [1.0] * (k + 1)]

    def poses(self, design: Any) -> tuple[Move, ...]:
        """The moves of a design, for `PendubotRig(poses=...)`."""
        starts, lasts, to = (np.asarray(v) for v in self._times(jnp.asarray(design)))
        return tuple(Move(float(a), float(b), float(c)) for a, b, c in zip(starts, lasts, to, strict=True))

    def design(self, poses: tuple[Move, ...]) -> np.ndarray:
        """The design of given moves, as many as `moves`."""
        ends = [0.0, *(m.end for m in poses)]
        rests = np.array([start - end for start, end in zip([*(m.start for m in poses), self.duration], ends, strict=True)])
        return np.r_[[m.to for m in poses], [m.duration for m in poses], rests / rests.max()]

    def _times(self, design: Any) -> tuple[Any, Any, Any]:
        k = self.moves
        to, lasts, shares = design[:k], design[k : 2 * k], design[2 * k :]
        rests = shares / jnp.sum(shares) * (self.duration - jnp.sum(lasts))
        return jnp.cumsum(rests[:k]) + jnp.cumsum(lasts) - lasts, lasts, to

    # -- reference and controller -------------------------------------------------------------------

    def reference(self, design: Any) -> tuple[Any, Any]:
        """States (N, 4) and torque (N,) of the flat-output reference (see `rig.pendubot_reference.upright_reference`); traceable."""
        b2, b5 = self.base["b2"], self.base["b5"]
        factor, w = b2 / (self.l1 * b5), b2 / (b5 * self.g)
        starts, lasts, to = self._times(design)
        y = _rest_to_rest(self.t, starts, lasts, (to - UPRIGHT) / factor)
        first = [factor * (y[k] - w * y[k + 2]) for k in range(3)]
        second = [w * y[k + 2] - d for k, d in enumerate(first)]
        x = Motion(first[0] + UPRIGHT, second[0], first[1], second[1])
        columns = torque_columns(rigid_terms(x, self.l1, self.g), first[2], second[2])[0]
        return jnp.stack(x, axis=1), sum(self.base[n] * c for n, c in zip(NAMES, columns, strict=True))

    @cached_property
    def t(self) -> np.ndarray:
        return np.arange(round(self.duration / self.period) + 1) * self.period

    @cached_property
    def gains(self) -> tuple[np.ndarray, np.ndarray]:
        """Values of theta1 (n,) and the feedback (n, 4) in V there."""
        along = np.linspace(self.limits.theta1[0] - 0.3, self.limits.theta1[1] + 0.3, 15)
        slopes = jax.jit(jax.jacfwd(lambda x: jnp.stack(self._rate(tuple(x[:4]), x[4]))))

        def linearised(theta1: float) -> tuple[np.ndarray, np.ndarray]:
            held = self.base["b4"] * self.g * np.cos(theta1) * self.motor["Ra"] / self.motor["kt"]
            with jax.ensure_compile_time_eval():  # the first call may come while a design is traced
                slope = np.asarray(slopes(np.array([theta1, UPRIGHT - theta1, 0.0, 0.0, held])))
            return slope[:, :4], slope[:, 4:]

        return along, scheduled_lqg(linearised, along, self.period, self.weights, measured=2, nodes=len(along)).gain

    def _rate(self, x: Any, voltage: Any) -> tuple[Any, ...]:
        torque = motor_torque(voltage, x[2], self.motor["kt"], self.motor["ke"], self.motor["Ra"])
        return (x[2], x[3], *accelerations(rigid_terms(Motion(*x), self.l1, self.g), self.base, torque, 0.0))

    # -- motion and what it tells ---------------------------------------------------------------------

    def motion(self, design: Any) -> tuple[Any, Any, Any]:
        """States (N, 4), accelerations (N, 2) and the voltage asked for (N,) in closed loop; traceable."""
        states, torque = self.reference(design)
        feedforward = self.motor["Ra"] / self.motor["kt"] * torque + self.motor["ke"] * states[:, 2]
        gain = jnp.stack([jnp.interp(states[:, 0], self.gains[0], g) for g in self.gains[1].T], axis=1)
        h = self.period

        def step(x: Any, row: Any) -> Any:
            target, ahead, k = row
            asked = ahead - sum(k[i] * (x[i] - target[i]) for i in range(4))
            u = jnp.clip(asked, -self.limits.voltage, self.limits.voltage)
            k1 = self._rate(x, u)
            k2 = self._rate(tuple(a + 0.5 * h * b for a, b in zip(x, k1, strict=True)), u)
            k3 = self._rate(tuple(a + 0.5 * h * b for a, b in zip(x, k2, strict=True)), u)
            k4 = self._rate(tuple(a + h * b for a, b in zip(x, k3, strict=True)), u)
            after = tuple(a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True))
            return after, (*x, k1[2], k1[3], asked)

        start = tuple(states[0, i] for i in range(4))
        *x, a1, a2, asked = jax.lax.scan(step, start, (states, feedforward, gain))[1]
        return jnp.stack(x, axis=1), jnp.stack([a1, a2], axis=1), asked

    def outcome(self, design: Any) -> tuple[Any, Any]:
        """Information (4, 4) about b1, b2, b4, b5 of the torque of joint 1 with white noise, and by how much each limit is broken."""
        states, alphas, asked = self.motion(design)
        return self.told(states, alphas) * self.period * self.rate_hz, self.broken(states, asked)

    def told(self, states: Any, alphas: Any) -> Any:
        """Information (4, 4) of a motion's samples (N, 4) with accelerations (N, 2)."""
        x = Motion(*(states[:, i] for i in range(4)))
        columns = torque_columns(rigid_terms(x, self.l1, self.g), alphas[:, 0], alphas[:, 1])[0]
        matrix = jnp.stack([jnp.broadcast_to(c, x.theta1.shape) for c in columns], axis=1) / self.torque_noise
        return matrix.T @ matrix

    def broken(self, states: Any, asked: Any) -> Any:
        """By how much each limit is broken (5,): voltage and rate as shares of what is allowed, angles in rad; negative inside."""
        limits, (low, high) = self.limits, self.limits.theta1
        return jnp.stack([
            jnp.max(jnp.abs(asked)) / limits.voltage - 1.0,
            low - jnp.min(states[:, 0]),
            jnp.max(states[:, 0]) - high,
            jnp.max(jnp.abs(states[:, 0] + states[:, 1] - UPRIGHT)) - limits.lean,
            jnp.max(jnp.abs(states[:, 2])) / limits.rate - 1.0,
        ])  # fmt: skip


def _rest_to_rest(t: np.ndarray, starts: Any, lasts: Any, to: Any) -> list[Any]:
    """Value and four derivatives (N,) of the trajectory `rig.trajectories.RestToRest` from rest at 0; traceable."""
    r = SMOOTHNESS
    slope = Polynomial([0.0, 1.0]) ** r * Polynomial([1.0, -1.0]) ** r
    shape = slope.integ() / slope.integ()(1.0)
    steps = to - jnp.concatenate([jnp.zeros(1), to[:-1]])
    x = jnp.clip((t[:, None] - starts) / lasts, 0.0, 1.0)
    return [jnp.sum(steps * jnp.polyval(jnp.asarray((shape.deriv(k) if k else shape).coef[::-1]), x) / lasts**k, axis=1) for k in range(5)]
