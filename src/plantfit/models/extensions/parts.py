"""What may be added to an output as a function of inputs: a part in proportion to one, by its square or sign, by the
product of two, or a power of one on the whole output."""

from collections.abc import Callable
from itertools import combinations
from typing import Any

from plantfit import units
from plantfit.models.extensions.changes import REFERENCE, WITH
from plantfit.models.extensions.wiring import declared, rewired
from plantfit.models.model import Declared, Model, Named

import jax.numpy as jnp

Bounds = tuple[float, float]

AND = " and "
# of the inputs of a part: what stands beside its parameter, and which power of their units that has
SHAPES: dict[str, tuple[Callable[..., Any], int]] = {
    "proportional": (lambda u: u, 1),
    "square": (lambda u: u**2, 2),
    "signed_square": (lambda u: u * jnp.abs(u), 2),
    "sign": (jnp.sign, 0),
    "product": (lambda u, v: u * v, 1),
}


def split(signal: str) -> tuple[str, tuple[str, ...]]:
    """Output and inputs of a pair, as in "y with u" or "y with u and v"."""
    output, _, inputs = signal.partition(WITH)
    return output, tuple(inputs.split(AND))


def part(kind: str) -> Callable[[Model, str, Bounds, str], Model]:
    """What makes the addition of a kind of `SHAPES`: y + c f(u, ..) in place of y; c is the parameter."""
    shape, _ = SHAPES[kind]

    def made(model: Model, signal: str, bounds: Bounds, name: str) -> Model:
        y, inputs = split(signal)
        unit, output = unit_of_part(model, kind, signal), model.output

        def shown(x: Named, c: Named, p: Named) -> Named:
            own = output(x, c, p)
            return {**own, y: own[y] + p[name] * shape(*(c[u] for u in inputs))}

        own = declared(model, name, unit, bounds, f"part of {y} with {AND.join(inputs)}, for each unit of it")
        return rewired(model, lambda x, c, p: (x, c), output=shown, parameters=own)

    return made


def power(model: Model, signal: str, bounds: Bounds, name: str) -> Model:
    """ "y with u": y (u/u0)^n in place of y; n is the parameter, u0 is `reference_y_with_u`. For inputs above 0."""
    y, (u,) = split(signal)
    reference, output = f"{REFERENCE}_{signal.replace(' ', '_')}", model.output

    def shown(x: Named, c: Named, p: Named) -> Named:
        own = output(x, c, p)
        return {**own, y: own[y] * jnp.exp(p[name] * jnp.log(c[u] / p[reference]))}

    own = declared(model, name, "1", bounds, f"power of {u} on {y}")
    at = Declared(reference, model.inputs[u], None, sentence=f"{u} at which its power changes nothing")
    return rewired(model, lambda x, c, p: (x, c), output=shown, parameters=(*own, at))


def unit_of_part(model: Model, kind: str, signal: str) -> str | None:
    """The unit of the parameter of a part; None where one that it is made of is not known."""
    y, inputs = split(signal)
    own = units.difference_of(model.outputs[y])
    of = [units.difference_of(model.inputs[u]) for u in inputs]
    if own is None or any(u is None for u in of):
        return None
    order = SHAPES[kind][1]
    below = [f"{_factor(u)}^{order}" if order > 1 else _factor(u) for u in of if order and u not in (None, "", "1")]
    return "/".join([_factor(own or "1"), *below]) if below else own


def _factor(unit: str) -> str:
    return unit if unit.isidentifier() or unit == "1" else f"({unit})"


def parts_of(model: Model) -> tuple[str, ...]:
    """Every pair that a part of one input can have, as "y with u"."""
    return tuple(f"{y}{WITH}{u}" for y in model.outputs for u in model.inputs)


def products_of(model: Model) -> tuple[str, ...]:
    """Every output with two inputs, as "y with u and v"."""
    return tuple(f"{y}{WITH}{a}{AND}{b}" for y in model.outputs for a, b in combinations(model.inputs, 2))
