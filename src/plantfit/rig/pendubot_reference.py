"""The pendubot's reference motion: from pose to pose with link 2 upright, by the flat output of the linearised plant."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from plantfit.models.pendubot import pendubot_regression
from plantfit.rig.trajectories import Move, RestToRest


class Reference(NamedTuple):
    """Per sample: `states` (N, 4) theta1, theta2, omega1, omega2 (rad, rad/s) and the torque at joint 1 (N,) (N m)."""

    states: np.ndarray
    torque: np.ndarray


def upright_reference(
    t: np.ndarray, base: Mapping[str, float], poses: tuple[Move, ...], l1: float, g: float, smoothness: int = 7
) -> Reference:
    """Rest to rest in theta1 from the upright over `poses` (s, s, rad), theta1 + theta2 = pi/2 at rest.

    About the upright the equation of joint 2 is (b2 + b3) d1'' + b2 d2'' = b5 g (d1 + d2), so that y = ((b2 + b3)/b2) d1 + d2
    is a flat output: d1 + d2 = w y'' and d1 = (b2/b3) (y - w y'') with w = b2 / (b5 g) and b3 = l1 b5. Away from the upright
    the motion is not exact, and feedback makes up for it. The torque is that of the full equations along it.
    """
    b2, b5 = base["b2"], base["b5"]
    factor, w = b2 / (l1 * b5), b2 / (b5 * g)
    moves = tuple(Move(m.start, m.duration, (m.to - np.pi / 2) / factor) for m in poses)
    y = [RestToRest(0.0, moves, smoothness)(t, k) for k in range(5)]
    d1, d2 = zip(*((factor * (y[k] - w * y[k + 2]), w * y[k + 2] - factor * (y[k] - w * y[k + 2])) for k in range(3)), strict=True)
    angles = {"theta1": d1[0] + np.pi / 2, "theta2": d2[0]}
    signals = angles | {"omega1": d1[1], "omega2": d2[1], "alpha1": d1[2], "alpha2": d2[2]}
    torque = pendubot_regression("base", l1=l1, g=g).predict(signals, base)
    return Reference(np.stack([signals[n] for n in ("theta1", "theta2", "omega1", "omega2")], axis=1), torque)
