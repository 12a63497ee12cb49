"""What may act on a state: friction, viscous, dry or falling with speed, a drag that grows with the square, a pattern
that repeats, another initial value."""

from typing import Any

from plantfit import units
from plantfit.models.extensions.wiring import declared, per, rewired, with_table
from plantfit.models.model import Declared, Model, Named
from plantfit.models.parts.tables import over_a_period

import jax.numpy as jnp

Bounds = tuple[float, float]


def coulomb(model: Model, v: str, bounds: Bounds, name: str) -> Model:
    """v' less F tanh(v / v0): dry friction over inertia. v0, the speed from which on it is whole, is the parameter
    creep_NAME."""
    scale = f"creep_{v}"
    made = _braked(model, v, lambda x, p: p[name] * jnp.tanh(x[v] / p[scale]))
    own = declared(model, name, per(model.states[v], "/s"), bounds, f"dry friction of {v} over inertia")
    return rewired(made, lambda x, c, p: (x, c), parameters=(*own, *_creep(model, v)))


def stribeck(model: Model, v: str, bounds: Bounds, name: str) -> Model:
    """v' less S exp(-(v/vs)^2) tanh(v/v0): what dry friction is more at low speed, over inertia (Stribeck;
    `models/parts/friction.py`, 3).

    vs is the parameter stribeck_speed_NAME, v0 is creep_NAME, which dry friction has as well.
    """
    scale, speed = f"creep_{v}", f"stribeck_speed_{v}"
    made = _braked(model, v, lambda x, p: p[name] * jnp.exp(-((x[v] / p[speed]) ** 2)) * jnp.tanh(x[v] / p[scale]))
    own = declared(
        model,
        name,
        per(model.states[v], "/s"),
        bounds,
        f"friction of {v} at low speed beyond that at speed, over inertia",
    )
    falls = Declared(speed, model.states[v], None, "log", sentence=f"size of {v} over which friction falls")
    return rewired(made, lambda x, c, p: (x, c), parameters=(*own, falls, *_creep(model, v)))


def _creep(model: Model, v: str) -> tuple[Declared, ...]:
    """The speed from which on dry friction is whole, where the model does not have it yet."""
    name = f"creep_{v}"
    had = any(p.name == name for p in model.parameters)
    return (
        ()
        if had
        else (Declared(name, model.states[v], None, sentence=f"size of {v} from which on dry friction is whole"),)
    )


def viscous(model: Model, v: str, bounds: Bounds, name: str) -> Model:
    """v' less c v: viscous friction over inertia."""
    made = _braked(model, v, lambda x, p: p[name] * x[v])
    own = declared(model, name, "1/s", bounds, f"viscous friction of {v} over inertia")
    return rewired(made, lambda x, c, p: (x, c), parameters=own)


def quadratic(model: Model, v: str, bounds: Bounds, name: str) -> Model:
    """v' less c v |v|: the drag of air or a fluid over inertia."""
    unit = None if model.states[v] is None else f"1/s/({model.states[v] or '1'})"
    made = _braked(model, v, lambda x, p: p[name] * x[v] * jnp.abs(x[v]))
    return rewired(
        made,
        lambda x, c, p: (x, c),
        parameters=declared(model, name, unit, bounds, f"drag of {v} by its square, over inertia"),
    )


def cycle(model: Model, x: str, bounds: Bounds, name: str, period: float, count: int) -> Model:
    """x' and a pattern that repeats every `period` s, as of sun that nobody measured: a smooth curve through
    `count` even values, the first at t = 0."""
    curve = over_a_period(name, period, count, per(units.difference_of(model.states[x]), "/s"))

    def derivative(own: Named, c: Named, p: Named) -> Named:
        return {**own, x: own[x] + curve(p[name], c["t"])}

    return with_table(model, curve, bounds, f"what {x}' has more, over {period:g} s", derivative=derivative)


def start(model: Model, x: str, bounds: Bounds, name: str) -> Model:
    """x begins above its initial value by a free amount."""
    begin = model.initial_state

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        own = dict(begin(p, u0, y0)) if begin is not None else {s: 0.0 * p[name] for s in model.states}
        return {**own, x: own[x] + p[name]}

    unit = units.difference_of(model.states[x])
    sentence = f"by how much {x} begins above its initial value"
    return rewired(
        model,
        lambda s, c, p: (s, c),
        initial_state=initial_state,
        parameters=declared(model, name, unit, bounds, sentence),
    )


def _braked(model: Model, v: str, force: Any) -> Model:
    rate = model.derivative
    assert rate is not None

    def derivative(x: Named, c: Named, p: Named) -> Named:
        own = rate(x, c, p)
        return {**own, v: own[v] - force(x, p)}

    return rewired(model, lambda x, c, p: (x, c), derivative=derivative)
