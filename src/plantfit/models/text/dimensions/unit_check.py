"""Units of every expression, and the errors where they do not fit.

Equations compute in the units that were declared, without hidden conversion, so that not only
the dimensions must agree but also the factors: rpm and rad/s do not add.
"""

import math
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

from plantfit import units
from plantfit.errors import EquationError, UnitError
from plantfit.models.text.expression import Node
from plantfit.models.text.functions import FUNCTIONS


class Free(Enum):
    """The unit of zero: it fits beside any other."""

    zero = "zero"


ZERO = Free.zero
Unit = Any  # pint.Unit, None for an unknown unit, or ZERO

_PERCENT = 0.01
MOST_HALVES = 1e4  # multiples of pi / 2 that are looked for; every number is close to one of very many


def unit_of(text: str | None, what: str) -> Unit:
    """The pint unit of a declaration, None for None. Raises UnitError that says whose unit it is."""
    if text is None:
        return None
    if not isinstance(text, str):
        raise UnitError(f"The unit of {what} is {text!r}; write a string such as 'rad/s', or None for unknown.")
    try:
        return units.parse(text)
    except UnitError as error:
        raise UnitError(f"The unit of {what}: {error}") from None


def same(a: Unit, b: Unit, *, shifted: bool = False) -> bool:
    """Whether numbers in unit a can stand beside numbers in unit b; unknown units and zero always can.

    A temperature in degC and one in K cannot, unless `shifted`: added or subtracted, where one of them may be a
    difference.
    """
    if a is None or b is None or a is ZERO or b is ZERO:
        return True
    if not shifted and {temperature(a), temperature(b)} == {"from its own zero", "absolute"}:
        return False
    return _plain(a / b) and math.isclose(_factor(a / b), 1.0, rel_tol=1e-9) and not _turns_against_radians(a, b)


def shown(unit: Unit) -> str:
    """A unit as people write it."""
    # the sign of a product differs between versions of pint
    return f"{unit:~P}".replace("\N{DOT OPERATOR}", "\N{MIDDLE DOT}") or "no unit"


class UnitChecker:
    """Infers units of expressions from the units of names; raises EquationError at the place of a misfit.

    `numbers` are the values of named constants, for exponents; `axes` the units that the arguments
    of each table must have. Without `numbers_known` numbers in the text may have any unit.
    """

    def __init__(
        self,
        named: Mapping[str, Unit],
        numbers: Mapping[str, float],
        text: str,
        axes: Mapping[str, tuple[Unit, ...]] | None = None,
        numbers_known: bool = True,
    ):
        self.named = dict(named)
        self.numbers = numbers
        self.text = text
        self.axes = axes or {}
        self.numbers_known = numbers_known
        self._rules: dict[str, Callable[[Node, list[Unit]], Unit]] = {
            "same": self._same,
            "ratio": self._ratio,
            "plain": self._plain_arguments,
            "angle": self._plain_arguments,
            "times": self._times,
            "over": self._over,
            "power": self._power,
            "root": lambda node, given: _raised(given[0], 0.5),
            "choose": lambda node, given: self._common(node, node.args[1:], given[1:]),
            "logic": lambda node, given: self._plain_unit(),
            "law": self._law,
        }

    def unit(self, node: Node) -> Unit:
        """The unit of an expression."""
        if node.op == "number":
            return ZERO if node.number == 0 else self._plain_unit() if self.numbers_known else None
        if node.op == "name":
            return self.named.get(node.name)
        if node.table is not None:
            for arg, signal, wanted in zip(node.args, node.table.over, self.axes[node.name], strict=True):
                self.expect(arg, wanted, f"The table {node.name!r} over {signal!r}: its argument")
            return self.named.get(node.name)
        return self._rules[FUNCTIONS[node.op].rule](node, [self.unit(a) for a in node.args])

    def expect(self, node: Node, wanted: Unit, what: str) -> None:
        """Raise EquationError unless the expression has the unit that `what` needs."""
        found = self.unit(node)
        if not same(found, wanted):
            raise self._fail(
                f"{what} must be in {shown(wanted)}, but this is in {shown(found)}{_how(found, wanted)}.", node.start
            )

    def _plain_unit(self) -> Unit:
        return units.parse("")

    def _fail(self, message: str, place: tuple[int, int]) -> EquationError:
        return EquationError(message, self.text, *place)

    def _common(self, node: Node, args: tuple[Node, ...], given: list[Unit]) -> Unit:
        """The unit shared by all arguments; None as soon as one is unknown."""
        known = [(a, u) for a, u in zip(args, given, strict=True) if u is not None and u is not ZERO]
        for arg, unit in known[1:]:
            first_arg, first = known[0]
            if same(first, unit, shifted=node.op in ("+", "-")):
                continue
            if {first_arg.op, arg.op} == {"number", "name"} and "t" in (first_arg.name, arg.name):
                continue  # t is in seconds, and so is a number beside it
            for number, other in ((first_arg, unit), (arg, first)):
                if number.op == "number":
                    raise self._literal(number, other)
            message = f"{_spelled(node)} joins {shown(first)} and {shown(unit)}{_how(unit, first)}."
            raise self._fail(message, node.place)
        if None in given:
            return None
        return known[0][1] if known else ZERO

    def _literal(self, number: Node, unit: Unit) -> EquationError:
        what = f"The number {number.number:g} has no unit, but is combined with a quantity in {shown(unit)}"
        if _ratio_of_alike(unit):
            return self._fail(
                f"{what}: 1 {shown(unit)} is {_factor(unit):.6g}, and equations convert nothing by themselves. Declare "
                "what is divided there in one unit.",
                number.place,
            )
        message = (
            f"{what}; give it a name and a unit in constants, as in offset = '{number.number:g} {shown(unit)}', and "
            "use that name here."
        )
        return self._fail(message, number.place)

    def _same(self, node: Node, given: list[Unit]) -> Unit:
        unit = self._common(node, node.args, given)
        kinds = [temperature(u) for u in given]
        if len(given) < 2 or unit is None or None in kinds or node.op not in ("+", "-"):
            return unit
        if "difference" not in kinds and (node.op == "-" or len(set(kinds)) > 1):
            point = next((u for u, k in zip(given, kinds, strict=True) if k == "from its own zero"), unit)
            return units.parse(units.difference_of(str(point)) or "") if units.is_point(point) else _difference(point)
        return next((u for u, k in zip(given, kinds, strict=True) if k != "difference"), unit)

    def _ratio(self, node: Node, given: list[Unit]) -> Unit:
        self._common(node, node.args, given)
        return self._plain_unit()

    def _law(self, node: Node, given: list[Unit]) -> Unit:
        """Some arguments share the unit of the result, the others share one of their own."""
        own = FUNCTIONS[node.op].like_result
        groups = [[k for k in range(len(given)) if (k in own) == inside] for inside in (False, True)]
        return [self._common(node, tuple(node.args[k] for k in group), [given[k] for k in group]) for group in groups][
            1
        ]

    def _plain_arguments(self, node: Node, given: list[Unit]) -> Unit:
        for arg, unit in zip(node.args, given, strict=True):
            if not _pure_number(unit):
                wants = "an angle in rad" if FUNCTIONS[node.op].rule == "angle" else "a number without unit"
                raise self._fail(
                    f"{node.op}() takes {wants}, but this is in {shown(unit)}; divide by a quantity of that unit.",
                    arg.start,
                )
        return self._plain_unit()

    def _times(self, node: Node, given: list[Unit]) -> Unit:
        a, b = given
        if a is ZERO or b is ZERO:
            return ZERO
        return None if a is None or b is None else _difference(_angular(node, a * b))

    def _over(self, node: Node, given: list[Unit]) -> Unit:
        a, b = given
        if a is ZERO:
            return ZERO
        if self._counts_from_own_zero(node.args[1]):
            raise self._fail(
                f"This divides by a temperature in {shown(self._own_zero(node.args[1]))}, whose zero is not absolute; "
                "add a constant first, as in (T + zero) with zero = '273.15 K' in constants, or declare it in K.",
                node.args[1].start,
            )
        return None if a is None or b is None or b is ZERO else _difference(_angular(node, a / b))

    def _own_zero(self, node: Node) -> Unit:
        """The unit of a temperature in degC or degF that an expression is proportional to, else None."""
        if node.op == "name" or node.table is not None:
            unit = self.named.get(node.name)
            return unit if temperature(unit) == "from its own zero" else None
        if node.op in ("+", "-") and len(node.args) == 2:
            unit = self.unit(node)
            return unit if temperature(unit) == "from its own zero" else None
        if node.op in ("*", "/", "negative", "+", "-"):
            return next((u for a in node.args if (u := self._own_zero(a)) is not None), None)
        return None

    def _counts_from_own_zero(self, node: Node) -> bool:
        return self._own_zero(node) is not None

    def _power(self, node: Node, given: list[Unit]) -> Unit:
        (base, exponent), number = given, self._exponent(node.args[1])
        if not _pure_number(exponent):
            raise self._fail(
                f"An exponent must be a number without unit, but this is in {shown(exponent)}.", node.args[1].start
            )
        if base is None or base is ZERO:
            return base
        if number is not None:
            if (number == 4 or number % 1 or number < 0) and self._counts_from_own_zero(node.args[0]):
                raise self._fail(
                    f"This power is of a temperature in {shown(base)}, whose zero is not absolute; add a "
                    "constant first, as in (T + zero)^4 with zero = '273.15 K' in constants, or declare it in K.",
                    node.place,
                )
            return _raised(base, number)
        if not _pure_number(base):
            message = (
                f"A quantity in {shown(base)} has a power that is not a fixed number; divide it by a reference "
                f"in {shown(base)} first."
            )
            raise self._fail(message, node.place)
        return self._plain_unit()

    def _exponent(self, node: Node) -> float | None:
        if node.op == "number":
            return node.number
        return self.numbers.get(node.name) if node.op == "name" else None


def is_pi(number: float) -> bool:
    """Whether a number turns cycles into radians, or back: a half multiple of pi, or a few digits of one that is often
    written, or squared."""
    halves = abs(number) / (0.5 * math.pi)
    if 0.5 < halves < MOST_HALVES and math.isclose(halves, round(halves), rel_tol=1e-12):
        return True
    often = [k * math.pi**n for k in (1.0, 2.0, 4.0) for n in (1, 2)]
    return any(
        math.isclose(abs(number), v, rel_tol=1e-3) or math.isclose(abs(number) * v, 1.0, rel_tol=1e-3) for v in often
    )


def _has_pi(node: Node) -> bool:
    """Whether pi is a factor of a product."""
    if node.op == "number":
        return is_pi(node.number)
    if node.op in ("*", "/", "negative"):
        return any(map(_has_pi, node.args))
    return node.op == "**" and _has_pi(node.args[0])


def _angular(node: Node, unit: Unit) -> Unit:
    """The unit of a product; pi as one of its factors turns Hz into 1/s, beside which rad/s may stand, and rad/s into
    1/s, beside which Hz may."""
    if not any(map(_has_pi, node.args)):
        return unit
    turned = "hertz" if "hertz" in unit._units else "radian" if node.op == "/" and "radian" in unit._units else None
    if turned is None:
        return unit
    power = unit._units[turned]
    found = unit / units.parse(turned) ** power
    return found / units.parse("s") ** power if turned == "hertz" else found


def temperature(unit: Unit) -> str | None:
    """What kind of temperature a unit tells: "absolute" (K), "from its own zero" (degC), "difference" (delta_degC),
    None: none."""
    if (
        unit is None
        or unit is ZERO
        or list(unit._units.values()) != [1]
        or units.dimension(unit) != units.dimension("K")
    ):
        return None
    return "difference" if units.is_difference(unit) else "from its own zero" if units.is_point(unit) else "absolute"


def _difference(unit: Unit) -> Unit:
    """A temperature that came of a product or a difference, which may stand beside degC and K."""
    if (
        unit is None
        or unit is ZERO
        or units.dimension(unit) != units.dimension("K")
        or not math.isclose(_factor(unit), 1.0, rel_tol=1e-9)
    ):
        return unit
    return units.parse("delta_degC")


def _factor(unit: Unit) -> float:
    """How many base units one `unit` is (rad counts as a base unit)."""
    factor: Any = units.registry().get_base_units(unit)[0]
    return float(factor)


def _plain(unit: Unit) -> bool:
    return all(abs(power) < 1e-9 for power in unit.dimensionality.values())


def _ratio_of_alike(unit: Unit) -> bool:
    """Whether it is a pure number that two units of one kind leave, as Pa/bar: a unit for no number of its own."""
    return _plain(unit) and len(dict(unit._units)) > 1 and not math.isclose(_factor(unit), 1.0, rel_tol=1e-9)


def _pure_number(unit: Unit) -> bool:
    """Without dimension and in units of 1 or percent: not deg, not mm/m."""
    if unit is None or unit is ZERO:
        return True
    return _plain(unit) and any(math.isclose(_factor(unit), f, rel_tol=1e-9) for f in (1.0, _PERCENT))


def _turns_against_radians(a: Unit, b: Unit) -> bool:
    """Hz beside rad/s: the same dimension and, for pint, the same factor."""
    return units.dimension(a) == units.dimension(b) and not units.compatible(a, b)


def _raised(unit: Unit, power: float) -> Unit:
    return unit if unit is None or unit is ZERO else unit**power


def _how(found: Unit, wanted: Unit) -> str:
    """What to do about a misfit."""
    if not _plain(found / wanted):
        return "; these are different kinds of quantity, check the equation and the declared units"
    if _turns_against_radians(found, wanted):
        of_hertz = any(name.endswith("hertz") for name in {*found._units, *wanted._units})
        more = ", or multiply it by 2*pi" if of_hertz else ""
        return f"; these do not say how many radians one of them is: {units.turns_said(found, wanted)}{more}"
    if {temperature(found), temperature(wanted)} == {"from its own zero", "absolute"} and same(
        found, wanted, shifted=True
    ):
        sign = "+" if temperature(wanted) == "absolute" else "-"
        return (
            f"; 0 degC is 273.15 K and equations convert nothing by themselves: write it {sign} zero, with "
            "zero = '273.15 K' in constants, or declare both in one unit (recordings are converted to it)"
        )
    ratio = _factor(found / wanted)
    return (
        f"; 1 {shown(found)} is {ratio:.6g} {shown(wanted)} and equations "
        "convert nothing by themselves, so declare both in the same unit"
    )


def _spelled(node: Node) -> str:
    return {"where": "if-else", "negative": "-"}.get(node.op, node.op).join("''")
