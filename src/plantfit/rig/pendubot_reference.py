"""The pendubot's reference motion: from pose to pose with link 2 upright, by the flat output of the linearised
plant."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from plantfit.models.library.pendubot import pendubot_regression
from plantfit.rig.trajectories import Move, RestToRest

UPRIGHT = np.pi / 2  # theta1 + theta2 with link 2 on end


class Reference(NamedTuple):
    """Per sample: `states` (N, 4) theta1, theta2, omega1, omega2 (rad, rad/s), the torque at joint 1 (N,) (N m),
    `accelerations` (N, 2)."""

    states: np.ndarray
    torque: np.ndarray
    accelerations: np.ndarray


class FlatOutput(NamedTuple):
    """y = ((b2 + b3)/b2) d1 + d2 of deviations d1, d2 from the upright.

    There the equation of joint 2 is (b2 + b3) d1'' + b2 d2'' = b5 g (d1 + d2) with b3 = l1 b5, so that d1 + d2 = w y''
    and d1 = factor (y - w y''), factor = b2/b3 and w = b2 / (b5 g).
    """

    factor: float
    w: float

    @classmethod
    def of(cls, base: Mapping[str, float], l1: float, g: float) -> "FlatOutput":
        return cls(base["b2"] / (l1 * base["b5"]), base["b2"] / (base["b5"] * g))

    def motion(self, y: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """theta1 and theta2 (rad), each with its first two derivatives, from y and its first four; arrays of any
        library."""
        d1 = [self.factor * (y[k] - self.w * y[k + 2]) for k in range(3)]
        d2 = [self.w * y[k + 2] - d1[k] for k in range(3)]
        return [d1[0] + UPRIGHT, *d1[1:]], d2


def upright_reference(
    t: np.ndarray, base: Mapping[str, float], poses: tuple[Move, ...], l1: float, g: float, smoothness: int = 7
) -> Reference:
    """Rest to rest in theta1 from the upright over `poses` (s, s, rad), theta1 + theta2 = pi/2 at rest, by
    `FlatOutput`.

    Away from the upright the motion is not exact, and feedback makes up for it. The torque is that of the full
    equations along it.
    """
    flat = FlatOutput.of(base, l1, g)
    moves = tuple(Move(m.start, m.duration, (m.to - UPRIGHT) / flat.factor) for m in poses)
    theta1, theta2 = flat.motion([RestToRest(0.0, moves, smoothness)(t, k) for k in range(5)])
    signals = {
        f"{n}{j}": q[k] for k, n in enumerate(("theta", "omega", "alpha")) for j, q in ((1, theta1), (2, theta2))
    }
    torque = pendubot_regression("base", l1=l1, g=g).predict(signals, base)
    states = np.stack([signals[n] for n in ("theta1", "theta2", "omega1", "omega2")], axis=1)
    return Reference(states, torque, np.stack([signals["alpha1"], signals["alpha2"]], axis=1))
