"""The scan of a closed loop: sensors, controller, actuators and plant, sample after sample."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.loop.controller import Controller, Observer, Trajectory
from plantfit.simulate.loop.held_plant import WHOLE, Dynamics, HeldPlant
from plantfit.simulate.loop.loop_signals import Rows, noise_in, reference_in, split
from plantfit.simulate.loop.sensors import Actuator, Sensor, delay_line, rounded

import jax
import jax.numpy as jnp
from jax import lax

UNROLL = 2  # samples per turn of the scan: halves the copies of the carry; more let XLA compute shared terms again


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """The parts of a closed loop; `single_output`, `single_input` say that the controller sees scalars, not
    mappings."""

    plant: HeldPlant
    controller: Controller
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    sensors: tuple[Sensor, ...]
    actuators: tuple[Actuator, ...]
    single_output: bool
    single_input: bool
    feedthrough: bool

    def seen(self, values: tuple[Any, ...]) -> Any:
        """Outputs as the controller sees them."""
        return values[0] if self.single_output else dict(zip(self.outputs, values, strict=True))

    def driven(self, values: tuple[Any, ...]) -> Any:
        """Inputs in the form of the command."""
        return values[0] if self.single_input else dict(zip(self.inputs, values, strict=True))

    def commands(self, command: Any) -> tuple[Any, ...]:
        """The controller's command as one value for each input; raises SimulationError where it does not fit."""
        if isinstance(command, Mapping):
            if set(command) != set(self.inputs):
                raise SimulationError(
                    f"The controller commands {sorted(command)}; the loop drives {list(self.inputs)}."
                )
            return tuple(command[name] for name in self.inputs)
        if len(self.inputs) > 1:
            raise SimulationError(
                f"The controller commands one number; give a mapping with a number for each of {list(self.inputs)}."
            )
        return (command,)


def _body(loop: SampledLoop, controller: Any, dynamics: Dynamics, constant: Rows):
    """`begin(x, row)` -> (carry, y) and `sample(carry, k, t, row)` -> (carry, (y, measured, command, u)), signals as
    tuples."""
    sensors, actuators, p = loop.sensors, loop.actuators, dynamics.p
    sensor_lines, actuator_lines = [delay_line(s.delay) for s in sensors], [delay_line(a.delay) for a in actuators]
    places = tuple(loop.plant.vector.outputs.index(name) for name in loop.outputs)
    nothing, advance = (0.0,) * len(actuators), loop.plant.advance(dynamics)

    def read(x, u, row, t):
        every = loop.plant.outputs(x, u, row, t, p)
        return tuple(every[i] for i in places)

    def sense(y, row):
        noises = [noise_in(row, name, len(loop.outputs) == 1) for name in loop.outputs]
        return tuple(rounded(v if e is None else v + e, s.quantum) for v, e, s in zip(y, noises, sensors, strict=True))

    def begin(x, row):
        row = constant | row
        u = tuple(a.drive(jnp.asarray(a.rest)) for a in actuators)
        y = read(x, u, row, 0.0)
        first = sense(y, row)
        held = tuple(v if s.every > 1 else () for v, s in zip(first, sensors, strict=True))
        state = loop.controller.init(loop.seen(first), controller)
        sensed = tuple(line.begin(v) for line, v in zip(sensor_lines, first, strict=True))
        acted = tuple(line.begin(v) for line, v in zip(actuator_lines, u, strict=True))
        past = () if loop.plant.dead is None else loop.plant.dead.begin(u)
        return (x, state, sensed, acted, held, u if loop.feedthrough else (), past), y

    def measure(k, fresh, sensed, held):
        """(measured, sensed, held) as the sensors give them at sample k."""
        rows = []
        for sensor, line, value, late, last in zip(sensors, sensor_lines, fresh, sensed, held, strict=True):
            if sensor.every > 1:
                last = value = jnp.where(k % sensor.every == 0, value, last)
            late, measured = line.push(late, k, value)
            rows.append((measured, late, last))
        return zip(*rows, strict=True)

    def act(k, command, acted):
        """(acted, u) as the actuators give them at sample k."""
        pairs = [
            line.push(late, k, actuator.drive(value))
            for actuator, line, value, late in zip(actuators, actuator_lines, command, acted, strict=True)
        ]
        return zip(*pairs, strict=True)

    def sample(carry, k, t, row):
        row = constant | row
        x, state, sensed, acted, held, kept, past = carry
        y = read(x, kept if loop.feedthrough else nothing, row, t)
        measured, sensed, held = measure(k, sense(y, row), sensed, held)
        state, command = loop.controller.update(state, loop.seen(measured), reference_in(row), controller)
        command = loop.commands(command)
        acted, u = act(k, command, acted)
        past, pieces = (past, WHOLE) if loop.plant.dead is None else loop.plant.dead.push(past, k, u, p)
        after = advance(x, u, row, t, pieces)
        return (after, state, sensed, acted, held, u if loop.feedthrough else (), past), (y, measured, command, u)

    return begin, sample


@partial(jax.jit, static_argnums=(0, 1))
def trajectory(
    loop: SampledLoop, n: int, controller: Any, dynamics: Dynamics, x: tuple[Any, ...], rows: Rows
) -> Trajectory:
    """All signals at `n` samples."""
    constant, moving = split(rows)
    begin, sample = _body(loop, controller, dynamics, constant)
    carry, _ = begin(x, {k: v[0] for k, v in moving.items()})

    def step(carry, row):
        after, seen = lax.optimization_barrier(sample(carry, *row))
        return after, (carry[0], seen)

    k = jnp.arange(n)
    t = k * loop.plant.period
    _, (states, (y, measured, command, u)) = _scan(step, carry, (k, t, moving))
    named = dict(zip(loop.plant.vector.states, states, strict=True))
    return Trajectory(t, loop.seen(y), loop.seen(measured), loop.driven(command), loop.driven(u), named)


@partial(jax.jit, static_argnums=(0, 1, 2))
def observed(
    loop: SampledLoop, observer: Observer, n: int, controller: Any, dynamics: Dynamics, x: tuple[Any, ...], rows: Rows
) -> Any:
    """The result of the observer after `n` samples."""
    constant, moving = split(rows)
    begin, sample = _body(loop, controller, dynamics, constant)
    first = {k: v[0] for k, v in moving.items()}
    carry, y = begin(x, first)
    seen = observer.init(loop.seen(y), reference_in(constant | first))

    def step(both, row):
        (carry, seen), (k, t, row) = both, row
        # kept apart from what observes it, the loop has the same last bits as in `trajectory`
        carry, (y, _, _, u) = lax.optimization_barrier(sample(carry, k, t, row))
        return (carry, observer.update(seen, t, loop.seen(y), loop.driven(u), reference_in(constant | row))), None

    k = jnp.arange(n)
    (_, seen), _ = _scan(step, (carry, seen), (k, k * loop.plant.period, moving))
    return observer.result(seen)


def _scan(step: Callable, carry, rows):
    """`lax.scan`, with the samples kept apart so that XLA does not compute one again inside the next."""

    def apart(carry, row):
        return step(lax.optimization_barrier(carry), row)

    # types that do not change
    strong = jax.tree.map(lambda a: lax.convert_element_type(a, jnp.asarray(a).dtype), carry)
    return lax.scan(apart, strong, rows, unroll=UNROLL)
