"""Events, dry friction and backlash that a model declares, as functions of tuples of scalars."""

from dataclasses import dataclass

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.parts.switching import Backlash, Event, Friction
from plantfit.simulate.steps.switching.crossings import Function
from plantfit.simulate.steps.times import fixed, straight, timed
from plantfit.simulate.steps.vector import VectorModel

import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class Trigger:
    """An `Event` on tuples of scalars; `sign` +1 falling, -1 rising, 0 both.

    `timed` events depend on time alone, `straight` ones among these are straight lines in time, `fixed` ones depend on
    no parameter (see `times`).
    """

    when: Function
    then: Function
    sign: int
    timed: bool = False
    straight: bool = False
    fixed: bool = False


@dataclass(frozen=True, eq=False)
class DryFriction:
    """A `Friction` on tuples of scalars; `effect` gives the rate of every state per unit of force, the number 0.0
    where it has none."""

    velocity: int
    sliding: Function
    breakaway: Function
    effect: Function


@dataclass(frozen=True, eq=False)
class Play:
    """A `Backlash` on tuples of scalars."""

    state: int
    drive: Function
    gap: Function


def bind_event(event: Event, vector: VectorModel) -> Trigger:
    """The declared event on tuples in the order of `vector`; raises ModelError for an unknown direction."""
    signs = {"falling": 1, "rising": -1, "both": 0}
    if event.direction not in signs:
        raise ModelError(f"Event {event.name!r} has direction {event.direction!r}; use one of {list(signs)}.")
    what = f"event {event.name!r}"
    when = _scalar(event.when, vector)
    by_time = timed(when, vector)
    line = by_time and straight(when, vector)
    then = _changed(event.then, vector, what, lambda x: x)
    return Trigger(when, then, signs[event.direction], by_time, line, by_time and fixed(when, vector))


def bind_friction(friction: Friction, vector: VectorModel) -> DryFriction:
    """The declared friction on tuples in the order of `vector`; raises ModelError for an unknown velocity."""
    place = _place(friction.velocity, vector, "friction")
    effect = _changed(friction.effect, vector, "the effect of friction", lambda x: (0.0,) * len(x), friction.velocity)
    return DryFriction(place, _scalar(friction.sliding, vector), _scalar(friction.breakaway, vector), effect)


def bind_backlash(backlash: Backlash, vector: VectorModel) -> Play:
    """The declared backlash on tuples in the order of `vector`; raises ModelError for an unknown state."""
    return Play(
        _place(backlash.state, vector, "backlash"), _scalar(backlash.drive, vector), _scalar(backlash.gap, vector)
    )


def _named(vector, x, u, p):
    return (
        dict(zip(vector.states, x, strict=True)),
        dict(zip(vector.channels, u, strict=True)),
        dict(zip(vector.parameters, p, strict=True)),
    )


def _scalar(function, vector):
    return lambda x, u, p: jnp.asarray(function(*_named(vector, x, u, p)), dtype=float)


def _changed(function, vector, what, otherwise, needed=None):
    """A function that names some states as one that gives all, the others from `otherwise(x)`."""

    def complete(x, u, p):
        given = function(*_named(vector, x, u, p))
        unknown = [name for name in given if name not in vector.states]
        if unknown or (needed is not None and needed not in given):
            reason = (
                f"names {unknown[0]!r}, which is not one of the states"
                if unknown
                else f"leaves out {needed!r} of the states"
            )
            raise ModelError(
                f"Model {vector.model.name!r}: {what} {reason} {list(vector.states)}; give names of states."
            )
        return tuple(
            jnp.asarray(given[n], dtype=float) if n in given else old
            for n, old in zip(vector.states, otherwise(x), strict=True)
        )

    return complete


def _place(state, vector, what):
    if state not in vector.states:
        raise ModelError(
            f"Model {vector.model.name!r}: {what} acts on {state!r}, which is not one of the states "
            f"{list(vector.states)}."
        )
    return vector.states.index(state)
