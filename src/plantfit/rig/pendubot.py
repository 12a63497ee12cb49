"""Virtual pendubot: motor, amplifier, encoders and a stabilising controller around a plant whose parameters are
known."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.library.pendubot import motor_torque, pendubot
from plantfit.models.library.pendubot_terms import BASE_UNITS, base_values
from plantfit.native import native_scan
from plantfit.recording.record import Recording, Signal
from plantfit.rig.lqg import Lqg, Weights, scheduled_lqg
from plantfit.rig.pendubot_reference import UPRIGHT, Reference, upright_reference
from plantfit.rig.run import RigRun
from plantfit.rig.trajectories import Move
from plantfit.simulate.loop.sensors import rounded
from plantfit.simulate.steps.steppers import rk4
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax
import jax.numpy as jnp

# before assembly: Sanin-Villa et al. 2024
MEASURED = {"m1": 0.210, "m2": 0.1, "lc1": 0.12, "lc2": 0.15, "I1": 0.00053, "I2": 0.00077}
MOTOR = {"kt": 0.0724, "ke": 0.0724, "Ra": 2.983}
POSES = (Move(4.5, 2.5, 2 * np.pi / 3), Move(9.5, 4.0, np.pi / 3), Move(17.5, 2.5, np.pi / 2))
STATES = {"theta1": "rad", "theta2": "rad", "omega1": "rad/s", "omega2": "rad/s"}


@dataclass(frozen=True, eq=False)
class PendubotRig:
    """A pendubot that moves from pose to pose with link 2 upright, and what its sensors record of it.

    `parameters` are the truth: the links (kg, m, kg m^2), the motor (N m/A, V s/rad, ohm; MOTOR unless given) and a
    value for every coefficient of `friction`, whose parts are those of `plantfit.models.library.pendubot`. `poses` are
    moves of theta1 (rad). `counts` per revolution of both encoders, `voltage_noise` (V) on the recorded voltage,
    +-`limit` (V) of the amplifier, one voltage per `period` (s). The controller, an LQG about the reference, knows the
    truth but for friction.

    Source of poses, motor and links: Sanin-Villa et al. 2024; limit, noise and controller are ours.
    """

    parameters: Mapping[str, float] = field(default_factory=lambda: dict(MEASURED))
    friction: Sequence[str] = ()
    poses: tuple[Move, ...] = POSES
    duration: float = 25.0
    period: float = 1e-3
    counts: int = 10_000
    voltage_noise: float = 5e-3
    limit: float = 24.0
    l1: float = 0.15
    g: float = 9.81
    substeps: int = 2
    weights: Weights = Weights((math.radians(3.0), math.radians(3.0), 0.0, 0.0), 4.0, 1.0, 2e-4)  # noqa: RUF009  (immutable)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", {**MOTOR, **self.parameters})
        for name in ("duration", "period", "limit", "counts", "substeps"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise SimulationError(f"The rig's {name} is {getattr(self, name)}; give a number above 0.")
        if not self.voltage_noise >= 0:
            raise SimulationError(
                f"The rig's voltage_noise is {self.voltage_noise}; give a standard deviation in V, 0 for none."
            )
        self._vector(self._plant("physical"), self.parameters)

    # -- what a user calls ------------------------------------------------------------------------

    def record(self, seed: int, offset: tuple[float, float] = (0.0, 0.0), name: str = "pendubot") -> RigRun:
        """One run; the phases of both encoders and the noise of the voltage come from `seed`.

        `offset` (rad) is added to the angles of the upright in which the run starts. Raises SimulationError when it
        falls.
        """
        rng = np.random.default_rng(seed)
        phase = rng.uniform(-0.5, 0.5, 2)
        exact, seen = self._simulated(self._plant("physical"), self.parameters, offset, 2 * np.pi / self.counts, phase)
        voltage = exact["V"] + self.voltage_noise * rng.standard_normal(len(self.t))
        signals = {
            "theta1": Signal(seen[0], "rad"),
            "theta2": Signal(seen[1], "rad"),
            "V": Signal(voltage, "V"),
            **self._references,
        }
        told = (
            f"Virtual pendubot, seed {seed}: {self.counts} counts a revolution, {self.period:g} s, "
            f"{self.voltage_noise:g} V rms noise."
        )
        truth = {
            "seed": seed,
            "offset_rad": [float(o) for o in offset],
            "encoder_phase_counts": phase.tolist(),
            "parameters": dict(self.parameters),
            "base": self.base,
            "constants": {"l1": self.l1, "g": self.g},
            "friction": list(self.friction),
            "counts": self.counts,
            "voltage_noise_V": self.voltage_noise,
            "limit_V": self.limit,
            "period_s": self.period,
        }
        return RigRun(Recording(self.t, signals, name, (told,)), self._exact(exact, self.parameters), truth)

    def noise_free(
        self, values: Mapping[str, float] | None = None, offset: tuple[float, float] = (0.0, 0.0)
    ) -> Recording:
        """The same closed loop with perfect sensors at other parameter values: its motion, voltage and torque.

        `values` (the truth if left out) are those of the links, physical or b1, b2, b4, b5, and of friction; the
        motor's stay unless given. The controller stays as it is. Raises SimulationError for a missing value and when it
        falls.
        """
        values = {n: v for n, v in self.parameters.items() if n not in MEASURED} | dict(
            self.parameters if values is None else values
        )
        plant = self._plant("base" if set(BASE_UNITS) & set(values) else "physical")
        return self._exact(self._simulated(plant, values, offset, 0.0, np.zeros(2))[0], values)

    @property
    def base(self) -> dict[str, float]:
        """The true b1, b2 (kg m^2), b4, b5 (kg m)."""
        return {n: float(v) for n, v in base_values(self.parameters, self.l1).items()}

    @cached_property
    def t(self) -> np.ndarray:
        """Times (N,) of the samples in seconds."""
        return np.arange(round(self.duration / self.period) + 1) * self.period

    # -- reference and controller -----------------------------------------------------------------

    @cached_property
    def reference(self) -> Reference:
        """The motion that the controller follows."""
        return upright_reference(self.t, self.base, self.poses, self.l1, self.g)

    @cached_property
    def controller(self) -> tuple[np.ndarray, Lqg]:
        """Feedforward (N,) in V, and the feedback along the reference."""
        states = self.reference.states
        feedforward = self.voltage(self.reference.torque, states[:, 2])
        return feedforward, scheduled_lqg(self.linearised, states[:, 0], self.period, self.weights, measured=2)

    def voltage(self, torque: Any, omega1: Any) -> Any:
        """Voltage (V) for a torque (N m) at joint 1 that turns with omega1 (rad/s)."""
        p = self.parameters
        return p["Ra"] / p["kt"] * torque + p["ke"] * omega1

    def linearised(self, theta1: float) -> tuple[np.ndarray, np.ndarray]:
        """A (4, 4) and B (4, 1) in continuous time, input V, at rest at theta1 (rad) with link 2 upright; without
        friction."""
        held = self.voltage(self.base["b4"] * self.g * np.cos(theta1), 0.0)
        with jax.ensure_compile_time_eval():  # the first call may come while something is traced
            slope = np.asarray(self._slopes(np.array([theta1, UPRIGHT - theta1, 0.0, 0.0, held])))
        return slope[:, :4], slope[:, 4:]

    @cached_property
    def _slopes(self) -> Any:
        plant = voltage_plant("base", (), self.l1, self.g)
        numbers = tuple(float({**self.parameters, **self.base}[n]) for n in plant.parameters)
        return jax.jit(jax.jacfwd(lambda x: jnp.stack(plant.rate(tuple(x[i] for i in range(4)), (x[4], 0.0), numbers))))

    @property
    def _references(self) -> dict[str, Signal]:
        return {f"{n}_ref": Signal(self.reference.states[:, k], "rad") for k, n in enumerate(("theta1", "theta2"))}

    # -- simulation -------------------------------------------------------------------------------

    def _plant(self, parameters: Any) -> VectorModel:
        return voltage_plant(parameters, tuple(self.friction), self.l1, self.g)

    def _vector(self, plant: VectorModel, values: Mapping[str, float]) -> tuple[float, ...]:
        missing = [n for n in plant.parameters if n not in values]
        if missing:
            raise SimulationError(
                f"The pendubot rig has no value for {missing[0]!r}; give it in parameters, with "
                f"{list(plant.parameters)}."
            )
        return tuple(float(values[n]) for n in plant.parameters)

    def _simulated(
        self,
        plant: VectorModel,
        values: Mapping[str, float],
        offset: tuple[float, float],
        quantum: float,
        phase: np.ndarray,
    ) -> Any:
        """States and voltage by name, and the two readings (N,)."""
        feedforward, lqg = self.controller
        rows = (self.reference.states, feedforward, *lqg)
        start = tuple(self.reference.states[0] + np.array([*offset, 0.0, 0.0]))
        loop = (self.period, self.substeps, self.limit)
        *states, voltage, seen1, seen2 = map(
            np.asarray, run_closed_loop(plant, loop, self._vector(plant, values), start, rows, quantum, tuple(phase))
        )
        fallen = ~(np.abs(states[0] + states[1] - np.pi / 2) < np.pi / 2)
        if np.any(fallen):
            raise SimulationError(
                f"The pendubot fell at {self.t[int(np.argmax(fallen))]:g} s with the start {tuple(offset)} "
                "rad off the upright; start nearer to it, or move to nearer poses in more time."
            )
        return dict(zip(STATES, states, strict=True)) | {"V": voltage}, (seen1, seen2)

    def _exact(self, signals: Mapping[str, np.ndarray], values: Mapping[str, float]) -> Recording:
        torque = motor_torque(signals["V"], signals["omega1"], values["kt"], values["ke"], values["Ra"])
        named = {n: Signal(v, {**STATES, "V": "V"}[n]) for n, v in signals.items()} | {"tau1": Signal(torque, "N*m")}
        return Recording(self.t, named | self._references, "pendubot", ("Virtual pendubot: exact signals.",))


@lru_cache(maxsize=16)
def voltage_plant(parameters: Any, friction: tuple[str, ...], l1: float, g: float) -> VectorModel:
    """`pendubot` driven by a voltage; the same value for the same options, so that rigs share what is compiled."""
    return vectorise(pendubot(parameters, drive="voltage", friction=friction, l1=l1, g=g))


@partial(jax.jit, static_argnums=(0, 1))
def run_closed_loop(
    plant: VectorModel,
    loop: tuple[float, int, float],
    p: Any,
    start: Any,
    rows: Any,
    quantum: Any,
    phase: Any,
    designs: Any = None,
) -> Any:
    """States, voltage and readings at every sample, each (N,); `rows` are reference, feedforward and the arrays of an
    `Lqg`.

    With `designs`, arrays of an `Lqg` over nodes, `rows` end with the node before each sample and the share of the way
    to the next: straight lines between designs, drawn as the loop goes, take a tenth of the memory.
    """
    period, substeps, limit = loop

    def read(angle, shift):
        return jnp.where(
            quantum > 0, quantum * (rounded(angle / jnp.where(quantum > 0, quantum, 1.0) - shift, 1) + shift), angle
        )

    def sample(carry, row):
        x, e = carry
        reference, feedforward, *design = row
        gain, transition, push, observer = (
            design if designs is None else [_between(table, *design) for table in designs]
        )
        seen = tuple(read(a, s) for a, s in zip(x[:2], phase, strict=True))
        surprise = [y - reference[k] - e[k] for k, y in enumerate(seen)]
        e = [e[i] + sum(observer[i, k] * s for k, s in enumerate(surprise)) for i in range(4)]
        u = jnp.clip(feedforward - sum(gain[i] * e[i] for i in range(4)), -limit, limit)
        ahead = tuple(sum(transition[i, j] * e[j] for j in range(4)) + push[i] * (u - feedforward) for i in range(4))
        after = x
        for _ in range(substeps):
            after = rk4(plant.rate, after, (u, 0.0), (u, 0.0), period / substeps, p, False)
        return (after, ahead), (*x, u, *seen)

    zero = jnp.zeros(())
    carry = (tuple(map(jnp.asarray, start)), (zero,) * 4)
    designs = jax.tree.map(jnp.asarray, designs)
    return native_scan(sample, carry, jax.tree.map(jnp.asarray, rows), keep=True, fallback=True)[1]


def _between(table: Any, at: Any, share: Any) -> Any:
    return (1.0 - share) * table[at] + share * table[at + 1]
