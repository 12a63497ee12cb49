"""Temperatures in degC and in K whose difference is multiplied, divided, a rate or the condition of an event: 273.15 K
are missing, and the units agree. So are those of a multiple of degC and an output in K.

A sum alone says nothing: a rise in K may be taken off a temperature in degC. A product of it is of differences, which
both zeros spoil.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from plantfit import units
from plantfit.errors import EquationError
from plantfit.models.text.dimensions.unit_check import Unit, shown, temperature
from plantfit.models.text.expression import Node


class Zeros(NamedTuple):
    """How often a sum counts temperatures from a zero of their own, and from the absolute one; `sure`: no other term
    could be a zero."""

    own: float = 0
    absolute: float = 0
    sure: bool = True

    def plus(self, other: "Zeros", sign: float) -> "Zeros":
        return Zeros(self.own + sign * other.own, self.absolute + sign * other.absolute, self.sure and other.sure)


def refuse_two_zeros(
    named: Mapping[str, Unit], values: Mapping[str, Node], others: Iterable[Node], ends: Iterable[Node], text: str
) -> None:
    """Raise EquationError where a difference of degC and K is multiplied, divided, raised to a power or one of the
    `ends`: the rate of a state, the condition of an event; and where a value in K is a multiple of degC, or the other
    way round.

    `named` are the units of signals, parameters, constants and tables, None for unknown ones; `values` are in the order
    of their use.
    """
    zeros = {name: _of_unit(unit) for name, unit in named.items()}
    plain = _without_dimension(named)
    for name, node in values.items():
        if named.get(name) is None:
            zeros[name] = _of(node, zeros, plain)
        else:
            refuse_multiple(f"{name!r}", node, named, named[name], text)
    for node in (*values.values(), *others):
        for part in node.walk():
            if part.op in ("*", "/", "**"):
                for factor in part.args[:1] if part.op != "*" else part.args:
                    _check(factor, zeros, plain, named, values, text)
    for node in ends:
        _check(node, zeros, plain, named, values, text)


def refuse_multiple(what: str, node: Node, named: Mapping[str, Unit], wanted: Unit, text: str) -> None:
    """Raise EquationError where `what`, in K, is a sum of multiples of temperatures in degC alone, or the other way
    round, or a difference of both. A rise in K may be taken off a temperature in degC."""
    zeros = {name: _of_unit(unit) for name, unit in named.items()}
    found, kind = _of(node, zeros, _without_dimension(named)), temperature(wanted)
    if not found.sure or kind is None:
        return
    alone = (kind == "absolute" and found.own and not found.absolute) or (
        kind == "from its own zero" and found.absolute and not found.own
    )
    opposed = found.own * found.absolute < 0 and not (kind == "from its own zero" and found.own > 0)
    names = {temperature(named.get(n)): n for n in sorted(node.names())}
    own, other = names.get("from its own zero"), names.get("absolute")
    if opposed and own is not None and other is not None:
        raise _two_zeros(f"{what} has the difference of", own, other, named, node, text)
    name, sign = (own, "+") if kind == "absolute" else (other, "-")
    if not alone or name is None:
        return
    raise EquationError(
        f"{what} is in {shown(wanted)}, but this counts temperatures in {shown(named[name])}, "
        f"and 0 degC is 273.15 K: write ({name} {sign} zero) for {name!r}, with zero = '273.15 "
        "K' in constants, or declare both in one unit (recordings are converted to it).",
        text,
        *node.place,
    )


def _two_zeros(
    begin: str, own: str, other: str, named: Mapping[str, Unit], node: Node, text: str, end: str = ""
) -> EquationError:
    return EquationError(
        f"{begin} {own!r} in {shown(named[own])} and {other!r} in {shown(named[other])}{end}, and 0 degC is 273.15 K; "
        f"declare both in one "
        f'unit, as in {own} = "K", to which recordings are converted. If {other!r} is a difference of temperatures, '
        f"its unit is "
        "delta_degC.",
        text,
        *node.place,
    )


def _without_dimension(named: Mapping[str, Unit]) -> set[str]:
    return {name for name, unit in named.items() if unit is not None and units.dimension(unit) == units.dimension("")}


def _check(
    node: Node,
    zeros: Mapping[str, Zeros],
    plain: Collection[str],
    named: Mapping[str, Unit],
    values: Mapping[str, Node],
    text: str,
) -> None:
    found = _of(node, zeros, plain)
    if not found.sure or found.own * found.absolute >= 0:
        return
    kinds = {temperature(named.get(n)): n for n in sorted(_read(node, values))}
    own, other = kinds.get("from its own zero"), kinds.get("absolute")
    if own is None or other is None:
        return
    raise _two_zeros("The difference of", own, other, named, node, text, " is multiplied, is a rate or is a condition")


def _read(node: Node, values: Mapping[str, Node]) -> set[str]:
    """The names that an expression reads, also through intermediate values."""
    names = node.names()
    return names.union(*(_read(values[n], values) for n in names if n in values))


def _of(node: Node, zeros: Mapping[str, Zeros], plain: Collection[str]) -> Zeros:
    """Of an expression; names in `plain` have no dimension, and are taken as positive."""
    if node.op == "number":
        return Zeros(sure=node.number == 0)
    if node.op in ("name", "table"):
        return zeros.get(node.name, Zeros(sure=False))
    if node.op == "negative":
        return Zeros().plus(_of(node.args[0], zeros, plain), -1)
    if node.op in ("+", "-") and len(node.args) == 2:
        first, second = (_of(a, zeros, plain) for a in node.args)
        return first.plus(second, 1 if node.op == "+" else -1)
    if node.op in ("*", "/"):
        for own, factor in zip(node.args, node.args[::-1], strict=True) if node.op == "*" else [node.args]:
            if (size := _size(factor, plain)) is not None:
                return Zeros().plus(_of(own, zeros, plain), size if node.op == "*" else 1 / size)
    return Zeros()  # another product, as of a resistance and a flow, is a difference


def _size(node: Node, plain: Collection[str]) -> float | None:
    """A factor without dimension: a number, or 1 for a name."""
    if node.op == "negative":
        size = _size(node.args[0], plain)
        return None if size is None else -size
    if node.op == "number":
        return node.number or None
    return 1.0 if node.op == "name" and node.name in plain else None


def _of_unit(unit: Unit) -> Zeros:
    kind = temperature(unit)
    return Zeros(own=kind == "from its own zero", absolute=kind == "absolute", sure=unit is not None)
