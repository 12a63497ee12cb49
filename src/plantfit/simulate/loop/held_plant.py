"""A plant between two samples of a controller: its inputs are held, its states move on by one period."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from plantfit.errors import SimulationError
from plantfit.runtime import jit
from plantfit.simulate.loop.dead_time import DeadTimes, Piece
from plantfit.simulate.steps.linear import ExactStep, advance, exact_maps
from plantfit.simulate.steps.registry import EXACT, FIXED, STEPPERS
from plantfit.simulate.steps.structure import is_linear
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer

WHOLE = (Piece(0.0, 1.0, {}),)  # a period of a plant without dead time


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
    dead: DeadTimes | None = None

    def dynamics(self, p: tuple[Any, ...]) -> Dynamics:
        """What `advance` needs of the parameters `p`."""
        if self.stepper != EXACT:
            return Dynamics(p, None)
        if any(isinstance(v, Tracer) for v in p):
            return Dynamics(p, _maps(self.vector, p, self._lengths(p)))
        # numbers known now are exponentiated now, not in every call of a program compiled around this one
        with jax.ensure_compile_time_eval():
            return Dynamics(p, _maps(self.vector, p, self._lengths(p)))

    def _lengths(self, p: tuple[Any, ...]) -> Any:
        """Seconds that an exact step takes: a number, or one for each piece that dead times cut a period into."""
        if self.dead is None:
            return self.period
        return self.period * jnp.diff(jnp.stack([jnp.asarray(e) for e in self.dead.edges(self.dead.shares(p, ())[1])]))

    def channels(self, u: tuple[Any, ...], row: dict[str, Any], t: Any, late: Mapping[int, Any]) -> tuple[Any, ...]:
        """All channels in the model's order: the driven ones from `u`, delayed ones from `late`, the others from
        `row`."""
        given = {**dict(zip(self.driven, u, strict=True)), **late}
        names = self.vector.channels[:-1]
        return (*(given[i] if i in given else row[f"input {name}"] for i, name in enumerate(names)), t)

    def outputs(
        self, x: tuple[Any, ...], u: tuple[Any, ...], row: dict[str, Any], t: Any, p: tuple[Any, ...]
    ) -> tuple[Any, ...]:
        """Every output of the model; outputs do not read delayed inputs."""
        late = {} if self.dead is None else {one.channel: 0.0 for one in self.dead.late}
        return self.vector.output(x, self.channels(u, row, t, late), p)

    def advance(self, dynamics: Dynamics) -> Callable:
        """`advance(x, u, row, t, pieces) -> x` over one period; `pieces` are those of its dead times, if any."""
        whole = self._stepped(dynamics.p) if dynamics.maps is None else None
        maps: Any = dynamics.maps

        def over_period(x, u, row, t, pieces):
            for j, piece in enumerate(pieces):
                begin, seconds = t + self.period * piece.begin, self.period * piece.length
                if whole is not None:
                    x = whole(x, u, row, begin, seconds, piece.late)
                else:
                    own = maps if self.dead is None else jax.tree.map(lambda a, j=j: a[j], maps)
                    x = self._exact(own)(x, u, row, begin, seconds, piece.late)
            return x

        return over_period

    def _exact(self, maps: ExactStep) -> Callable:
        without_time = maps._replace(start=maps.start[:, :-1])

        def exact(x, u, row, t, seconds, late):
            if self.vector.uses_time:
                return advance(maps, x, self.channels(u, row, t, late), self.channels(u, row, t + seconds, late))
            return advance(without_time, x, self.channels(u, row, t, late)[:-1], ())

        return exact

    def _stepped(self, p) -> Callable:
        step, varying = STEPPERS[self.stepper].step, self.vector.uses_time

        def stepped(x, u, row, t, seconds, late):
            h = seconds / self.substeps

            def one(j, x):
                begin = t + h * j
                return step(
                    self.vector.rate,
                    x,
                    self.channels(u, row, begin, late),
                    self.channels(u, row, begin + h, late),
                    h,
                    p,
                    varying,
                )

            return lax.fori_loop(0, self.substeps, one, x, unroll=self.substeps <= 4)

        return stepped


@partial(jit, static_argnums=0)
def _maps(vector: VectorModel, p: tuple[Any, ...], lengths: Any) -> ExactStep:
    return exact_maps(vector, p, lengths, varying=vector.uses_time)


def chosen_stepper(vector: VectorModel, stepper: str, dead: DeadTimes | None = None) -> str:
    """The stepper itself, or what "auto" means for this plant; raises SimulationError where it cannot work."""
    if stepper not in ("auto", EXACT, *FIXED):
        raise SimulationError(f"Stepper {stepper!r} is unknown; use one of {['auto', EXACT, *sorted(FIXED)]}.")
    if stepper not in ("auto", EXACT):
        return stepper
    moving = dead is not None and not dead.fixed
    if is_linear(vector) and not moving:
        return EXACT
    if stepper == EXACT:
        raise SimulationError(
            f"Plant {vector.model.name!r} is not linear in its states and "
            f"inputs{', or its dead time changes' if moving else ''}, "
            "so it has no exact hold; use stepper 'rosenbrock' or 'rk4' with substeps."
        )
    return "rosenbrock"
