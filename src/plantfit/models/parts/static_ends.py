"""Static nonlinearities before and after a linear block: how each computes and which parameters it has."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.models.model import Declared, Named
from plantfit.models.parts.tables import lookup
from plantfit.models.text.functions import CALLS

# isort: split
import jax.numpy as jnp


@dataclass(frozen=True)
class Curve:
    """A static function: `value(x, p)` and its parameters."""

    value: Callable[[Any, Named], Any]
    parameters: tuple[Declared, ...] = ()


def identity() -> Curve:
    """x itself."""
    return Curve(lambda x, p: x)


def saturation(unit: str | None) -> Curve:
    """x held between low and high."""
    return Curve(lambda x, p: CALLS["sat"].evaluate(x, p["low"], p["high"]), _edges(unit, "the input is held"))


def dead_zone(unit: str | None) -> Curve:
    """0 between low and high, x beyond, less the edge."""
    return Curve(
        lambda x, p: CALLS["deadzone"].evaluate(x, p["low"], p["high"]), _edges(unit, "the input has no effect")
    )


def free_table(name: str, nodes: tuple[float, ...], unit: str | None, sentence: str) -> Curve:
    """A table with a free value at each node."""
    values = Declared(name, unit, (-1e3, 1e3), sentence=sentence, shape=(len(nodes),))
    return Curve(lambda x, p: lookup(p[name], nodes, x), (values,))


def pinned_table(name: str, nodes: tuple[float, ...], unit: str | None) -> Curve:
    """A table in the unit of its nodes that meets the first and the last node: scale and offset stay with what
    follows."""
    span = nodes[-1] - nodes[0]
    bounds = (nodes[0] - span, nodes[-1] + span)
    inner = Declared(
        name, unit, bounds, sentence="curve at the inner nodes; it meets the end nodes", shape=(len(nodes) - 2,)
    )

    def value(x: Any, p: Named) -> Any:
        first, last = jnp.asarray(nodes[:1]), jnp.asarray(nodes[-1:])
        return lookup(jnp.concatenate([first, p[name], last]), nodes, x)

    return Curve(value, (inner,))


def polynomial(degree: int, unit: str | None, argument_unit: str | None) -> Curve:
    """g0 + g1 x + ... + g_degree x^degree, by Horner's rule."""
    units = [_per_power(unit, argument_unit, k) for k in range(degree + 1)]
    names = [f"g{k}" for k in range(degree + 1)]
    bounds = [(-(10.0 ** (3 - k)), 10.0 ** (3 - k)) for k in range(degree + 1)]

    def value(x: Any, p: Named) -> Any:
        result = p[names[-1]]
        for name in reversed(names[:-1]):
            result = p[name] + x * result
        return result

    sentences = ["value at 0", "slope at 0", *(f"coefficient of power {k}" for k in range(2, degree + 1))]
    return Curve(
        value,
        tuple(Declared(*entry[:3], sentence=entry[3]) for entry in zip(names, units, bounds, sentences, strict=True)),
    )


def _edges(unit: str | None, what: str) -> tuple[Declared, ...]:
    return (
        Declared("low", unit, (-1e3, 0.0), sentence=f"lower edge within which {what}"),
        Declared("high", unit, (0.0, 1e3), sentence=f"upper edge within which {what}"),
    )


def _per_power(unit: str | None, argument: str | None, power: int) -> str | None:
    if power == 0:
        return unit
    return None if unit is None or argument is None else f"({unit or '1'})/({argument or '1'})^{power}"
