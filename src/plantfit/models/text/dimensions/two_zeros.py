"""Temperatures in degC and in K whose difference is multiplied, divided or is a rate: 273.15 K are missing, and the units agree.

A sum alone says nothing: a rise in K may be taken off a temperature in degC. A product of it is of differences, which both zeros spoil.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from plantfit.errors import EquationError
from plantfit.models.text.dimensions.unit_check import Unit, shown, temperature
from plantfit.models.text.expression import Node


class Zeros(NamedTuple):
    """How often a sum counts temperatures from a zero of their own, and from the absolute one; `sure`: no other term could be a zero."""

    own: int = 0
    absolute: int = 0
    sure: bool = True

    def plus(self, other: "Zeros", sign: int) -> "Zeros":
        return Zeros(self.own + sign * other.own, self.absolute + sign * other.absolute, self.sure and other.sure)


def refuse_two_zeros(
    named: Mapping[str, Unit], values: Mapping[str, Node], others: Iterable[Node], rates: Iterable[Node], text: str
) -> None:
    """Raise EquationError where a difference of degC and K is multiplied, divided, raised to a power or the rate of a state.

    `named` are the units of signals, parameters, constants and tables, None for unknown ones; `values` are in the order of their use.
    """
    zeros = {name: _of_unit(unit) for name, unit in named.items()}
    for name, node in values.items():
        if named.get(name) is None:
            zeros[name] = _of(node, zeros)
    for node in (*values.values(), *others):
        for part in node.walk():
            if part.op in ("*", "/", "**"):
                for factor in part.args[:1] if part.op != "*" else part.args:
                    _check(factor, zeros, named, values, text)
    for node in rates:
        _check(node, zeros, named, values, text)


def _check(node: Node, zeros: Mapping[str, Zeros], named: Mapping[str, Unit], values: Mapping[str, Node], text: str) -> None:
    found = _of(node, zeros)
    if not found.sure or found.own * found.absolute >= 0:
        return
    kinds = {temperature(named.get(n)): n for n in sorted(_read(node, values))}
    own, other = kinds.get("from its own zero"), kinds.get("absolute")
    if own is None or other is None:
        return
    raise EquationError(
        f"The difference of {own!r} in {shown(named[own])} and {other!r} in {shown(named[other])} is multiplied or is a rate, and 0 degC "
        f'is 273.15 K; declare both in one unit, as in {own} = "K", to which recordings are converted. If {other!r} is a difference of '
        "temperatures, its unit is delta_degC.",
        text,
        *node.place,
    )


def _read(node: Node, values: Mapping[str, Node]) -> set[str]:
    """The names that an expression reads, also through intermediate values."""
    names = node.names()
    return names.union(*(_read(values[n], values) for n in names if n in values))


def _of(node: Node, zeros: Mapping[str, Zeros]) -> Zeros:
    if node.op == "number":
        return Zeros(sure=node.number == 0)
    if node.op in ("name", "table"):
        return zeros.get(node.name, Zeros(sure=False))
    if node.op == "negative":
        return Zeros().plus(_of(node.args[0], zeros), -1)
    if node.op in ("+", "-") and len(node.args) == 2:
        first, second = (_of(a, zeros) for a in node.args)
        return first.plus(second, 1 if node.op == "+" else -1)
    return Zeros()  # a product, as of a resistance and a flow, is a difference


def _of_unit(unit: Unit) -> Zeros:
    kind = temperature(unit)
    return Zeros(own=kind == "from its own zero", absolute=kind == "absolute", sure=unit is not None)
