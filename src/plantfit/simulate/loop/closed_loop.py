"""A sampled controller on a plant: sensors, controller, actuators and plant in one scan over the controller's samples.

At sample k, t = k * period: the sensors read the outputs, the controller turns measurements and
reference into commands, the actuators into the inputs that the plant keeps until sample k + 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.simulate.loop.controller import Controller, Observer, Trajectory
from plantfit.simulate.loop.dead_time import dead_times_of
from plantfit.simulate.loop.held_plant import Dynamics, HeldPlant, chosen_stepper
from plantfit.simulate.loop.loop_scan import SampledLoop, observed, trajectory
from plantfit.simulate.loop.loop_signals import Given, Rows, length, rows_of
from plantfit.simulate.loop.sensors import Actuator, Sensor
from plantfit.simulate.steps.structure import output_reads_delayed, output_reads_input
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax.numpy as jnp

__all__ = ["ClosedLoop", "Controller", "Observer", "Trajectory", "closed_loop"]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Made by `closed_loop`. `simulate` and `observe` are pure and compiled once; `jax.vmap` batches them."""

    parts: SampledLoop

    @property
    def period(self) -> float:
        """Seconds between samples."""
        return self.parts.plant.period

    @property
    def stepper(self) -> str:
        """What moves the plant on: "exact", or a stepper of `simulate.steps.registry`."""
        return self.parts.plant.stepper

    def simulate(self, controller: Any, plant: Mapping[str, Any], reference: Any, **given: Unpack[Given]) -> Trajectory:
        """The loop with the parameters `controller` (any pytree) and the named parameters `plant`.

        `reference` is (N,), a scalar with `samples` = N, or a mapping from names to such, {} for none;
        `given` may hold samples, x0, inputs and noise (`Given`).
        Raises SimulationError for names or shapes that do not fit.
        """
        dynamics, x, rows, n = self._prepared(plant, reference, **given)
        return trajectory(self.parts, n, controller, dynamics, x, rows)

    def observe(
        self, observer: Observer, controller: Any, plant: Mapping[str, Any], reference: Any, **given: Unpack[Given]
    ) -> Any:
        """The same loop folded into `observer.result`; nothing is stored. Arguments as in `simulate`."""
        dynamics, x, rows, n = self._prepared(plant, reference, **given)
        return observed(self.parts, observer, n, controller, dynamics, x, rows)

    def _prepared(
        self, plant, reference, samples=None, x0=None, inputs=None, noise=None
    ) -> tuple[Dynamics, tuple[Any, ...], Rows, int]:
        vector, model, loop = self.parts.plant.vector, self.parts.plant.vector.model, self.parts
        missing = [name for name in vector.parameters if name not in plant]
        if missing:
            raise SimulationError(
                f"Plant {model.name!r}: no value for parameter {missing[0]!r}; it has {list(vector.parameters)}."
            )
        unknown = sorted(set(x0 or {}) - set(vector.states))
        if unknown:
            raise SimulationError(
                f"Plant {model.name!r} has no state {unknown[0]!r}; x0 may name {list(vector.states)}."
            )
        others = [name for name in model.inputs if name not in loop.inputs]
        for name in inputs or {}:
            if name not in others:
                driven = ", ".join(map(repr, loop.inputs))
                raise SimulationError(
                    f"inputs names {name!r}; besides {driven}, which the controller drives, the plant takes {others}."
                )
        for name in others:
            if name not in (inputs or {}):
                raise SimulationError(
                    f"Plant {model.name!r} also takes the input {name!r}; give it in inputs, 0 if it rests."
                )
        rows = rows_of(reference, inputs or {}, noise, loop.outputs)
        n = length(rows, samples)
        p = tuple(jnp.asarray(plant[name], dtype=float) for name in vector.parameters)
        x = tuple(jnp.asarray((x0 or {}).get(name, 0.0), dtype=float) for name in vector.states)
        if loop.plant.dead is not None:
            loop.plant.dead.check(model, p)
        return loop.plant.dynamics(p), x, rows, n


def closed_loop(
    model: Model | VectorModel,
    controller: Controller,
    *,
    period: float,
    output: str | Sequence[str] | None = None,
    input: str | Sequence[str] | None = None,
    sensor: Sensor | Mapping[str, Sensor] = Sensor(),  # noqa: B008  (frozen)
    actuator: Actuator | Mapping[str, Actuator] = Actuator(),  # noqa: B008  (frozen)
    stepper: str = "auto",
    substeps: int = 10,
    longest_delay: float | None = None,
) -> ClosedLoop:
    """Close the loop from `output` to `input` of a plant (needed only where it has several) every `period` seconds.

    With a sequence of names the loop is over several signals: measurements or commands are mappings by
    name, and `sensor` or `actuator` is one for all or a mapping with one for each.

    `stepper` "exact" takes the matrix exponential over the period, for plants linear in states and
    inputs; "rosenbrock", "exponential" and "rk4" take `substeps` steps a period; "auto" is "exact" where
    possible, else "rosenbrock". Dead time of the plant's own is followed exactly, up to `longest_delay` s (the upper
    bound of its parameter where left out); where it is a table over the input, the input of now tells it. Raises
    SimulationError for an unknown name, a period or substeps that are not positive, "exact" on a plant that is not
    linear, or a plant with events or dry friction.
    """
    vector = vectorise(model) if isinstance(model, Model) else model
    plant = vector.model
    _check(plant, period, substeps)
    if output_reads_delayed(vector):
        raise SimulationError(
            f"Plant {plant.name!r}: an output reads a delayed input itself; let a state come between."
        )
    outputs, inputs = (
        _chosen(plant, "output", output, vector.outputs),
        _chosen(plant, "input", input, tuple(plant.inputs)),
    )
    places = tuple(vector.channels.index(name) for name in inputs)
    dead = dead_times_of(vector, inputs, float(period), longest_delay)
    held = HeldPlant(vector, float(period), places, chosen_stepper(vector, stepper, dead), substeps, dead)
    parts = SampledLoop(
        held,
        controller,
        outputs,
        inputs,
        _one_each("sensor", sensor, outputs, Sensor),
        _one_each("actuator", actuator, inputs, Actuator),
        single_output=output is None or isinstance(output, str),
        single_input=input is None or isinstance(input, str),
        feedthrough=output_reads_input(vector),
    )
    return ClosedLoop(parts)


def _check(plant: Model, period: float, substeps: int) -> None:
    if not (np.isfinite(period) and period > 0):
        raise SimulationError(f"period = {period}; give the controller's sampling period in seconds, above 0.")
    if isinstance(substeps, bool) or not isinstance(substeps, int) or substeps < 1:
        raise SimulationError(f"substeps = {substeps!r}; give a whole number of at least 1.")
    if not plant.states:
        raise SimulationError(f"Plant {plant.name!r} has no states; a closed loop needs a plant with dynamics.")
    if not plant.smooth:
        raise SimulationError(
            f"Plant {plant.name!r} has events, dry friction, backlash or late states, which a closed "
            "loop does not follow; give it smooth equations, such as tanh(w/w0) for friction."
        )


def _chosen(plant: Model, what: str, chosen: str | Sequence[str] | None, names: tuple[str, ...]) -> tuple[str, ...]:
    if chosen is None and len(names) == 1:
        return names
    wanted = (chosen,) if chosen is None or isinstance(chosen, str) else tuple(chosen)
    for name in wanted or (None,):
        if name not in names:
            said = "none was named" if name is None else f"{name!r} is not one of them"
            raise SimulationError(
                f"Plant {plant.name!r} has the {what}s {list(names)} and {said}; say which one closes the loop."
            )
    if len(set(wanted)) < len(wanted):
        raise SimulationError(f"The loop has the {what}s {list(wanted)}; name each once.")
    return tuple(str(name) for name in wanted)


def _one_each(what: str, given: Any, names: tuple[str, ...], kind: type) -> tuple[Any, ...]:
    """One sensor or actuator for each name."""
    if isinstance(given, kind):
        return (given,) * len(names)
    if not isinstance(given, Mapping) or set(given) != set(names):
        said = f"names {sorted(given)}" if isinstance(given, Mapping) else f"is {given!r}"
        raise SimulationError(f"{what} {said}; give one {kind.__name__} for all, or one for each of {list(names)}.")
    return tuple(given[name] for name in names)
