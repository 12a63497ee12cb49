"""A plant between two samples of a controller: its inputs are held, its states move on by one period."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.linear import ExactStep, advance, exact_maps
from plantfit.simulate.steppers import STEPPERS
from plantfit.simulate.structure import is_linear
from plantfit.simulate.vector import VectorModel

import jax
from jax import lax
from jax.core import Tracer

EXACT = "exact"


class Dynamics(NamedTuple):
    """A plant's numbers: parameters in the model's order and, for the stepper "exact", the maps over one period."""

    p: tuple[Any, ...]
    maps: ExactStep | None


@dataclass(frozen=True, eq=False)
class HeldPlant:
    """The plant of a closed loop; `driven` are the places of the channels that the controller drives."""

    vector: VectorModel
    period: float
    driven: tuple[int, ...]
    stepper: str
    substeps: int

    def dynamics(self, p: tuple[Any, ...]) -> Dynamics:
        """What `advance` needs of the parameters `p`."""
        if self.stepper != EXACT:
            return Dynamics(p, None)
        if any(isinstance(v, Tracer) for v in p):
            return Dynamics(p, _maps(self.vector, p, self.period))
        # numbers known now are exponentiated now, not in every call of a program compiled around this one
        with jax.ensure_compile_time_eval():
            return Dynamics(p, _maps(self.vector, p, self.period))

    def channels(self, u: tuple[Any, ...], row: dict[str, Any], t: Any) -> tuple[Any, ...]:
        """All channels in the model's order: the driven ones from `u`, the others from `row`."""
        driven = dict(zip(self.driven, u, strict=True))
        names = self.vector.channels[:-1]
        return (*(driven[i] if i in driven else row[f"input {name}"] for i, name in enumerate(names)), t)

    def outputs(self, x, u, row, t, p) -> tuple[Any, ...]:
        """Every output of the model."""
        return self.vector.output(x, self.channels(u, row, t), p)

    def advance(self, dynamics: Dynamics) -> Callable:
        """`advance(x, u, row, t) -> x` over one period."""
        return self._stepped(dynamics.p) if dynamics.maps is None else self._exact(dynamics.maps)

    def _exact(self, maps: ExactStep) -> Callable:
        without_time = maps._replace(start=maps.start[:, :-1])

        def exact(x, u, row, t):
            if self.vector.uses_time:
                return advance(maps, x, self.channels(u, row, t), self.channels(u, row, t + self.period))
            return advance(without_time, x, self.channels(u, row, t)[:-1], ())

        return exact

    def _stepped(self, p) -> Callable:
        step, h, varying = STEPPERS[self.stepper], self.period / self.substeps, self.vector.uses_time

        def stepped(x, u, row, t):
            def one(j, x):
                begin = t + h * j
                return step(self.vector.rate, x, self.channels(u, row, begin), self.channels(u, row, begin + h), h, p, varying)

            return lax.fori_loop(0, self.substeps, one, x, unroll=self.substeps <= 4)

        return stepped


@partial(jax.jit, static_argnums=0)
def _maps(vector: VectorModel, p: tuple[Any, ...], period: float) -> ExactStep:
    return exact_maps(vector, p, period, varying=vector.uses_time)


def chosen_stepper(vector: VectorModel, stepper: str) -> str:
    """The stepper itself, or what "auto" means for this plant; raises SimulationError where it cannot work."""
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
