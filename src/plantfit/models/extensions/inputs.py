"""What may stand between a recorded input and the plant: a dead time, a lag, a dead zone, a limit, play, an offset."""

from typing import Any

from plantfit import units
from plantfit.models.extensions.wiring import channels_of, declared, rewired
from plantfit.models.model import Delay, Model, Named
from plantfit.models.parts.switching import Backlash

import jax.numpy as jnp

Bounds = tuple[float, float]


def dead_time(model: Model, u: str, bounds: Bounds, name: str) -> Model:
    """u(t - T) in place of u(t)."""
    channel = f"late({u})"
    return rewired(
        model,
        lambda x, c, p: (x, {**c, u: c[channel]}),
        parameters=declared(model, name, "s", bounds, f"dead time of {u}"),
        delays=(*model.delays, Delay(channel, u, name)),
    )


def lag(model: Model, u: str, bounds: Bounds, name: str) -> Model:
    """v in place of u, T v' = u - v, v at u in the beginning."""
    copies = {channel: f"lagged({channel})" for channel in channels_of(model, u)}

    def reads(x: Named, c: Named, p: Named) -> tuple[Named, Named]:
        return x, {**c, **{channel: x[state] for channel, state in copies.items()}}

    own = model.derivative

    def derivative(x: Named, c: Named, p: Named) -> Named:
        inner = {} if own is None else own(*reads(x, c, p), p)
        return {**inner, **{state: (c[channel] - x[state]) / p[name] for channel, state in copies.items()}}

    return rewired(
        model,
        reads,
        derivative=derivative,
        initial_state=_beginning(model, u, copies),
        states={**model.states, **dict.fromkeys(copies.values(), model.inputs[u])},
        parameters=declared(model, name, "s", bounds, f"time constant of a lag between {u} and the plant"),
    )


def dead_zone(model: Model, u: str, bounds: Bounds, name: str) -> Model:
    """u nearer to zero by d, and zero where it is less than d."""
    return _through(
        model, u, bounds, name, lambda v, d: v - jnp.clip(v, -d, d), f"size of {u} up to which nothing happens"
    )


def saturation(model: Model, u: str, bounds: Bounds, name: str) -> Model:
    """u held between -s and s."""
    return _through(
        model, u, bounds, name, lambda v, s: jnp.clip(v, -s, s), f"size of {u} beyond which nothing more happens"
    )


def offset(model: Model, u: str, bounds: Bounds, name: str) -> Model:
    """u less c: the sensor of u shows c too much."""
    unit = units.difference_of(model.inputs[u])
    return _through(model, u, bounds, name, lambda v, c: v - c, f"by how much too high {u} is recorded", unit)


def _through(
    model: Model, u: str, bounds: Bounds, name: str, curve: Any, sentence: str, unit: str | None = None
) -> Model:
    channels, own = channels_of(model, u), model.initial_state

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        assert own is not None
        return own(p, {**u0, u: curve(u0[u], p[name])}, y0)

    return rewired(
        model,
        lambda x, c, p: (x, {**c, **{k: curve(c[k], p[name]) for k in channels}}),
        initial_state=None if own is None else initial_state,
        parameters=declared(model, name, unit or model.inputs[u], bounds, sentence),
    )


def backlash(model: Model, u: str, bounds: Bounds, name: str) -> Model:
    """z in place of u, which follows u with play of `gap` to each side and begins at u."""
    copies = {channel: f"played({channel})" for channel in channels_of(model, u)}
    own = model.derivative

    def reads(x: Named, c: Named, p: Named) -> tuple[Named, Named]:
        return x, {**c, **{channel: x[state] for channel, state in copies.items()}}

    def derivative(x: Named, c: Named, p: Named) -> Named:
        inner = {} if own is None else own(*reads(x, c, p), p)
        return {**inner, **{state: 0.0 * x[state] for state in copies.values()}}

    plays = (
        Backlash(state, lambda x, c, p, channel=channel: c[channel], lambda x, c, p: p[name])
        for channel, state in copies.items()
    )
    return rewired(
        model,
        reads,
        derivative=derivative,
        initial_state=_beginning(model, u, copies),
        states={**model.states, **dict.fromkeys(copies.values(), model.inputs[u])},
        parameters=declared(model, name, model.inputs[u], bounds, f"play of {u} to each side"),
        backlashes=tuple(plays),
    )


def _beginning(model: Model, u: str, copies: dict[str, str]) -> Any:
    own = model.initial_state

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        inner = dict(own(p, u0, y0)) if own is not None else {s: jnp.zeros_like(u0[u]) for s in model.states}
        return {**inner, **dict.fromkeys(copies.values(), u0[u])}

    return initial_state
