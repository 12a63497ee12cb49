"""One output of a model and one input that drives it: where it rests, its matrices there with dead time kept apart,
its loop."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from plantfit.control.rests.equations import Equations
from plantfit.control.rests.search import at_level, settled_range
from plantfit.errors import SimulationError
from plantfit.models.model import Declared, Model, Named
from plantfit.runtime import jit
from plantfit.simulate.loop.closed_loop import ClosedLoop, Controller, closed_loop
from plantfit.simulate.loop.sensors import Sensor
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax
import jax.numpy as jnp

LOAD, REST, LEVEL = "load at the input", "input at rest", "level"
SUBSTEPS = 4  # of a period, where the model is not linear
POINTS = 3  # at which derivatives tell what a state reaches


@dataclass(frozen=True, eq=False)
class Rest:
    """Where each of n plants rests at one level of the output, and its matrices there.

    x (n, S) states; u (n,) input, NaN where none holds the level. A (n, s, s), C (n, s), D (n,) of the s states that
    reach the output; B (n, c, s) one row for each of the c ways that the input takes, at once or `late` (n, c) seconds.
    """

    x: np.ndarray
    u: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    late: np.ndarray


@partial(jit, static_argnums=0)
def _local(key: Equations, x: Any, u: Any, rows: Any) -> Any:
    """A, B, C, D of every plant."""

    def one(x, u, p):
        each = jnp.full(len(key.ways), u)
        a, b = jax.jacfwd(key.rate, (0, 1))(x, each, p)
        c, d = jax.jacfwd(key.out, (0, 1))(x, each, p)
        return a, b.T, c, d[0]

    return jax.vmap(one)(x, u, rows)


class _Same:
    """A model that is equal to itself alone, so that what is made of it can be found again."""

    def __init__(self, model: Model):
        self.model = model

    def __hash__(self) -> int:
        return id(self.model)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.model is self.model


@lru_cache(maxsize=32)  # one identity for a model, so that it is compiled once
def _vector(key: _Same) -> VectorModel:
    return vectorise(key.model)


@dataclass(frozen=True, eq=False)
class OneLoop:
    """`output` of a model, driven by `input`, the other inputs held at `others`; parameters of n plants by name, the
    first the best fit; `inner` is the output that the inner loop of a cascade measures.

    Raises SimulationError for a model without states or one that is not smooth.
    """

    model: Model
    output: str
    input: str
    others: Mapping[str, float]
    plants: Mapping[str, np.ndarray]
    inner: str | None = None

    def __post_init__(self) -> None:
        if not self.model.states:
            raise SimulationError(
                f"The model {self.model.name!r} is static: nothing in it takes time, so there is no loop to tune."
            )
        if not self.model.smooth:
            raise SimulationError(
                f"The model {self.model.name!r} has events, dry friction, backlash or late states, which a tuned "
                "loop does not follow; identify it with smooth equations, such as smooth_sign(w, w0) for friction."
            )
        late = [d.input for d in self.model.delays if d.input != self.input]
        if late:
            raise SimulationError(
                f"The model {self.model.name!r} delays {late[0]!r}, which this loop holds; "
                f"choose {late[0]!r} as the input, or identify a model without that delay."
            )

    @property
    def count(self) -> int:
        """How many plants there are, n."""
        return len(next(iter(self.plants.values())))

    @cached_property
    def vector(self) -> VectorModel:
        return _vector(_Same(self.model))

    @cached_property
    def key(self) -> "Equations":
        """What is compiled once for all plants of one loop."""
        ways = tuple(self.vector.channels.index(n) for n in (self.input, *(d.channel for d in self.model.delays)))
        held = tuple(float(self.others.get(n, 0.0)) for n in self.vector.channels)
        measured = [self.vector.outputs.index(n) for n in (self.output, self.inner) if n is not None]
        plain = Equations(self.vector, ways, held, measured[0])
        patterns = [self._pattern(replace(plain, output=k)) for k in measured]
        return replace(plain, kept=tuple(np.flatnonzero(np.any(patterns, axis=0)).tolist()))

    def _pattern(self, key: Equations) -> np.ndarray:
        """Which states (s,) reach an output: by the derivatives at a few points that no symmetry picks."""
        n, rng = len(self.vector.states), np.random.default_rng(0)
        x, u = 1.0 + rng.random((POINTS, n)), 1.0 + rng.random(POINTS)
        p = tuple(jnp.broadcast_to(v[:1], (POINTS, *v.shape[1:])) for v in self._p(self.plants))
        # not a number counts as something
        a, _, c, _ = (np.any(np.asarray(v) != 0, axis=0) for v in _local(key, x, u, p))
        seen = c
        for _ in range(n):
            seen = seen | np.any(a & seen[:, None], axis=0)
        return seen

    @property
    def followed(self) -> tuple[str, ...]:
        """The states of the matrices: those that reach an output that is measured."""
        return tuple(self.vector.states[i] for i in self.key.kept)

    def part(self, rows: Any) -> "OneLoop":
        """The same of some of the plants."""
        found = replace(self, plants={n: np.asarray(v)[rows] for n, v in self.plants.items()})
        found.__dict__.update(vector=self.vector, key=self.key)  # compiled functions are found by them
        return found

    def _p(self, plants: Mapping[str, Any]) -> tuple[Any, ...]:
        return tuple(jnp.asarray(plants[n], dtype=float) for n in self.vector.parameters)

    def at_rest(self, level: float, inputs: tuple[float, ...]) -> Rest:
        """Every plant at rest where its output is `level`, by Newton's method begun at each of the `inputs`, and all
        over their range where that fails; of several the one nearest to the middle of them."""
        n = len(self.vector.states)
        begin = np.stack([np.append(self._start(level, u), u) for u in inputs])
        z = at_level(self.key, begin, level, self._p(self.plants))
        return self._matrices(z[:, :n], z[:, n])

    def settled_range(self, level: float, lower: float, upper: float) -> tuple[float, float] | None:
        """The lowest and highest output at which the first plant settles under constant inputs within limits, begun
        near the level; None where it does not settle under all of them, as an integrating one."""
        start, row = self._start(level, 0.5 * (lower + upper)), tuple(v[:1] for v in self._p(self.plants))
        return settled_range(self.key, start, lower, upper, row)

    def _start(self, level: float, u: float) -> np.ndarray:
        """States to begin the search of a rest from: those that the model begins with where it measures the level."""
        states = self.vector.states
        if self.model.initial_state is None:
            return np.array([level if s == self.output else 0.0 for s in states])
        p = {n: jnp.asarray(v[0], dtype=float) for n, v in self.plants.items()}
        given = {n: jnp.asarray(u if n == self.input else self.others.get(n, 0.0)) for n in self.model.inputs}
        measured = {n: jnp.asarray(level if n == self.output else 0.0) for n in self.vector.outputs}
        found = self.model.initial_state(p, given, measured)
        return np.nan_to_num(np.array([float(found[s]) for s in states]))

    def _matrices(self, x: np.ndarray, u: np.ndarray) -> Rest:
        a, b, c, d = (np.asarray(v) for v in _local(self.key, x, u, self._p(self.plants)))
        own = np.array(self.key.kept)
        return Rest(x, u, a[:, own[:, None], own], b[..., own], c[:, own], d, self._late(u))

    def _late(self, u: np.ndarray) -> np.ndarray:
        """Seconds (n, c) of every way of the input."""
        columns = [np.zeros(self.count)]
        for delay in self.model.delays:
            values = np.asarray(self.plants[delay.parameter], dtype=float)
            table = next((t for t in self.model.tables if t.name == delay.parameter), None)
            columns.append(
                values if table is None else np.asarray(jax.vmap(table)(jnp.asarray(values), jnp.asarray(u)))
            )
        return np.stack(columns, axis=1)

    def through(self, rest: Rest) -> np.ndarray:
        """How the output follows every way of the input at once (n, c), in its own time; `Rest.D` is the first of
        them."""

        def one(x: Any, u: Any, p: Any) -> Any:
            return jax.jacfwd(self.key.out, 1)(x, jnp.full(len(self.key.ways), u), p)

        return np.asarray(jax.vmap(one)(rest.x, rest.u, self._p(self.plants)))

    def of_inner(self, rest: Rest) -> Rest:
        """The same rest with the matrices to the inner output, of the states that reach it."""
        assert self.inner is not None
        key = replace(self.key, output=self.vector.outputs.index(self.inner))
        a, b, c, d = (np.asarray(v) for v in _local(key, rest.x, rest.u, self._p(self.plants)))
        own = np.flatnonzero(self._pattern(key))
        return replace(rest, A=a[:, own[:, None], own], B=b[..., own], C=c[:, own], D=d)

    def inner_row(self, rest: Rest) -> np.ndarray:
        """How the inner output follows the states (n, s) of a rest."""
        assert self.inner is not None
        key = replace(self.key, output=self.vector.outputs.index(self.inner))
        return np.asarray(_local(key, rest.x, rest.u, self._p(self.plants))[2])[:, np.array(self.key.kept)]

    def inner_level(self, rest: Rest) -> float:
        """The inner output of the first plant at rest."""
        assert self.inner is not None
        key = replace(self.key, output=self.vector.outputs.index(self.inner))
        p = tuple(v[0] for v in self._p(self.plants))
        return float(key.out(rest.x[0], np.full(len(key.ways), rest.u[0]), p))

    def longest(self) -> float:
        """The longest dead time (s) of all plants, anywhere in a table of it."""
        times = [float(np.max(self.plants[d.parameter])) for d in self.model.delays]
        return max([0.0, *times])

    def closed(
        self, controller: Controller, period: float, quantum: float = 0.0, inner_quantum: float | None = None
    ) -> ClosedLoop:
        """The loop with the input counted from `REST`, a parameter, and `LOAD`, a further input that acts behind the
        dead time.

        Its reference is a mapping, whose `LEVEL` the controller follows. The same loop for plants of one model, so that
        what is compiled for it is used again; it keeps inputs for a power of two of samples, 16 at least, that is as
        long as the dead time. With an `inner_quantum` the controller measures {output: y, inner: v}.
        """
        longest = None
        if self.model.delays:
            longest = 2.0 ** max(4, math.ceil(math.log2(self.longest() / period + 1.0))) * period
        sensors = {self.output: Sensor(quantum=quantum)}
        if inner_quantum is not None:
            assert self.inner is not None
            sensors[self.inner] = Sensor(quantum=inner_quantum)
        return _closed(self.vector, tuple(sensors.items()), self.input, longest, controller, period)


@lru_cache(maxsize=32)
def _closed(
    vector: VectorModel,
    sensors: tuple[tuple[str, Sensor], ...],
    input_: str,
    longest: float | None,
    controller: Controller,
    period: float,
) -> ClosedLoop:
    model = vector.model
    places = [input_, *(d.channel for d in model.delays)]

    def moved(u: Named, p: Named) -> Named:
        return {**u, **{n: u[n] + p[REST] + u[LOAD] for n in places}}

    def derivative(x: Named, u: Named, p: Named) -> Named:
        assert model.derivative is not None
        return model.derivative(x, moved(u, p), p)

    def outputs(x: Named, u: Named, p: Named) -> Named:
        return model.output(x, moved(u, p), p)

    def update(state, measurement, reference, parameters):
        return controller.update(state, measurement, reference[LEVEL], parameters)

    unit = model.inputs[input_]
    driven = replace(
        model, derivative=derivative, output=outputs, inputs={**model.inputs, LOAD: unit},
        parameters=(*model.parameters,
        Declared(REST, unit)), initial_state=None, text=None,
    )  # fmt: skip
    names = tuple(name for name, _ in sensors)
    return closed_loop(
        driven, Controller(controller.init, update), period=period, output=names[0] if len(names) == 1 else names,
        input=input_,
        sensor=sensors[0][1] if len(names) == 1 else dict(sensors),
        longest_delay=longest, substeps=SUBSTEPS,
    )  # fmt: skip
