"""What stands between a sampled controller and a plant: delay lines, a sensor, an actuator."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError

import jax.numpy as jnp
from jax import lax

REGISTER = 8  # samples up to which a delay is a shift register, which XLA fuses; longer ones are a ring


class DelayLine(NamedTuple):
    """`begin(value)` fills the line; `push(line, k, value)` gives (line, the value pushed `samples` calls ago) at
    call k."""

    begin: Callable[[Any], Any]
    push: Callable[[Any, Any, Any], tuple[Any, Any]]


def delay_line(samples: int) -> DelayLine:
    """A pure delay of a whole number of samples, 0 or more."""
    if samples == 0:
        return DelayLine(lambda value: (), lambda line, k, value: (line, value))
    if samples <= REGISTER:
        return DelayLine(lambda value: (value,) * samples, lambda line, k, value: ((*line[1:], value), line[0]))

    def push(ring, k, value):
        place = k % samples
        late = lax.dynamic_index_in_dim(ring, place, keepdims=False)
        return lax.dynamic_update_index_in_dim(ring, value, place, 0), late

    return DelayLine(lambda value: jnp.full(samples, value), push)


@dataclass(frozen=True)
class Sensor:
    """How the controlled output is measured, in the unit of the output.

    A new value every `every` controller samples, held between; rounded to multiples of `quantum`
    (0: not rounded); `delay` controller samples late. Noise is added before rounding and is given
    to the simulation as an array. Before the first sample the line holds the first value.
    Raises SimulationError for a negative quantum or delay, or `every` below 1.
    """

    quantum: float = 0.0
    delay: int = 0
    every: int = 1

    def __post_init__(self) -> None:
        _quantum("sensor", self.quantum)
        _whole("sensor", "delay", self.delay, 0)
        _whole("sensor", "every", self.every, 1)


@dataclass(frozen=True)
class Actuator:
    """How a command becomes the plant's input: input = gain * rounded(clipped(command)), `delay` samples late.

    `lower`, `upper` and `quantum` (0: not rounded) are in the unit of the command, `gain` in units of
    the input per unit of the command. Before the first sample the command was `rest`, which is clipped
    and rounded too. Raises SimulationError for reversed limits, a negative quantum or delay.
    """

    lower: float = -math.inf
    upper: float = math.inf
    quantum: float = 0.0
    gain: float = 1.0
    delay: int = 0
    rest: float = 0.0

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise SimulationError(f"The actuator has limits [{self.lower:g}, {self.upper:g}]; give lower below upper.")
        _quantum("actuator", self.quantum)
        _whole("actuator", "delay", self.delay, 0)
        for name in ("gain", "rest"):
            if not math.isfinite(getattr(self, name)):
                raise SimulationError(f"The actuator's {name} is {getattr(self, name)}; give a finite number.")

    @classmethod
    def pwm(cls, supply: float, bits: int = 8, both_directions: bool = False, delay: int = 0) -> "Actuator":
        """Pulse-width modulation: commands in counts 0 .. 2**bits - 1, `supply` volts at the last.

        With `both_directions` from minus that on.
        """
        _whole("actuator", "bits", bits, 1)
        top = float(2**bits - 1)
        return cls(-top if both_directions else 0.0, top, 1.0, supply / top, delay)

    def drive(self, command: Any) -> Any:
        """The input of the plant for a command, without the delay."""
        return self.gain * rounded(jnp.clip(command, self.lower, self.upper), self.quantum)


def rounded(value: Any, quantum: float) -> Any:
    """The nearest multiple of `quantum` (halves to even); the value itself for quantum 0."""
    if quantum == 0:
        return value
    if quantum == 1:
        return jnp.round(value)
    return quantum * jnp.round(value / quantum)


def _quantum(what: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0):
        raise SimulationError(f"The {what}'s quantum is {value}; give a positive step, or 0 for no rounding.")


def _whole(what: str, name: str, value: int, low: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < low:
        raise SimulationError(f"The {what}'s {name} is {value!r}; give a whole number of at least {low}.")
