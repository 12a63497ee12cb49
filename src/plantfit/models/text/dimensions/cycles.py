"""Frequencies in Hz where an angular frequency is meant: sin(f*t) with f in Hz is wrong by 2 pi, and the units agree,
for a cycle and a radian are both numbers."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from plantfit import units
from plantfit.errors import EquationError
from plantfit.models.text.dimensions.unit_check import Unit, is_pi
from plantfit.models.text.expression import Node
from plantfit.models.text.functions import FUNCTIONS

_ALMOST = 1e-9


class Cycles(NamedTuple):
    """The power of Hz in a product, the name that it comes from, and whether pi, an angle or a time is a factor of it
    too."""

    power: float = 0.0
    name: str = ""
    turned: bool = False
    timed: bool = False

    @property
    def counted(self) -> float:
        """The power of Hz that no 2 pi makes angular."""
        return 0.0 if self.turned else self.power


def refuse_cycles(
    named: Mapping[str, Unit],
    numbers: Mapping[str, float],
    values: Mapping[str, Node],
    rates: Mapping[str, Node],
    others: Iterable[Node],
    text: str,
) -> None:
    """Raise EquationError where the argument of a sine, cosine or tangent counts cycles in Hz, and where the rate of a
    state has the square of a frequency in Hz, which nothing cancels.

    `named` are the units of signals, parameters and constants, None for unknown ones, of which nothing is said;
    `numbers` the values of constants; `values` are in the order of their use. A factor pi, or an angle, makes a
    frequency angular.
    """
    known = {n: _of_unit(n, unit, numbers.get(n)) for n, unit in named.items()}

    def of(node: Node) -> Cycles | None:
        if node.op == "number":
            return Cycles(turned=is_pi(node.number))
        if node.op == "name" or node.table is not None:
            return known.get(node.name)
        rule = FUNCTIONS[node.op].rule
        parts = [of(arg) for arg in node.args]
        if rule in ("times", "over"):
            a, b = parts
            sign = 1.0 if rule == "times" else -1.0
            if a is None or b is None:
                return None
            name = a.name or b.name if a.counted or not b.counted else b.name
            timed = a.timed or b.timed
            return Cycles(a.counted + sign * b.counted, name, a.turned or b.turned, timed)
        if rule in ("power", "root"):
            base, power = parts[0], 0.5 if rule == "root" else _number(node.args[1], numbers)
            return None if base is None or power is None else base._replace(power=power * base.power)
        if rule == "angle":
            _check_angle(node, parts[0], text)
            return Cycles()
        if rule in ("same", "choose"):
            some = [p for p in parts[1 if rule == "choose" else 0 :] if p is not None]
            return max(some, key=lambda p: abs(p.counted), default=None)
        return Cycles() if rule in ("plain", "logic", "ratio") else None

    for name, node in values.items():
        found = of(node)
        if known.get(name) is None:
            known[name] = found
    for node in others:
        of(node)
    for state, node in rates.items():
        _check_rate(state, node, of, named.get(state), text)


def _of_unit(name: str, unit: Unit, number: float | None) -> Cycles | None:
    """What a quantity of a unit has of cycles; None where its unit is not known."""
    if number is not None and is_pi(number):
        return Cycles(turned=True)
    if unit is None:
        return None
    powers: dict[str, float] = dict(unit._units)
    cycles = sum(p for n, p in powers.items() if n.endswith("hertz"))
    angles = any(n.endswith(("radian", "degree", "turn", "revolution")) for n in powers)
    timed = any(p > 0 and units.compatible(n, "s") for n, p in powers.items())
    return Cycles(float(cycles), name if cycles else "", angles, timed)


def _number(node: Node, numbers: Mapping[str, float]) -> float | None:
    if node.op == "negative" and node.args[0].op == "number":
        return -node.args[0].number
    return node.number if node.op == "number" else numbers.get(node.name) if node.op == "name" else None


def _check_angle(node: Node, found: Cycles | None, text: str) -> None:
    if found is None or math.isclose(found.counted, 0.0, abs_tol=_ALMOST):
        return
    raise EquationError(
        f"{node.op}() takes an angle in rad, but this counts cycles: {found.name!r} is in Hz, and a cycle is 2 pi rad. "
        f"Write 2*pi*{found.name} for {found.name!r} here, or declare {found.name!r} in rad/s if its numbers are "
        "angular frequencies.",
        text,
        *node.args[0].start,
    )


def _check_rate(state: str, node: Node, of, unit: Unit, text: str) -> None:
    """Of each term: v' = -f^2*x, whose f is an angular frequency."""
    if node.op in ("+", "-", "negative"):
        for arg in node.args:
            _check_rate(state, arg, of, unit, text)
        return
    found = of(node)
    if found is None or found.timed or not math.isclose(found.counted, 2.0) or unit is None:
        return
    if any(name.endswith("hertz") for name in unit._units):
        return
    raise EquationError(
        f"The derivative of {state!r} has the square of {found.name!r}, which is in Hz, where that of an angular "
        f"frequency is meant. Write (2*pi*{found.name})^2, or declare {found.name!r} in rad/s if its numbers are "
        "angular frequencies.",
        text,
        *node.start,
    )
