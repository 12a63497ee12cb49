"""A pendubot that a motor with a winding drives, and an LQR of torques that follows poses through the motor's
supposed constants."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.design import Design
from plantfit.control.linear.kalman import Estimator, kalman_observer
from plantfit.control.linear.linear_plant import LinearPlant, linearised
from plantfit.control.linear.lqr import lqr
from plantfit.control.linear.torque_drive import through_motor
from plantfit.models.library.pendubot import pendubot
from plantfit.models.library.pendubot_terms import base_values
from plantfit.models.model import Model
from plantfit.models.parts.motor_driven import motor_driven
from plantfit.rig.pendubot import MEASURED
from plantfit.rig.pendubot_reference import UPRIGHT, upright_reference
from plantfit.rig.trajectories import Move
from plantfit.simulate.loop.closed_loop import ClosedLoop, Trajectory
from plantfit.simulate.loop.sensors import Actuator, Sensor

MOVES = (Move(1.0, 2.0, UPRIGHT + np.pi / 9), Move(4.5, 2.5, UPRIGHT - np.pi / 9), Move(8.5, 2.0, UPRIGHT))


class Tracked(NamedTuple):
    """`run`, the wanted angles (N, 2) in rad, and of both angles the error's rms and largest value (2,) in rad; the
    share of samples at the limit; whether link 2 fell."""

    run: Trajectory
    wanted: np.ndarray
    rms: np.ndarray
    largest: np.ndarray
    at_limit: float
    fell: bool


@dataclass(frozen=True, eq=False)
class PendubotTracking:
    """Poses with link 2 upright, followed by a state feedback of torques every `period` s.

    `links` are m1 .. I2 (SI), known to the controller; `counts` a revolution of both encoders, a bridge of +-`supply` V
    at `bits` a direction, a motor behind a `gear`. `weights` are Q on the states (1/rad^2) and R on the torque (1/(N
    m)^2) of `lqr`, `wander` the process noise of `kalman_observer`. Links, moves and weights are ours; the paper prints
    none of its pendubot.
    """

    links: Mapping[str, float] = field(default_factory=lambda: dict(MEASURED))
    moves: tuple[Move, ...] = MOVES
    duration: float = 12.0
    period: float = 1e-3
    counts: int = 10_000
    supply: float = 12.0
    efficiency: float = 0.98
    bits: int = 8
    gear: float = 1.0
    weights: tuple[Mapping[str, float], float] = field(default_factory=lambda: ({"theta1": 1.0, "theta2": 1.0}, 1.0))
    wander: Mapping[str, float] = field(default_factory=lambda: {"omega1": 0.3, "omega2": 0.3})
    l1: float = 0.15
    g: float = 9.81

    def follow(self, truth: Mapping[str, float], motor: Mapping[str, float] | None) -> Tracked:
        """One run on a motor of constants `truth`; the controller takes them for `motor`, or its torque acts at once
        (None).

        Both hold Rm, Lm, Kb, Kt, Jm, Cm, Tf by the names and units of `models.dc_motor`, at the motor's shaft.
        """
        believed = motor or truth
        law = lqr(self._torque_plant(believed), self.period, *self.weights, estimator=self._filter(believed))
        reference = self._reference(believed)
        start = {n: float(v[0]) for n, v in reference.items() if n != "tau1"}
        values = self._values(truth)
        if motor is not None:
            law = through_motor(law, motor, "omega1", self.limit, self.gear)
            start["i"] = float(reference["tau1"][0]) / (self.gear * truth["Kt"])
            values = {**values, **{n: truth[n] for n in ("Rm", "Lm", "Kb", "Kt")}}
        run = self._loop(law).simulate(law.parameters, values, reference, x0=start)
        return self._judged(run, np.stack([reference["theta1"], reference["theta2"]], axis=1))

    @property
    def limit(self) -> float:
        """The bridge's largest voltage."""
        return self.efficiency * self.supply

    @cached_property
    def t(self) -> np.ndarray:
        """Times (N,) of the samples in seconds."""
        return np.arange(round(self.duration / self.period) + 1) * self.period

    def _judged(self, run: Trajectory, wanted: np.ndarray) -> Tracked:
        angles = np.stack([np.asarray(run.states[n]) for n in ("theta1", "theta2")], axis=1)
        angles = np.where(np.isfinite(angles), angles, np.inf)
        upright = np.abs(angles.sum(axis=1) - UPRIGHT) < np.pi / 2
        error = angles - wanted
        at_limit = np.abs(np.asarray(run.u["V"])) > 0.9999 * self.limit if "V" in run.u else np.zeros(len(angles), bool)
        rms, largest = np.sqrt(np.mean(error**2, axis=0)), np.max(np.abs(error), axis=0)
        return Tracked(run, wanted, rms, largest, float(np.mean(at_limit)), not np.all(upright))

    # -- plant and controller ---------------------------------------------------------------------

    def _loop(self, law: Design) -> ClosedLoop:
        """The loop for a law's kind of command, the same for all motors, so that it is compiled once."""
        if law.plant.inputs not in self._loops:
            sensor, step = Sensor(quantum=2 * np.pi / self.counts), self.limit / (2**self.bits - 1)
            if law.plant.inputs == ("V",):
                model, actuator = (
                    motor_driven(self._links, "tau1", "omega1", self.gear),
                    Actuator(-self.limit, self.limit, step),
                )
            else:
                model, actuator = self._links, Actuator()
            self._loops[law.plant.inputs] = law.close(
                model, sensor=sensor, actuator=actuator, stepper="rk4", substeps=2
            )
        return self._loops[law.plant.inputs]

    @cached_property
    def _loops(self) -> dict[tuple[str, ...], ClosedLoop]:
        return {}

    @cached_property
    def _links(self) -> Model:
        return self._pendubot(("viscous", "coulomb"))

    def _pendubot(self, friction: tuple[str, ...]) -> Model:
        return _pendubot(friction, self.gear, self.l1, self.g)

    @property
    def _base(self) -> dict[str, float]:
        return {n: float(v) for n, v in base_values(self.links, self.l1).items()}

    def _values(self, motor: Mapping[str, float]) -> dict[str, float]:
        """Parameters of the links with the rotor's inertia and friction at joint 1."""
        rotor = {
            "Ir": motor["Jm"],
            "Fv1": self.gear**2 * motor["Cm"],
            "Fc1": self.gear * motor["Tf"],
            "Fv2": 0.0,
            "Fc2": 0.0,
        }
        return self._base | rotor

    def _torque_plant(self, motor: Mapping[str, float]) -> LinearPlant:
        """About the upright; Coulomb friction has no slope there that a linear design should know."""
        return _upright(self.gear, self.l1, self.g, tuple(self._values(motor).items()))

    def _filter(self, motor: Mapping[str, float]) -> Estimator:
        return kalman_observer(
            self._torque_plant(motor), self.period, self.wander, 2 * np.pi / self.counts / np.sqrt(12.0)
        )

    def _reference(self, motor: Mapping[str, float]) -> dict[str, np.ndarray]:
        states, torque, accelerations = upright_reference(self.t, self._base, self.moves, self.l1, self.g)
        rotor = self.gear**2 * (motor["Jm"] * accelerations[:, 0] + motor["Cm"] * states[:, 2])
        names = ("theta1", "theta2", "omega1", "omega2")
        return {n: states[:, k] for k, n in enumerate(names)} | {"tau1": torque + rotor}


def _pendubot(friction: tuple[str, ...], gear: float, l1: float, g: float) -> Model:
    return pendubot("base", gear_ratio=gear, friction=friction, l1=l1, g=g)


@lru_cache(maxsize=32)
def _upright(gear: float, l1: float, g: float, values: tuple[tuple[str, float], ...]) -> LinearPlant:
    # motors that differ in their winding have the same one, and to linearise takes as long as to simulate a run
    return linearised(_pendubot(("viscous",), gear, l1, g), dict(values), {"theta1": UPRIGHT})
