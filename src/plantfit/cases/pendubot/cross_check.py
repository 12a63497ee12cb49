"""The base parameters of one record twice: backwards from motion to torque, and forwards from voltage to angles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.estimate import (
    Comparison,
    Estimate,
    InverseDynamics,
    InverseFit,
    compare_estimates,
)
from plantfit.fitting import estimate_at, gauss_newton
from plantfit.models.extensions import with_extensions
from plantfit.models.library.pendubot import motor_torque, pendubot, pendubot_regression
from plantfit.models.library.pendubot_terms import BASE_UNITS, base_values
from plantfit.problem import Problem
from plantfit.problem.shooting.start import Shooting, Shot
from plantfit.recording.clean.parts import pieces
from plantfit.recording.record import Recording
from plantfit.rig import PendubotRig
from plantfit.space import Parameter

REFERENCE = {"theta1": "theta1_ref", "theta2": "theta2_ref"}
# of a window's start about its first sample, at rest
SPREAD = {"theta1": 0.01, "theta2": 0.01, "omega1": 3.0, "omega2": 3.0}
AGREE = 1e-4  # relative difference of the costs of two shots that ended in the same place


def inverse_dynamics(joints: Sequence[int] = (1, 2), smoothing: float = 20.0, band: float = 5.0) -> InverseDynamics:
    """Rows of b1, b2, b4, b5 from a record of theta1, theta2 and the motor's voltage V; the torque of joint 2 is zero.

    `joints` whose equations count; `smoothing` and `band` in Hz as in `InverseDynamics`.
    """
    return InverseDynamics(
        pendubot_regression("base", joints=joints),
        {"theta1": ("omega1", "alpha1"), "theta2": ("omega2", "alpha2")},
        lambda s: {"tau1": motor_torque(s["V"], s["omega1"]), "tau2": 0.0},
        held=("V",),
        smoothing=smoothing,
        band=band,
    )


def inverse_fit(recording: Recording, rig: PendubotRig, joints: Sequence[int] = (1, 2)) -> InverseFit:
    """b1, b2, b4, b5 by instrumental variables: from the reference motion first, then from the noise-free loop of
    `rig`."""
    return inverse_dynamics(joints).fit(recording, rig.noise_free, REFERENCE)


@dataclass(frozen=True)
class ForwardFit:
    """`estimate` of b1, b2, b4, b5, the RMSE of the angles in encoder steps of `step` rad, and the shots that led to
    it."""

    estimate: Estimate
    rmse: float
    shots: tuple[Shot, ...]


def forward_fit(
    recording: Recording, length: float = 1.0, step: float = 2 * np.pi / 10_000, seed: int = 0, starts: int = 6
) -> ForwardFit:
    """b1, b2, b4, b5 from simulated angles: windows of `length` seconds with starts of their own, joined by multiple
    shooting.

    Starts are drawn from the box of the physical parameters, where the mass matrix is positive, until two shots agree.
    Raises SearchError when no two of `starts` do.
    """
    parameters = {f"start_{n}": Parameter((-s, s), per_recording=True) for n, s in SPREAD.items()}
    scales = {n: float(step / np.sqrt(12.0)) for n in ("theta1", "theta2")}
    model = with_extensions(pendubot("base", drive="voltage"), {"start": {n: (-s, s) for n, s in SPREAD.items()}})
    records = {piece.name: piece for piece in pieces(recording, length)}
    problem = Problem(model, records, parameters, stepper="rk4", substeps=1, scales=scales)
    shooting, rng, shots = Shooting.of(problem, length=min(0.1, length)), np.random.default_rng(seed), []
    for _ in range(starts):
        shots.append(shooting.solve(_start(problem, rng)))
        closed = sorted((s for s in shots if s.closed), key=lambda s: s.cost)
        if len(closed) > 1 and closed[1].cost <= (1.0 + AGREE) * closed[0].cost:
            z = gauss_newton(problem, closed[0].z)
            return ForwardFit(
                estimate_at(problem, z, list(BASE_UNITS)), float(np.sqrt(problem.cost(z) / 12.0)), tuple(shots)
            )
    raise SearchError(
        f"No two of {starts} starts of the forward fit agree; give more starts, or shorter windows than {length:g} s."
    )


def cross_check(inverse: Estimate, forward: Estimate) -> Comparison:
    """Whether both directions agree.

    They share the errors of the encoders but count as independent here: differences are called too seldom, not too
    often.
    """
    return compare_estimates(inverse, forward, ("the inverse fit", "the forward fit"))


def _start(problem: Problem, rng: np.random.Generator) -> np.ndarray:
    """A point of the cube: starts of windows as measured, base parameters of links drawn from their box."""
    links = {p.name: rng.uniform(*p.bounds) for p in pendubot().parameters if p.bounds}
    base = base_values(links)
    middle = np.asarray(problem.space.physical(np.full(problem.space.dimension, 0.5)))
    return np.asarray(
        problem.space.cube(np.array([base.get(n, m) for n, m in zip(problem.space.names, middle, strict=True)]))
    )
