"""What may stand between the plant and a recorded output: a lag of the sensor, an offset, a drift, a pattern that
repeats, the ends of its range."""

from dataclasses import replace
from typing import Any

from plantfit import units
from plantfit.models.extensions.wiring import declared, first_channels, per, rewired, with_table, without
from plantfit.models.model import Model, Named
from plantfit.models.parts.tables import Table, over_a_period

import jax.numpy as jnp

Bounds = tuple[float, float]


def sensor_lag(model: Model, y: str, bounds: Bounds, name: str) -> Model:
    """The sensor shows s, T s' = y - s, s at y in the beginning."""
    state, rate, output, begin = f"shown({y})", model.derivative, model.output, model.initial_state

    def inner(x: Named) -> dict[str, Any]:
        return {n: v for n, v in x.items() if n != state}

    def derivative(x: Named, c: Named, p: Named) -> Named:
        own = {} if rate is None else rate(inner(x), c, p)
        return {**own, state: (output(inner(x), c, p)[y] - x[state]) / p[name]}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        x = dict(begin(p, u0, y0)) if begin is not None else {s: jnp.zeros_like(y0[y]) for s in model.states}
        return {**x, state: output(x, first_channels(model, x, u0), p)[y]}

    return rewired(
        model,
        lambda x, c, p: (inner(x), c),
        derivative=derivative,
        output=lambda x, c, p: {**output(inner(x), c, p), y: x[state]},
        initial_state=initial_state,
        states={**model.states, state: model.outputs[y]},
        parameters=declared(model, name, "s", bounds, f"time constant of the sensor of {y}"),
    )


def offset(model: Model, y: str, bounds: Bounds, name: str) -> Model:
    """The sensor shows y and a constant."""
    unit = units.difference_of(model.outputs[y])
    return _shown(model, y, name, unit, bounds, lambda v, c, p: v + p[name], f"offset of the sensor of {y}")


def drift(model: Model, y: str, bounds: Bounds, name: str) -> Model:
    """The sensor shows y and a straight line in time, zero at t = 0."""
    unit = per(units.difference_of(model.outputs[y]), "/s")
    return _shown(model, y, name, unit, bounds, lambda v, c, p: v + p[name] * c["t"], f"drift of the sensor of {y}")


def slow_drift(model: Model, y: str, bounds: Bounds, name: str, nodes: tuple[float, ...]) -> Model:
    """The sensor shows y and a curve in time through `nodes` (n,) s: straight lines between them, level outside."""
    curve = Table(name, ("t",), (nodes,), units.difference_of(model.outputs[y]))
    return _along(model, y, bounds, curve, f"slow drift of the sensor of {y}")


def cycle(model: Model, y: str, bounds: Bounds, name: str, period: float, count: int) -> Model:
    """The sensor shows y and a pattern that repeats every `period` s: a smooth curve through `count` even values,
    the first at t = 0."""
    unit = units.difference_of(model.outputs[y])
    curve = over_a_period(name, period, count, unit)
    made, begin = _along(model, y, bounds, curve, f"error of {y} over {period:g} s"), model.initial_state

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        # states that begin at the first measured value begin where the sensor would be right
        assert begin is not None
        return begin(without(p, (name,)), u0, {**y0, y: y0[y] - curve(p[name], u0["t"])})

    return made if begin is None else replace(made, initial_state=initial_state)


def sensor_high(model: Model, y: str, bounds: Bounds, name: str) -> Model:
    """The sensor shows no more than its upper end."""
    return _shown(
        model,
        y,
        name,
        model.outputs[y],
        bounds,
        lambda v, c, p: jnp.minimum(v, p[name]),
        f"upper end of the sensor of {y}",
    )


def sensor_low(model: Model, y: str, bounds: Bounds, name: str) -> Model:
    """The sensor shows no less than its lower end."""
    return _shown(
        model,
        y,
        name,
        model.outputs[y],
        bounds,
        lambda v, c, p: jnp.maximum(v, p[name]),
        f"lower end of the sensor of {y}",
    )


def _shown(model: Model, y: str, name: str, unit: str | None, bounds: Bounds, curve: Any, sentence: str) -> Model:
    output = model.output

    def shown(x: Named, c: Named, p: Named) -> Named:
        own = output(x, c, p)
        return {**own, y: curve(own[y], c, p)}

    return rewired(
        model, lambda x, c, p: (x, c), output=shown, parameters=declared(model, name, unit, bounds, sentence)
    )


def _along(model: Model, y: str, bounds: Bounds, curve: Table, sentence: str) -> Model:
    """The sensor shows y and a curve in time."""

    def shown(own: Named, c: Named, p: Named) -> Named:
        return {**own, y: own[y] + curve(p[curve.name], c["t"])}

    return with_table(model, curve, bounds, sentence, output=shown)
