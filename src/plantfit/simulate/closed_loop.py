"""A sampled controller on a plant: sensor, controller, actuator and plant in one scan over the controller's samples.

At sample k, t = k * period: the sensor reads the output, the controller turns the measurement and the
reference into a command, the actuator into the input that the plant keeps until sample k + 1.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.simulate.linear import ExactStep, advance, exact_maps
from plantfit.simulate.sensors import Actuator, Sensor, delay_line, rounded
from plantfit.simulate.steppers import STEPPERS
from plantfit.simulate.structure import is_linear, output_reads_input
from plantfit.simulate.vector import VectorModel, vectorise

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer

EXACT = "exact"
UNROLL = 2  # samples per turn of the scan: halves the copies of the carry; more let XLA compute shared terms again


class Controller(NamedTuple):
    """A sampled controller as two pure functions.

    `init(measurement, parameters)` is its state at rest at the first measurement;
    `update(state, measurement, reference, parameters)` gives (state, command), once a sample.
    """

    init: Callable[[Any, Any], Any]
    update: Callable[[Any, Any, Any, Any], tuple[Any, Any]]


class Observer(NamedTuple):
    """A fold over the samples, for what is wanted without the trajectory.

    `init(y, reference)` at the first sample; `update(state, t, y, u, reference)` at every sample, the
    first too, gives the next state; `result(state)` is returned.
    """

    init: Callable[[Any, Any], Any]
    update: Callable[[Any, Any, Any, Any, Any], Any]
    result: Callable[[Any], Any]


class Trajectory(NamedTuple):
    """One closed loop, all (N,): times (s), controlled output, measurement, command, plant input, and the states by name."""

    t: Any
    y: Any
    measured: Any
    command: Any
    u: Any
    states: dict[str, Any]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Made by `closed_loop`. `simulate` and `observe` are pure and compiled once; `jax.vmap` batches them."""

    vector: VectorModel
    controller: Controller
    period: float
    sensor: Sensor
    actuator: Actuator
    output: int
    input: int
    stepper: str
    substeps: int
    _feedthrough: bool = field(default=False, repr=False)

    def simulate(
        self,
        controller: Any,
        plant: Mapping[str, Any],
        reference: Any,
        *,
        samples: int | None = None,
        x0: Mapping[str, Any] | None = None,
        inputs: Mapping[str, Any] | None = None,
        noise: Any = None,
    ) -> Trajectory:
        """The loop with the parameters `controller` (any pytree) and the named parameters `plant`.

        `reference` is (N,), or a scalar with `samples` = N. `x0` gives initial states by name (others 0),
        `inputs` every further input of the plant, scalar or (N,), held over each sample; `noise` (N,) is
        added to the output before the sensor rounds it.
        Raises SimulationError for names or shapes that do not fit.
        """
        dynamics, x, given, n = self._prepared(plant, reference, samples, x0, inputs, noise)
        return _trajectory(self, n, controller, dynamics, x, given)

    def observe(
        self,
        observer: Observer,
        controller: Any,
        plant: Mapping[str, Any],
        reference: Any,
        *,
        samples: int | None = None,
        x0: Mapping[str, Any] | None = None,
        inputs: Mapping[str, Any] | None = None,
        noise: Any = None,
    ) -> Any:
        """The same loop folded into `observer.result`; nothing is stored. Arguments as in `simulate`."""
        dynamics, x, given, n = self._prepared(plant, reference, samples, x0, inputs, noise)
        return _observed(self, observer, n, controller, dynamics, x, given)

    def _prepared(self, plant, reference, samples, x0, inputs, noise):
        vector, model = self.vector, self.vector.model
        missing = [name for name in vector.parameters if name not in plant]
        if missing:
            raise SimulationError(f"Plant {model.name!r}: no value for parameter {missing[0]!r}; it has {list(vector.parameters)}.")
        unknown = sorted(set(x0 or {}) - set(vector.states))
        if unknown:
            raise SimulationError(f"Plant {model.name!r} has no state {unknown[0]!r}; x0 may name {list(vector.states)}.")
        driven = vector.channels[self.input]
        others = [name for name in model.inputs if name != driven]
        for name in inputs or {}:
            if name not in others:
                raise SimulationError(f"inputs names {name!r}; besides {driven!r}, which the controller drives, the plant takes {others}.")
        for name in others:
            if name not in (inputs or {}):
                raise SimulationError(f"Plant {model.name!r} also takes the input {name!r}; give it in inputs, 0 if it rests.")
        given = {"reference": jnp.asarray(reference, dtype=float)} | {
            f"input {k}": jnp.asarray(v, dtype=float) for k, v in (inputs or {}).items()
        }
        if noise is not None:
            given["noise"] = jnp.asarray(noise, dtype=float)
        n = _length(given, samples)
        p = tuple(jnp.asarray(plant[name], dtype=float) for name in vector.parameters)
        x = tuple(jnp.asarray((x0 or {}).get(name, 0.0), dtype=float) for name in vector.states)
        return self._dynamics(p), x, given, n

    def _dynamics(self, p) -> "_Dynamics":
        if self.stepper != EXACT:
            return _Dynamics(p, None)
        if any(isinstance(v, Tracer) for v in p):
            return _Dynamics(p, _maps(self.vector, p, self.period))
        # numbers known now are exponentiated now, not in every call of a program compiled around this one
        with jax.ensure_compile_time_eval():
            return _Dynamics(p, _maps(self.vector, p, self.period))

    def _channels(self, u, row, t):
        """All channels of the plant, in its order."""
        names = self.vector.channels[:-1]
        return (*(u if i == self.input else row[f"input {name}"] for i, name in enumerate(names)), t)

    def _read(self, x, u, row, t, p):
        return self.vector.output(x, self._channels(u, row, t), p)[self.output]

    def _advance(self, dynamics: "_Dynamics") -> Callable:
        """`advance(x, u, row, t) -> x` over one controller sample."""
        return self._stepped(dynamics.p) if dynamics.maps is None else self._exact(dynamics.maps)

    def _exact(self, maps: ExactStep) -> Callable:
        without_time = maps._replace(start=maps.start[:, :-1])

        def exact(x, u, row, t):
            if self.vector.uses_time:
                return advance(maps, x, self._channels(u, row, t), self._channels(u, row, t + self.period))
            return advance(without_time, x, self._channels(u, row, t)[:-1], ())

        return exact

    def _stepped(self, p) -> Callable:
        step, h, varying = STEPPERS[self.stepper], self.period / self.substeps, self.vector.uses_time

        def stepped(x, u, row, t):
            def one(j, x):
                begin = t + h * j
                return step(self.vector.rate, x, self._channels(u, row, begin), self._channels(u, row, begin + h), h, p, varying)

            return lax.fori_loop(0, self.substeps, one, x, unroll=self.substeps <= 4)

        return stepped


class _Dynamics(NamedTuple):
    p: tuple[Any, ...]
    maps: ExactStep | None  # over one period, for the stepper "exact"


@partial(jax.jit, static_argnums=0)
def _maps(vector: VectorModel, p: tuple[Any, ...], period: float) -> ExactStep:
    return exact_maps(vector, p, period, varying=vector.uses_time)


def closed_loop(
    model: Model | VectorModel,
    controller: Controller,
    *,
    period: float,
    output: str | None = None,
    input: str | None = None,
    sensor: Sensor = Sensor(),  # noqa: B008  (frozen)
    actuator: Actuator = Actuator(),  # noqa: B008  (frozen)
    stepper: str = "auto",
    substeps: int = 10,
) -> ClosedLoop:
    """Close the loop from `output` to `input` of a plant (needed only where it has several) every `period` seconds.

    `stepper` "exact" takes the matrix exponential over the period, for plants linear in states and
    inputs; "rosenbrock" and "rk4" take `substeps` steps a period; "auto" is "exact" where possible, else
    "rosenbrock".
    Raises SimulationError for an unknown name, a period or substeps that are not positive, "exact" on
    a plant that is not linear, or a plant with dead time of its own.
    """
    vector = vectorise(model) if isinstance(model, Model) else model
    plant = vector.model
    if not (np.isfinite(period) and period > 0):
        raise SimulationError(f"period = {period}; give the controller's sampling period in seconds, above 0.")
    if isinstance(substeps, bool) or not isinstance(substeps, int) or substeps < 1:
        raise SimulationError(f"substeps = {substeps!r}; give a whole number of at least 1.")
    if not vector.states:
        raise SimulationError(f"Plant {plant.name!r} has no states; a closed loop needs a plant with dynamics.")
    if plant.delays:
        raise SimulationError(
            f"Plant {plant.name!r} delays {plant.delays[0].input!r} by a parameter; take that delay out of the plant "
            "and give it to the actuator as whole samples."
        )
    place_out, place_in = _place(plant, "output", output, vector.outputs), _place(plant, "input", input, tuple(plant.inputs))
    return ClosedLoop(
        vector,
        controller,
        float(period),
        sensor,
        actuator,
        place_out,
        place_in,
        _stepper(vector, stepper),
        substeps,
        output_reads_input(vector),
    )


def _place(plant: Model, what: str, name: str | None, names: tuple[str, ...]) -> int:
    if name is None and len(names) == 1:
        return 0
    if name not in names:
        said = "none was named" if name is None else f"{name!r} is not one of them"
        raise SimulationError(f"Plant {plant.name!r} has the {what}s {list(names)} and {said}; say which one closes the loop.")
    return names.index(name)


def _stepper(vector: VectorModel, stepper: str) -> str:
    if stepper not in ("auto", EXACT, *STEPPERS):
        raise SimulationError(f"Stepper {stepper!r} is unknown; use one of {['auto', EXACT, *sorted(STEPPERS)]}.")
    if stepper not in ("auto", EXACT):
        return stepper
    if is_linear(vector):
        return EXACT
    if stepper == EXACT:
        raise SimulationError(
            f"Plant {vector.model.name!r} is not linear in its states and inputs, so it has no exact hold; "
            "use stepper 'rosenbrock' or 'rk4' with substeps."
        )
    return "rosenbrock"


def _length(given: dict[str, Any], samples: int | None) -> int:
    lengths = {name: a.shape[0] for name, a in given.items() if a.ndim == 1}
    wrong = [name for name, a in given.items() if a.ndim > 1]
    if wrong:
        raise SimulationError(f"The {wrong[0]} has shape {given[wrong[0]].shape}; give (N,), or batch with jax.vmap.")
    if samples is None and not lengths:
        raise SimulationError("The reference is one number; give samples = N, or a reference for every sample.")
    n = samples if samples is not None else next(iter(lengths.values()))
    if n < 1:
        raise SimulationError(f"samples = {n}; simulate at least one.")
    for name, length in lengths.items():
        if length != n:
            raise SimulationError(f"The {name} has {length} values for {n} samples; give one for each.")
    return n


# -- the scan -------------------------------------------------------------------------------------


def _body(loop: ClosedLoop, controller: Any, dynamics: _Dynamics, constant: dict[str, Any]):
    """`begin(x, row)` -> (carry, y) and `sample(carry, k, t, row)` -> (carry, (y, measured, command, u))."""
    sensor, actuator = loop.sensor, loop.actuator
    sensor_line, actuator_line = delay_line(sensor.delay), delay_line(actuator.delay)
    p, advance = dynamics.p, loop._advance(dynamics)

    def sense(y, row):
        return rounded(y + row["noise"] if "noise" in row else y, sensor.quantum)

    def begin(x, row):
        row = constant | row
        u = actuator.drive(jnp.asarray(actuator.rest))
        y = loop._read(x, u, row, 0.0, p)
        first = sense(y, row)
        held = first if sensor.every > 1 else ()
        state = loop.controller.init(first, controller)
        kept = u if loop._feedthrough else ()
        return (x, state, sensor_line.begin(first), actuator_line.begin(u), held, kept), y

    def sample(carry, k, t, row):
        row = constant | row
        x, state, sensed, acted, held, kept = carry
        y = loop._read(x, kept if loop._feedthrough else 0.0, row, t, p)
        fresh = sense(y, row)
        if sensor.every > 1:
            held = fresh = jnp.where(k % sensor.every == 0, fresh, held)
        sensed, measured = sensor_line.push(sensed, k, fresh)
        state, command = loop.controller.update(state, measured, row["reference"], controller)
        acted, u = actuator_line.push(acted, k, actuator.drive(command))
        after = advance(x, u, row, t)
        kept = u if loop._feedthrough else ()
        return (after, state, sensed, acted, held, kept), (y, measured, command, u)

    return begin, sample


def _split(given: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Signals that stay, and those that change from sample to sample."""
    return {k: v for k, v in given.items() if v.ndim == 0}, {k: v for k, v in given.items() if v.ndim == 1}


@partial(jax.jit, static_argnums=(0, 1))
def _trajectory(loop: ClosedLoop, n: int, controller, dynamics: _Dynamics, x, given) -> Trajectory:
    constant, moving = _split(given)
    begin, sample = _body(loop, controller, dynamics, constant)
    carry, _ = begin(x, {k: v[0] for k, v in moving.items()})

    def step(carry, row):
        after, seen = lax.optimization_barrier(sample(carry, *row))
        return after, (carry[0], seen)

    k = jnp.arange(n)
    t = k * loop.period
    _, (states, (y, measured, command, u)) = _scan(step, carry, (k, t, moving))
    return Trajectory(t, y, measured, command, u, dict(zip(loop.vector.states, states, strict=True)))


@partial(jax.jit, static_argnums=(0, 1, 2))
def _observed(loop: ClosedLoop, observer: Observer, n: int, controller, dynamics: _Dynamics, x, given):
    constant, moving = _split(given)
    begin, sample = _body(loop, controller, dynamics, constant)
    first = {k: v[0] for k, v in moving.items()}
    carry, y = begin(x, first)
    seen = observer.init(y, (constant | first)["reference"])

    def step(both, row):
        (carry, seen), (k, t, row) = both, row
        # kept apart from what observes it, the loop has the same last bits as in `simulate`
        carry, (y, _, _, u) = lax.optimization_barrier(sample(carry, k, t, row))
        return (carry, observer.update(seen, t, y, u, (constant | row)["reference"])), None

    k = jnp.arange(n)
    (_, seen), _ = _scan(step, (carry, seen), (k, k * loop.period, moving))
    return observer.result(seen)


def _scan(step: Callable, carry, rows):
    """`lax.scan`, with the samples kept apart so that XLA does not compute one again inside the next."""

    def apart(carry, row):
        return step(lax.optimization_barrier(carry), row)

    strong = jax.tree.map(lambda a: lax.convert_element_type(a, jnp.asarray(a).dtype), carry)  # types that do not change
    return lax.scan(apart, strong, rows, unroll=UNROLL)
