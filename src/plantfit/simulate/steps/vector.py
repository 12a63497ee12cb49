"""A model's named functions as functions of tuples of scalars, the form that the steppers use.

Tuples rather than stacked arrays: in a batch every state is then one contiguous array, and XLA
fuses a whole step into one loop.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.model import Model
from plantfit.models.parts.tables import shared_lookups
from plantfit.simulate.steps.dependencies import dependencies

import jax
import jax.numpy as jnp
from jax.core import Tracer

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
    uses_time: bool  # whether anything that moves the states reads t: rates, events, friction, play
    rate_uses_time: bool
    timed_events: bool  # whether the moment of an event depends on time alone (see `simulate.steps.times`)
    pattern: tuple[tuple[bool, ...], ...]  # [i][j]: whether the rate of state i depends on state j


def vectorise(model: Model) -> VectorModel:
    """Turn named functions into positional ones; raises ModelError when they return the wrong names."""
    states, outputs = tuple(model.states), tuple(model.outputs)
    channels = (*model.inputs, *(d.channel for d in model.delays), *(d.channel for d in model.state_delays), "t")
    parameters = tuple(p.name for p in model.parameters)

    def named(x, u, p):
        return (
            dict(zip(states, x, strict=True)),
            dict(zip(channels, u, strict=True)),
            dict(zip(parameters, p, strict=True)),
        )

    def functions(share):
        def rate(x, u, p):
            if model.derivative is None:
                return ()
            with shared_lookups(share):
                return _picked(model.derivative(*named(x, u, p)), states, model, "derivative")

        def output(x, u, p):
            with shared_lookups(share):
                return _picked(model.output(*named(x, u, p)), outputs, model, "output")

        return rate, output

    given = placeholders(model)
    rate, output = functions(True)
    if _leaves_a_branch(lambda *a: (rate(*a), output(*a)), given):
        rate, output = functions(False)
    reads = dependencies(rate, *given)
    pattern = tuple(tuple(j in row for j in range(len(states))) for row in reads)
    time = len(states) + len(channels) - 1
    in_rate = any(time in row for row in reads)
    guards = [e.when for e in model.events]
    declared = [*guards, *(e.then for e in model.events)]
    declared += [f for law in model.frictions for f in (law.sliding, law.breakaway, law.effect)]
    declared += [f for play in model.backlashes for f in (play.drive, play.gap)]

    def sources(function):
        return set().union(*dependencies(lambda x, u, p: function(*named(x, u, p)), *given))

    used = in_rate or any(time in sources(f) for f in declared)
    timed = any(time in (s := sources(g)) and s.isdisjoint(range(time)) for g in guards)
    return VectorModel(model, states, channels, outputs, parameters, rate, output, used, in_rate, timed, pattern)


def _leaves_a_branch(function: Callable, given: tuple[Scalars, ...]) -> bool:
    """Whether what a table looks up inside a branch, as of lax.cond, is used again outside of it, which shared
    look-ups cannot do."""
    try:
        return any(isinstance(c, Tracer) for c in jax.make_jaxpr(function)(*given).consts)
    except jax.errors.UnexpectedTracerError:
        return True


def placeholders(model: Model) -> tuple[Scalars, Scalars, Scalars]:
    """States, channels and parameters of the right shapes, to trace the functions of a model with."""
    channels = len(model.inputs) + len(model.delays) + len(model.state_delays) + 1
    return (
        (1.0,) * len(model.states),
        (1.0,) * channels,
        tuple(jnp.ones(d.shape) if d.shape else np.ones(()) for d in model.parameters),
    )


def _picked(values, names, model, what):
    missing = [n for n in names if n not in values]
    if missing:
        raise ModelError(
            f"Model {model.name!r}: {what}(x, u, p) returned "
            f"{sorted(values)}, without {missing[0]!r}; return every name."
        )
    return tuple(jnp.asarray(values[n], dtype=float) for n in names)
