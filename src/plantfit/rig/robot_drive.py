"""Virtual robot on two driven wheels: a speed loop and an encoder at each, a path of straights and arcs, a camera
above."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains, pid
from plantfit.errors import SimulationError
from plantfit.models.text.equations import equations
from plantfit.recording.record import Recording, Signal
from plantfit.recording.signals.odometry import pose_along
from plantfit.rig.dc_motor import ROBOT_MOTOR
from plantfit.rig.encoder import capture
from plantfit.rig.run import RigRun
from plantfit.simulate.loop.closed_loop import ClosedLoop, closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor

LOOP = 1e-3  # s, the controllers' period
SPEED_STEP = 1.5  # rad/s of the motor, as a timer of 1 us tells it from the pulse period at 300 rad/s
SLOWEST_LOOP = 15.0  # rad/s, bandwidth of the speed loops of a robot with a mass
REST = 0.5  # s, after the path
MOTOR = "i' = (V - Rm*i - Kb*w)/Lm\nw' = (Kt*i - Cm*w)/J\nturned' = w"


class Segment(NamedTuple):
    """`length` (m) of the path of the robot's middle at a `curvature` (1/m), positive to the left."""

    length: float
    curvature: float = 0.0


# straights of 1 m, circles of radius 0.5 m
PATH = (Segment(1.0), Segment(np.pi, 2.0), Segment(1.0), Segment(np.pi, -2.0))


@dataclass(frozen=True, eq=False)
class RobotDriveRig:
    """Two motors alike, each with its own wheel, and what encoders and a camera record of the drive.

    `motor` as in `DcMotorRig`, without Coulomb friction; it turns `ratio` times for one turn of the encoder, the wheel
    `gear` times. `radii` of the left and the right wheel and the `track` between them (m). Each motor carries half of
    `mass` (kg); wheels do not slip. Bridges drive both ways, without which the robot could not brake. The robot's
    middle goes at `speed` (m/s), faster and slower by `acceleration` (m/s^2). `gains` of both PIDs are in counts of the
    duty; by default poles at -15 rad/s, for an empty motor at half of its own. `camera_noise` (m rms), a sample every
    `period` s.
    """

    motor: Mapping[str, float] = field(default_factory=lambda: dict(ROBOT_MOTOR))
    radii: tuple[float, float] = (0.032, 0.032)
    track: float = 0.14
    mass: float = 1.0
    ratio: float = 43 / 9
    gear: float = 1.0
    supply: float = 12.0
    efficiency: float = 0.98
    bits: int = 8
    pulses: int = 500
    slot_error: float = 0.02
    camera_noise: float = 2e-3
    speed: float = 1.0
    acceleration: float = 2.0
    period: float = 0.01
    gains: Gains | None = None

    def record(
        self, seed: int, path: Sequence[Segment] = PATH, duration: float | None = None, name: str = "robot_drive"
    ) -> RigRun:
        """One drive from rest along `path`, for the time that it takes and half a second, or for `duration` s.

        The recording has duty_left, duty_right (counts), N_left, N_right (pulses) and x_camera, y_camera (m). Phases
        and slots of the encoders and the camera's noise come from `seed`. Raises SimulationError for a path that the
        robot cannot drive.
        """
        rng = np.random.default_rng(seed)
        every = max(1, round(self.period / LOOP))
        t, wanted = self._wanted(path, duration, every)
        runs = [self._driven(row) for row in wanted.T]
        turned = [np.asarray(run.states["turned"]) / self.ratio for run in runs]  # of the encoders, rad
        phases, slots = rng.uniform(size=2), np.clip(self.slot_error * rng.standard_normal((2, self.pulses)), -0.4, 0.4)
        at = slice(None, None, every)
        seen: dict[str, tuple[np.ndarray, str]] = {}
        for side, run, angle, phase, own in zip(("left", "right"), runs, turned, phases, slots, strict=True):
            pulses = capture(t, angle + 2 * np.pi * phase / self.pulses, t[at], self.pulses, own, 0.0, 1.0)
            seen |= {
                f"duty_{side}": (np.asarray(run.u)[at] / self._volts, "PWM"),
                f"N_{side}": (pulses.counts, "counts"),
            }
        left, right = (radius * self.gear * np.diff(angle) for radius, angle in zip(self.radii, turned, strict=True))
        x, y, heading, distance = pose_along(left, right, self.track, (0.0, 0.0, 0.0))
        for axis, values in (("x", x), ("y", y)):
            seen[f"{axis}_camera"] = (values[at] + self.camera_noise * rng.standard_normal(len(t[at])), "m")
        true: dict[str, tuple[np.ndarray, str]] = {
            "x": (x, "m"),
            "y": (y, "m"),
            "heading": (heading, "rad"),
            "distance": (distance, "m"),
        }
        for side, run, angle, row in zip(("left", "right"), runs, turned, wanted.T, strict=True):
            true |= {f"w_{side}": (np.asarray(run.states["w"]), "rad/s"), f"wanted_{side}": (row, "rad/s")}
            true[f"angle_{side}"] = (self.gear * angle, "rad")
        told = f"Virtual robot, seed {seed}: wheels {self.radii[0]:g} and {self.radii[1]:g} m, track {self.track:g} m, "
        told += f"{self.pulses} pulses, camera {self.camera_noise:g} m rms."
        truth = {"seed": seed, "encoder_phases_slots": phases.tolist(), "gains": [float(g) for g in self.law[:3]]}
        exact = Recording(
            t[at], {n: Signal(v[at], u) for n, (v, u) in true.items()}, name, ("Virtual robot: exact signals.",)
        )
        return RigRun(Recording(t[at], {n: Signal(*v) for n, v in seen.items()}, name, (told,)), exact, truth)

    @property
    def law(self) -> Gains:
        """Gains of both speed loops: counts of duty for rad/s of the motor."""
        if self.gains is not None:
            return self.gains
        m = self.motor
        drive = m["Kt"] / (m["Rm"] * self.inertia)  # rad/s^2 for a volt
        own = drive * m["Kb"] + m["Cm"] / self.inertia
        pole = max(SLOWEST_LOOP, 0.5 * own)
        return Gains(max(0.0, 2 * pole - own) / drive / self._volts, pole**2 / drive / self._volts)

    @property
    def inertia(self) -> float:
        """Of a rotor with its share of the robot's mass, kg m^2 at the motor."""
        return self.motor["Jm"] + 0.5 * self.mass * (0.5 * sum(self.radii) * self.gear / self.ratio) ** 2

    @property
    def _volts(self) -> float:
        return self.efficiency * self.supply / (2**self.bits - 1)

    def _wanted(self, path: Sequence[Segment], duration: float | None, every: int) -> tuple[np.ndarray, np.ndarray]:
        """Times (N,) every LOOP s and set points (N, 2) of the motors, rad/s."""
        widest = max((abs(s.curvature) for s in path), default=0.0)
        if not path or any(not (np.isfinite(s.length) and s.length > 0) for s in path):
            raise SimulationError(
                "The robot's path needs parts with a length above 0 m; give for example a straight of 1 m."
            )
        scale = self.ratio / self.gear / np.array(self.radii)  # motor's rad for a metre of the wheel's path
        m = self.motor
        free = self.supply * self.efficiency * m["Kt"] / (m["Rm"] * m["Cm"] + m["Kt"] * m["Kb"])
        fastest = float(np.max(scale) * self.speed * (1 + 0.5 * widest * self.track))
        if fastest > 0.9 * free:
            raise SimulationError(
                f"At {self.speed:g} m/s a motor has to turn at {fastest:.4g} "
                f"rad/s, but its supply gives {free:.4g} rad/s; lower the speed."
            )
        ends = np.cumsum([s.length for s in path])
        whole, top = float(ends[-1]), min(self.speed, float(np.sqrt(ends[-1] * self.acceleration)))
        ramp = top / self.acceleration
        needed = whole / top + ramp
        length = needed + REST if duration is None else duration
        t = np.arange(every * round(length / (every * LOOP)) + 1) * LOOP
        pace = np.clip(np.minimum(t, needed - t) / ramp, 0.0, 1.0) * top
        # where the middle is to be, the integral of its pace
        rising, falling = np.clip(t, 0, ramp), np.clip(t - (needed - ramp), 0, ramp)
        there = 0.5 * self.acceleration * rising**2 + top * np.clip(t - ramp, 0, needed - 2 * ramp)
        there = there + top * falling - 0.5 * self.acceleration * falling**2
        bent = np.array([s.curvature for s in path])[
            np.minimum(np.searchsorted(ends, there, side="right"), len(path) - 1)
        ]
        sides = pace[:, None] * (1 + 0.5 * self.track * bent[:, None] * np.array([-1.0, 1.0]))
        return t, sides * scale

    def _driven(self, wanted: np.ndarray):
        """One motor under its PID along set points (N,)."""
        plant = {n: float(self.motor[n]) for n in ("Rm", "Lm", "Kb", "Kt", "Cm")} | {"J": float(self.inertia)}
        return _loop(self.supply * self.efficiency, self.bits).simulate(self.law, plant, wanted)


@lru_cache(maxsize=4)
def _loop(volts: float, bits: int) -> ClosedLoop:
    parameters = ["Rm", "Lm", "Kb", "Kt", "Cm", "J"]
    motor = equations(
        MOTOR, inputs=["V"], states=["i", "w", "turned"], outputs=["w"], parameters=parameters, name="motor"
    )
    law, drive = pid(LOOP, lower=1 - 2.0**bits, upper=2.0**bits - 1), Actuator.pwm(volts, bits, both_directions=True)
    return closed_loop(motor, law, period=LOOP, actuator=drive, sensor=Sensor(quantum=SPEED_STEP), stepper="exact")
