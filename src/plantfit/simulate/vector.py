"""A model's named functions as functions of tuples of scalars, the form that the steppers use.

Tuples rather than stacked arrays: in a batch every state is then one contiguous array, and XLA
fuses a whole step into one loop.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.model import Model

import jax
import jax.numpy as jnp
from jax.extend.core import Var

Scalars = tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class VectorModel:
    """`rate(x, u, p)` and `output(x, u, p)` on tuples in the order of the names given here.

    `channels` are the inputs, then their delayed copies, then the delayed states, then "t".
    """

    model: Model
    states: tuple[str, ...]
    channels: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    rate: Callable[[Scalars, Scalars, Scalars], Scalars]
    output: Callable[[Scalars, Scalars, Scalars], Scalars]
    uses_time: bool
    pattern: tuple[tuple[bool, ...], ...]  # [i][j]: whether the rate of state i depends on state j


def vectorise(model: Model) -> VectorModel:
    """Turn named functions into positional ones; raises ModelError when they return the wrong names."""
    states, outputs = tuple(model.states), tuple(model.outputs)
    channels = (*model.inputs, *(d.channel for d in model.delays), *(d.channel for d in model.state_delays), "t")
    parameters = tuple(p.name for p in model.parameters)

    def named(x, u, p):
        return dict(zip(states, x, strict=True)), dict(zip(channels, u, strict=True)), dict(zip(parameters, p, strict=True))

    def rate(x, u, p):
        if model.derivative is None:
            return ()
        return _picked(model.derivative(*named(x, u, p)), states, model, "derivative")

    def output(x, u, p):
        return _picked(model.output(*named(x, u, p)), outputs, model, "output")

    reads = _dependencies(rate, (len(states), len(channels)), model)
    pattern = tuple(tuple(j in row for j in range(len(states))) for row in reads)
    time = len(states) + len(channels) - 1
    return VectorModel(model, states, channels, outputs, parameters, rate, output, any(time in row for row in reads), pattern)


def _picked(values, names, model, what):
    missing = [n for n in names if n not in values]
    if missing:
        raise ModelError(f"Model {model.name!r}: {what}(x, u, p) returned {sorted(values)}, without {missing[0]!r}; return every name.")
    return tuple(jnp.asarray(values[n], dtype=float) for n in names)


def _dependencies(function, sizes: tuple[int, int], model: Model) -> list[set[int]]:
    """For every result the positions of the states and channels, counted through, that it can depend on."""
    states, channels = sizes
    p = tuple(jnp.ones(d.shape) for d in model.parameters)
    jaxpr = jax.make_jaxpr(function)((1.0,) * states, (1.0,) * channels, p).jaxpr
    sources = {v: {i} for i, v in enumerate(jaxpr.invars[: states + channels])}

    def read(atom) -> set[int]:
        return sources.get(atom, set()) if isinstance(atom, Var) else set()

    for equation in jaxpr.eqns:
        found = set().union(*(read(v) for v in equation.invars))
        for v in equation.outvars:
            sources[v] = found
    return [read(v) for v in jaxpr.outvars]
