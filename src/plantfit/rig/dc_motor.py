"""Virtual bench of a DC motor: PWM bridge, encoder with a timer, and a current meter around a motor whose constants
are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np
from scipy.signal import lfilter

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.library.dc_motor import dc_motor
from plantfit.native import native_scan
from plantfit.recording.record import Recording, Signal
from plantfit.rig.encoder import capture
from plantfit.rig.run import RigRun
from plantfit.simulate.steps.exponential import exponential
from plantfit.simulate.steps.steppers import rk4
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax
import jax.numpy as jnp

# identified in the 2018 paper, eq. 18, by the names of models.dc_motor; it has no Coulomb friction
ROBOT_MOTOR = {
    "Rm": 2.759854243587, "Lm": 1.1186575703e-2, "Kb": 5.008705e-3, "Kt": 5.008705e-3, "Jm": 2.2748e-8,
    "Cm": 1.13284e-6, "Tf": 0.0,
}  # fmt: skip
STIFF = (
    1.0  # steps longer than this share of the quickest time constant are exponential: Runge-Kutta's explode from 2.8 on
)


@dataclass(frozen=True, eq=False)
class DcMotorRig:
    """A DC motor on a bench, and what its sensors record of it.

    `parameters` are those of `models.dc_motor` (ohm, H, V s/rad, N m/A, kg m^2, N m s/rad, N m), `load` a constant
    torque (N m). The bridge takes a duty in whole counts of `bits` at `supply` V and `efficiency`. The encoder has
    `pulses` slots and turns once for `ratio` turns of the motor; `slot_error` is the rms error of a slot's place as a
    share of its width. A timer of `tick` s measures the last pulse's period, `timeout` s where none comes. `current`
    "rms" is a meter's RMS over `window` s, "signed" what a Hall sensor reads at the moment, both with `current_noise`
    (A rms) in steps of `current_step` (A). A sample every `period` s for `duration` s; `substeps` between two. `wander`
    (V rms) is what the bridge's voltage wanders by over `wander_time` s: without it a drive that repeats itself brings
    the shaft back to the same slot and the timer to the same count, round after round, and the encoder's errors come
    back with it.
    """

    parameters: Mapping[str, float] = field(default_factory=lambda: dict(ROBOT_MOTOR))
    load: float = 0.0
    supply: float = 12.0
    bits: int = 8
    efficiency: float = 0.98
    pulses: int = 500
    ratio: float = 43 / 9
    slot_error: float = 0.02
    tick: float = 1e-6
    timeout: float = 0.1
    current: Literal["rms", "signed"] = "rms"
    window: float = 1e-3
    current_noise: float = 2e-3
    current_step: float = 1e-3
    wander: float = 0.0
    wander_time: float = 1.0
    period: float = 1e-3
    duration: float = 1.0
    substeps: int = 50

    def __post_init__(self) -> None:
        for name in (
            "supply",
            "bits",
            "pulses",
            "ratio",
            "timeout",
            "window",
            "wander_time",
            "period",
            "duration",
            "substeps",
        ):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise SimulationError(f"The motor rig's {name} is {getattr(self, name)}; give a number above 0.")
        for name in ("slot_error", "tick", "current_noise", "current_step", "wander"):
            if not getattr(self, name) >= 0:
                raise SimulationError(f"The motor rig's {name} is {getattr(self, name)}; give 0 or more.")
        if not 0 < self.efficiency <= 1:
            raise SimulationError(
                f"The motor rig's efficiency is {self.efficiency}; give a share above 0 and at most 1, such as 0.98."
            )
        if self.current not in ("rms", "signed"):
            raise SimulationError(f"The motor rig's current is {self.current!r}; use 'rms' or 'signed'.")
        missing = [n for n in ROBOT_MOTOR if n not in self.parameters]
        if missing:
            raise SimulationError(
                f"The motor rig has no value for {missing[0]!r}; give it in parameters, with {list(ROBOT_MOTOR)}."
            )

    # -- what a user calls ------------------------------------------------------------------------

    def record(self, seed: int, excitation: Recording | float = 3.0, name: str = "dc_motor") -> RigRun:
        """One run from rest; noise, the encoder's phase and its slots come from `seed`.

        `excitation` is a constant voltage (V) or a recording with a signal "V", held between its samples, which also
        sets the duration. The bridge gives the nearest duty. The recording has duty (counts), N (pulses), Tp (s) and I
        (A, RMS) or i (A, signed); clean it by `duty_to_voltage` and `period_to_speed`. Raises SimulationError for a
        voltage beyond the bridge's.
        """
        rng = np.random.default_rng(seed)
        t, duty = self._duty(excitation)
        volts = duty * self.volts_per_count + self.wandering(seed, len(t))
        i, w = self._simulated(volts)
        fine = np.arange(len(i)) * (self.period / self.substeps)
        phase, slots = self.encoder(rng)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(fine))])
        angle = turned / self.ratio + 2 * np.pi * phase / self.pulses
        pulses = capture(fine, angle, t, self.pulses, slots, self.tick, self.timeout, w / self.ratio)
        at = slice(None, None, self.substeps)
        rms = self._rms(i)[at]
        shown = (rms if self.current == "rms" else i[at]) + self.current_noise * rng.standard_normal(len(t))
        if self.current_step > 0:
            shown = self.current_step * np.round(shown / self.current_step)
        seen = {"duty": (duty, "PWM"), "N": (pulses.counts, "counts"), "Tp": (pulses.period, "s")}
        seen |= {"I": (np.maximum(shown, 0.0), "A")} if self.current == "rms" else {"i": (shown, "A")}
        true = {
            "V": (volts, "V"),
            "i": (i[at], "A"),
            "w": (w[at], "rad/s"),
            "I": (rms, "A"),
            "angle": (turned[at], "rad"),
        }
        told = (
            f"Virtual DC motor, seed {seed}: {self.pulses} pulses, "
            f"{self.tick:g} s timer, {self.current_noise:g} A rms noise."
        )
        truth = {
            "seed": seed, "parameters": dict(self.parameters), "load_Nm": self.load,
            "encoder_phase_slots": float(phase),
            "settings": {n: getattr(self, n) for n in _SETTINGS},
        }  # fmt: skip
        exact = Recording(t, {n: Signal(*v) for n, v in true.items()}, name, ("Virtual DC motor: exact signals.",))
        return RigRun(Recording(t, {n: Signal(*v) for n, v in seen.items()}, name, (told,)), exact, truth)

    def encoder(self, rng: np.random.Generator) -> tuple[float, np.ndarray]:
        """The encoder's phase in slots and how far each of its slots (pulses,) is off, as a share of its width."""
        phase, slots = rng.uniform(), self.slot_error * rng.standard_normal(self.pulses)
        return phase, np.clip(slots, -0.4, 0.4)  # edges keep their order

    def wandering(self, seed: int, n: int) -> np.ndarray:
        """What is added to the bridge's voltage in each of `n` periods (V): an Ornstein-Uhlenbeck process from the
        seed."""
        if self.wander == 0:
            return np.zeros(n)
        memory = float(np.exp(-self.period / self.wander_time))
        draws = np.random.default_rng([seed, 12]).standard_normal(n)
        draws[1:] *= np.sqrt(1.0 - memory**2)
        return self.wander * lfilter([1.0], [1.0, -memory], draws)

    @property
    def volts_per_count(self) -> float:
        """kpwm: voltage of the motor for one count of duty."""
        return self.efficiency * self.supply / (2**self.bits - 1)

    # -- inside -----------------------------------------------------------------------------------

    def _duty(self, excitation: Recording | float) -> tuple[np.ndarray, np.ndarray]:
        """Times (N,) and duty (N,) in whole counts."""
        if isinstance(excitation, Recording):
            if "V" not in excitation.signals:
                raise SimulationError(
                    f"The excitation {excitation.name!r} has no signal 'V'; it has {list(excitation.signals)}."
                )
            t = np.arange(round((excitation.t[-1] - excitation.t[0]) / self.period) + 1) * self.period
            # half a nanosecond for times that are multiples of the period up to rounding
            place = np.searchsorted(excitation.t - excitation.t[0], t + 5e-10, side="right") - 1
            wanted = excitation["V"][place]
        else:
            t = np.arange(round(self.duration / self.period) + 1) * self.period
            wanted = np.full(len(t), float(excitation))
        duty = np.round(wanted / self.volts_per_count)
        if not np.all(np.abs(duty) <= 2**self.bits - 1):
            most = self.volts_per_count * (2**self.bits - 1)
            raise SimulationError(
                f"The excitation reaches {np.max(np.abs(wanted)):g} V, but the bridge gives {most:g} V; lower it."
            )
        return t, duty

    def _simulated(self, volts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Current and speed at every substep, (1 + (N - 1) substeps,) each, from rest."""
        plant = motor_of()
        p = tuple(float(self.parameters[n]) for n in plant.parameters)
        i, w = run_motor(plant, self.period / self.substeps, p, np.repeat(volts[:-1], self.substeps), self.load)
        return np.concatenate([[0.0], np.asarray(i)]), np.concatenate([[0.0], np.asarray(w)])

    def _rms(self, i: np.ndarray) -> np.ndarray:
        """Root mean square of the current over the `window` before, as if it had rested before the start."""
        n = max(1, round(self.window * self.substeps / self.period))
        total = np.concatenate([[0.0], np.cumsum(0.5 * (i[1:] ** 2 + i[:-1] ** 2))])
        before = np.concatenate([np.zeros(min(n, len(i))), total[:-n]]) if n < len(i) else np.zeros(len(i))
        return np.sqrt((total - before) / n)


_SETTINGS = (
    "supply", "bits", "efficiency", "pulses", "ratio", "slot_error", "tick", "timeout", "current", "window",
    "current_noise",
    "current_step", "wander", "wander_time", "period", "substeps",
)  # fmt: skip


@lru_cache(maxsize=1)
def motor_of() -> VectorModel:
    """The motor that rigs simulate."""
    return vectorise(dc_motor(load=True))


def quickest(plant: VectorModel, p: Sequence[float]) -> float:
    """The quickest rate of the motor without Coulomb friction (1/s): with a small winding far above what its speed
    shows."""
    n = dict(zip(plant.parameters, p, strict=True))
    linear = [[-n["Rm"] / n["Lm"], -n["Kb"] / n["Lm"]], [n["Kt"] / n["Jm"], -n["Cm"] / n["Jm"]]]
    return float(np.max(np.abs(np.linalg.eigvals(linear))))


def run_motor(
    plant: VectorModel, step: float, p: Sequence[float], volts: Any, load: Any, begin: Any = (0.0, 0.0)
) -> Any:
    """Current and speed (n,) after each step of a motor under `volts` (n,), from current and speed at the beginning,
    by default rest."""
    return _run(plant, quickest(plant, p) * step > STIFF, step, p, volts, load, begin)


@partial(jax.jit, static_argnums=(0, 1))
def _run(plant: VectorModel, stiff: bool, step: Any, p: Any, volts: Any, load: Any, begin: Any) -> Any:
    advance = exponential if stiff else rk4

    def one(x, u):
        after = advance(plant.rate, x, (u, load, 0.0), (u, load, 0.0), step, p, False)
        return after, after

    first = tuple(jnp.asarray(v, dtype=float) for v in begin)
    return native_scan(one, first, jnp.asarray(volts), keep=True, fallback=True)[1]
