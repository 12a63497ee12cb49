"""What may change with an input, a state or time: a parameter of the model, or what an input does (a cross-term of
two inputs)."""

from collections.abc import Mapping
from typing import Any

from plantfit import units
from plantfit.models.extensions.wiring import channels_of, declared, rewired
from plantfit.models.model import Declared, Model, Named

import jax.numpy as jnp

Bounds = tuple[float, float]

WITH = " with "
LEAST = 0.05  # of its value: a parameter keeps its sign, so that masses and time constants stay what they are
REFERENCE = "reference"


def change(model: Model, signal: str, bounds: Bounds, name: str) -> Model:
    """ "K with u": K (1 + c (u - u0)) in place of K, at least a twentieth of it; c is the parameter, u0 is
    `reference_K_with_u`.

    Of an input in the place of K all that reads it sees it changed. Initial values take K as it is at the reference.
    """
    subject, driver = signal.split(WITH)
    reference = f"{REFERENCE}_{signal.replace(' ', '_')}"

    def factor(x: Named, c: Named, p: Named) -> Any:
        at = x[driver] if driver in model.states else c[driver]
        return jnp.maximum(1.0 + p[name] * (at - p[reference]), LEAST)

    def reads(x: Named, c: Named, p: Named) -> tuple[Named, Named]:
        if subject not in model.inputs:
            return x, c
        size = factor(x, c, p)
        return x, {**c, **{channel: c[channel] * size for channel in channels_of(model, subject)}}

    def values(x: Named, c: Named, p: Named) -> Mapping[str, Any]:
        return p if subject in model.inputs else {**p, subject: p[subject] * factor(x, c, p)}

    unit = drivers_of(model)[driver]
    own = declared(model, name, inverse(unit), bounds, f"relative change of {subject} for each unit of {driver}")
    at = Declared(reference, unit, None, sentence=f"{driver} at which {subject} is what it is called")
    return rewired(model, reads, values=values, parameters=(*own, at))


def drivers_of(model: Model) -> dict[str, str | None]:
    """Inputs, states and time with their units: what something may change with."""
    moving = {s: unit for s, unit in model.states.items() if s.isidentifier()}
    return {**model.inputs, "t": "s", **moving}


def changes_of(model: Model) -> tuple[str, ...]:
    """Every pair that a model can have, as "K with u": numbers among its parameters with all drivers, and inputs
    with all others."""
    late = {d.parameter for d in (*model.delays, *model.state_delays)}
    drivers = drivers_of(model)
    own = [p.name for p in model.parameters if not p.shape and p.name not in late]
    return tuple(f"{s}{WITH}{d}" for s in (*own, *model.inputs) for d in drivers if d != s)


def inverse(unit: str | None) -> str | None:
    """One by a unit; of temperatures with an offset by a difference of them."""
    if unit is None:
        return None
    step = units.difference_of(unit) or "1"
    return "1" if step == "1" else f"1/{step}" if step.replace("_", "a").isalpha() else f"1/({step})"
