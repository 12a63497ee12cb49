"""What may become another one at a moment: a parameter of the model, what moves a state, what a sensor shows."""

from dataclasses import replace
from typing import Any

from plantfit import units
from plantfit.models.extensions.changes import LEAST
from plantfit.models.extensions.wiring import declared, per, rewired
from plantfit.models.model import Declared, Model, Named
from plantfit.models.parts.switching import Event

import jax.numpy as jnp

Bounds = tuple[float, float]

MOMENT = "_at"


def moment_of(name: str) -> str:
    """The parameter that says when: "step_K_at" of "step_K"."""
    return f"{name}{MOMENT}"


def numbers_of(model: Model) -> tuple[str, ...]:
    """Parameters that can become another one: single numbers that are no dead times."""
    late = {d.parameter for d in (*model.delays, *model.state_delays)}
    return tuple(p.name for p in model.parameters if not p.shape and p.name not in late)


def parameter(model: Model, subject: str, bounds: Bounds, name: str, at: Bounds) -> Model:
    """K (1 + c) in place of K from the moment T on, at least a twentieth of it; c is the parameter `name`, T is `name`
    with _at, in s within `at`. Initial values take K as it is before."""
    state = f"stepped({subject})"

    def values(x: Named, c: Named, p: Named) -> Named:
        return {**p, subject: p[subject] * jnp.maximum(1.0 + p[name] * x[state], LEAST)}

    own = declared(model, name, "1", bounds, f"relative change of {subject} at a moment")
    return _from_a_moment(
        model,
        name,
        at,
        state,
        rewired(model, lambda x, c, p: (x, c), values=values, parameters=own),
        f"{subject} changes",
    )


def load(model: Model, x: str, bounds: Bounds, name: str, at: Bounds) -> Model:
    """x' and c from the moment T on."""
    state, rate = f"loaded({x})", model.derivative
    assert rate is not None

    def derivative(s: Named, c: Named, p: Named) -> Named:
        own = rate(s, c, p)
        return {**own, x: own[x] + p[name] * s[state]}

    unit = per(units.difference_of(model.states[x]), "/s")
    own = declared(model, name, unit, bounds, f"what {x}' has more from a moment on")
    made = rewired(model, lambda s, c, p: (s, c), derivative=derivative, parameters=own)
    return _from_a_moment(model, name, at, state, made, f"what moves {x} changes")


def sensor(model: Model, y: str, bounds: Bounds, name: str, at: Bounds) -> Model:
    """The sensor shows y and c from the moment T on."""
    state, output = f"shifted({y})", model.output

    def shown(s: Named, c: Named, p: Named) -> Named:
        own = output(s, c, p)
        return {**own, y: own[y] + p[name] * s[state]}

    unit = units.difference_of(model.outputs[y])
    own = declared(model, name, unit, bounds, f"what the sensor of {y} shows more from a moment on")
    made = rewired(model, lambda s, c, p: (s, c), output=shown, parameters=own)
    return _from_a_moment(model, name, at, state, made, f"the sensor of {y} changes")


def _from_a_moment(model: Model, name: str, at: Bounds, state: str, made: Model, what: str) -> Model:
    """`made` of a model with a state that is 0 before a moment and 1 behind it. An event at a straight line in time
    is stepped to exactly, and derivatives by the moment are those of the plant."""
    moment, begin, rate = moment_of(name), model.initial_state, made.derivative

    def derivative(x: Named, c: Named, p: Named) -> Named:
        own = {} if rate is None else rate(x, c, p)
        return {**own, state: 0.0 * x[state]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        own: dict[str, Any] = (
            dict(begin(p, u0, y0)) if begin is not None else dict.fromkeys(model.states, 0.0 * p[name])
        )
        return {**own, state: 0.0 * p[name]}

    when = Event(f"{what} at {moment}", lambda x, c, p: c["t"] - p[moment], lambda x, c, p: {state: 1.0}, "rising")
    return replace(
        made,
        derivative=derivative,
        initial_state=initial_state,
        states={**made.states, state: "1"},
        parameters=(*made.parameters, Declared(moment, "s", at, sentence=f"when {what}")),
        events=(*made.events, when),
    )
