"""Pendubot experiments as designs: moves between upright poses, run in the rig's closed loop, with the information
that they give."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

import plantfit.runtime  # noqa: F401
from plantfit.models.library.double_pendulum import Motion, rigid_terms, torque_columns
from plantfit.rig import PendubotRig
from plantfit.rig.lqg import Lqg, scheduled_lqg
from plantfit.rig.pendubot import run_closed_loop, voltage_plant
from plantfit.rig.pendubot_reference import UPRIGHT, FlatOutput
from plantfit.rig.trajectories import Move
from plantfit.simulate.steps.vector import VectorModel

import jax.numpy as jnp

NAMES = ("b1", "b2", "b4", "b5")
SMOOTHNESS = 7  # zero derivatives at both ends of a move, as in rig.pendubot_reference
NODES = 25  # designs of the controller over theta1


@dataclass(frozen=True)
class Limits:
    """What the bench allows: theta1 from .. to (rad), lean of link 2 from the vertical (rad), rate of joint 1
    (rad/s); the voltage is the rig's."""

    theta1: tuple[float, float] = (np.pi / 6, 5 * np.pi / 6)
    lean: float = 0.5
    rate: float = 10.0


@dataclass(frozen=True, eq=False)
class UprightMoves:
    """`moves` of theta1 between poses with link 2 upright in the time of `rig`, rest to rest, with joint 2 free.

    A design holds the poses (rad), the times that the moves take (s, at least `fastest`), and `moves` + 1 weights that
    share out the time of rest. The motion is that of the rig's closed loop with perfect sensors at the rig's
    parameters; the information is about b1, b2, b4, b5 from the torque of joint 1 with the white noise of the recorded
    voltage.
    """

    rig: PendubotRig
    moves: int = 6
    limits: Limits = field(default_factory=Limits)
    fastest: float = 0.5

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (3 moves + 1,) of a design; the longest moves leave a tenth of the time for rest."""
        k, longest = self.moves, 0.9 * self.rig.duration / self.moves
        low, high = self.limits.theta1
        return np.r_[[low] * k, [self.fastest] * k, [0.02] * (k + 1)], np.r_[[high] * k, [longest] * k, [1.0] * (k + 1)]

    def poses(self, design: Any) -> tuple[Move, ...]:
        """The moves of a design, for `PendubotRig(poses=...)`."""
        starts, lasts, to = (np.asarray(v) for v in self._times(jnp.asarray(design)))
        return tuple(Move(float(a), float(b), float(c)) for a, b, c in zip(starts, lasts, to, strict=True))

    def design(self, poses: tuple[Move, ...]) -> np.ndarray:
        """The design of given moves, as many as `moves`."""
        ends = [0.0, *(m.end for m in poses)]
        rests = np.array(
            [start - end for start, end in zip([*(m.start for m in poses), self.rig.duration], ends, strict=True)]
        )
        return np.r_[[m.to for m in poses], [m.duration for m in poses], rests / rests.max()]

    def _times(self, design: Any) -> tuple[Any, Any, Any]:
        k = self.moves
        to, lasts, shares = design[:k], design[k : 2 * k], design[2 * k :]
        rests = shares / jnp.sum(shares) * (self.rig.duration - jnp.sum(lasts))
        return jnp.cumsum(rests[:k]) + jnp.cumsum(lasts) - lasts, lasts, to

    def reference(self, design: Any) -> tuple[Any, Any]:
        """States (N, 4) and torque (N,) of the flat-output reference, `rig.pendubot_reference.upright_reference` but
        traceable."""
        base, l1, g = self.rig.base, self.rig.l1, self.rig.g
        flat = FlatOutput.of(base, l1, g)
        starts, lasts, to = self._times(design)
        theta1, theta2 = flat.motion(_rest_to_rest(self.rig.t, starts, lasts, (to - UPRIGHT) / flat.factor))
        x = Motion(theta1[0], theta2[0], theta1[1], theta2[1])
        columns = torque_columns(rigid_terms(x, l1, g), theta1[2], theta2[2])[0]
        return jnp.stack(x, axis=1), sum(base[n] * c for n, c in zip(NAMES, columns, strict=True))

    def motion(self, design: Any) -> tuple[Any, Any]:
        """States (N, 4) and voltage (N,) in closed loop; traceable."""
        rig, (plant, numbers) = self.rig, self._plant
        states, torque = self.reference(design)
        feedforward = rig.voltage(torque, states[:, 2])
        along, tables = self._controller
        share = jnp.clip((states[:, 0] - along[0]) / (along[1] - along[0]), 0.0, NODES - 1.001)
        at = share.astype(int)
        rows = (states, feedforward, at, share - at)
        start = tuple(states[0, i] for i in range(4))
        loop = (rig.period, rig.substeps, rig.limit)
        *x, voltage, _, _ = run_closed_loop(plant, loop, numbers, start, rows, 0.0, (0.0, 0.0), tables)
        return jnp.stack(x, axis=1), voltage

    def outcome(self, design: Any) -> tuple[Any, Any]:
        """Information (4, 4) of a design, and by how much each limit is broken (see `told`, `broken`); traceable."""
        states, voltage = self.motion(design)
        return self.told(states, voltage), self.broken(states, voltage)

    def told(self, states: Any, voltage: Any) -> Any:
        """Information (4, 4) about b1, b2, b4, b5 of a motion: states (N, 4), voltage (N,)."""
        rig, (plant, numbers) = self.rig, self._plant
        _, _, alpha1, alpha2 = plant.rate(tuple(states[:, i] for i in range(4)), (voltage, 0.0), numbers)
        columns = torque_columns(rigid_terms(Motion(*(states[:, i] for i in range(4))), rig.l1, rig.g), alpha1, alpha2)[
            0
        ]
        noise = max(rig.voltage_noise, 1e-6) * rig.parameters["kt"] / rig.parameters["Ra"]
        matrix = jnp.stack([jnp.broadcast_to(c, voltage.shape) for c in columns], axis=1) / noise
        return matrix.T @ matrix

    def broken(self, states: Any, voltage: Any) -> Any:
        """By how much each limit is broken (5,), negative inside: share of the time at the amplifier's limit, theta1
        and lean in rad, rate as a share of what is allowed."""
        limits, (low, high) = self.limits, self.limits.theta1
        return jnp.stack([
            jnp.mean(jnp.abs(voltage) >= 0.999 * self.rig.limit),
            low - jnp.min(states[:, 0]),
            jnp.max(states[:, 0]) - high,
            jnp.max(jnp.abs(states[:, 0] + states[:, 1] - UPRIGHT)) - limits.lean,
            jnp.max(jnp.abs(states[:, 2])) / limits.rate - 1.0,
        ])  # fmt: skip

    @cached_property
    def _plant(self) -> tuple[VectorModel, tuple[float, ...]]:
        rig = self.rig
        plant = voltage_plant("base", tuple(rig.friction), rig.l1, rig.g)
        return plant, tuple(float({**rig.parameters, **rig.base}[n]) for n in plant.parameters)

    @cached_property
    def _controller(self) -> tuple[np.ndarray, Lqg]:
        """Values of theta1 (NODES,) and the rig's LQG design at each."""
        along = np.linspace(self.limits.theta1[0] - 0.3, self.limits.theta1[1] + 0.3, NODES)
        return along, scheduled_lqg(
            self.rig.linearised, along, self.rig.period, self.rig.weights, measured=2, nodes=NODES
        )


def _rest_to_rest(t: np.ndarray, starts: Any, lasts: Any, to: Any) -> list[Any]:
    """Value and four derivatives (N,) of the trajectory `rig.trajectories.RestToRest` from rest at 0; traceable."""
    r = SMOOTHNESS
    slope = Polynomial([0.0, 1.0]) ** r * Polynomial([1.0, -1.0]) ** r
    shape = slope.integ() / slope.integ()(1.0)
    before = jnp.concatenate([jnp.zeros(1), to[:-1]])
    move = jnp.clip(jnp.searchsorted(starts, t, side="right") - 1, 0)
    x = jnp.clip((t - starts[move]) / lasts[move], 0.0, 1.0)
    steps, lasting = (to - before)[move], lasts[move]
    parts = [
        steps * jnp.polyval(jnp.asarray((shape.deriv(k) if k else shape).coef[::-1]), x) / lasting**k for k in range(5)
    ]
    return [parts[0] + before[move], *parts[1:]]
