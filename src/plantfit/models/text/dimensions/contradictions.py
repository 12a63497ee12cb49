"""Declared units that contradict each other whatever the units are that nobody declared.

Who declares few units leaves coefficients of one out: in x' = u - x/tau with u and x in V, u has a hidden 1/s. Such
equations are left alone, for numbers are computed with time in seconds. What is refused makes a value wrong in its own
unit: tau in min, whose numbers are taken as seconds.
"""

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from plantfit import units
from plantfit.errors import EquationError, UnitError
from plantfit.models.text.dimensions.forms import NEAR, Form, Key, System, form_of, unknown
from plantfit.models.text.dimensions.relations import Relation, Relations

OF_LETTERS = ("parameter", "constant")  # their units are looked at first: whatever the signals' units are
_SHARE = math.log(100.0)
_WORD = re.compile(r"[A-Za-zµμ]+")
_SI = {
    "[time]": "s",
    "[length]": "m",
    "[mass]": "kg",
    "[current]": "A",
    "[temperature]": "K",
    "[substance]": "mol",
    "[luminosity]": "cd",
}
_EQUAL = 1e-6  # of a number and a ratio of units
_FEW = 3
_MANY = 12
_COMMON = ("J", "N", "V", "A", "ohm", "F", "H", "W", "Pa", "kg", "m", "m^3", "cm^3", "K", "rad", "rad/s", "1")


@dataclass(frozen=True)
class Known:
    """A declared unit, and the numbers that are in it: a value, or bounds."""

    unit: str
    form: Form
    value: Any = None
    bounds: tuple[Any, Any] | None = None


@dataclass(frozen=True)
class Contradiction:
    """The relation that does not hold, and what would make it hold: the unit that each of these would need.

    `turned`: it is a number that converts the wrong way round.
    """

    relation: Relation
    needed: Mapping[Key, Form]
    turned: bool = False

    def error(self, declared: Mapping[Key, Known], text: str) -> EquationError:
        return EquationError(self.sentence(declared), text, *self.relation.node.place)

    def line(self, declared: Mapping[Key, Known]) -> str | None:
        """What to write where one declaration is in another unit of the same kind; None where that does not help."""
        for key in self._likely(declared):
            unit = self._spelled(key, declared)
            if key[0] in OF_LETTERS and self.alike(key, declared) and unit is not None:
                return f"Write {line_to_write(key, unit, declared[key])}."
        return None

    def sentence(self, declared: Mapping[Key, Known]) -> str:
        """What is wrong and what to write."""
        what = self.relation.what
        if self.turned:
            number = f"{self.relation.node.number:.12g}"
            return (
                f"{what}: {number} converts a unit the wrong way round; divide "
                "by it where it multiplies, or multiply where it divides."
            )
        if not self.needed:
            named = sorted(n for n in self.relation.node.names() if any(key[1] == n for key in declared))
            return (
                f"{what}: the declared units contradict each "
                f"other{f'; check those of {_listed(named)}' if named else ''}."
            )
        key, *rest = self._likely(declared)
        (kind, name), known, unit, alike = key, declared[key], self._spelled(key, declared), self.alike(key, declared)
        said = f"{what}: {kind} {name!r} has the unit {known.unit!r}"
        if not known.form.dimensions and known.form.pure:
            said = f"{what}: {kind} {name!r} is declared as a number without unit"
        others = [f"{n!r} ({declared[k, n].unit})" for k, n in rest[:3] if declared[k, n].unit]
        other = f", or correct the unit of {_listed(others)}" if others else ""
        needs = "must be a number without unit" if unit == "1" else f"must be in {unit}"
        if unit is None and alike:
            times = math.exp(self.needed[key].size - known.form.size)
            return f"{said}, but the other units here need one that is {times:.6g} times as large; correct it{other}."
        if unit is None:
            return f"{said}, which does not fit the other units here; correct it{other}."
        if not alike:
            return f"{said}, but {needs}: that is another kind of quantity. Correct the unit or the equation{other}."
        why = "equations compute in the units declared, with time in s, and convert nothing by themselves"
        if kind in OF_LETTERS:
            return f"{said}, but {needs}: {why}. Write {line_to_write(key, unit, known)}{other}."
        if kind == "state":
            return f"{said}, but {needs}: {why}. Declare it in {unit}{other}."
        return f"{said}, but {needs}: {why}. Declare it in {unit}, to which recordings are converted{other}."

    def _likely(self, declared: Mapping[Key, Known]) -> list[Key]:
        """Most likely first: a time that is not in s, then what would be in units without factors, then what can be
        spelled."""

        def rank(key: Key) -> tuple[bool, ...]:
            known, form = declared[key], self.needed[key]
            coherent = abs(form.size) < NEAR < abs(known.form.size)
            return (
                not other_time(known.unit),
                not coherent,
                self._spelled(key, declared) is None,
                key[0] not in OF_LETTERS,
            )

        return sorted(self.needed, key=rank)

    def _spelled(self, key: Key, declared: Mapping[Key, Known]) -> str | None:
        unit = spelled(self.needed[key], declared[key].unit, (d.unit for d in declared.values()))
        return "degC" if unit == "K" and units.is_point(declared[key].unit) else unit

    def alike(self, key: Key, declared: Mapping[Key, Known]) -> bool:
        """Whether the unit that is needed has the dimensions of the declared one."""
        return self.needed[key].dimensions == declared[key].form.dimensions


def contradiction(relations: Relations, declared: Mapping[Key, Known]) -> Contradiction | None:
    """The first contradiction among declared units, or None."""
    hidden = System()
    # what functions of numbers say comes last, so that it is seen where it alone does not hold
    said = sorted(relations.all, key=lambda r: r.plain)
    # the others need a hidden coefficient whatever the units are
    fair = [r for r in said if hidden.add(r.form) is None]
    letters = {k: known for k, known in declared.items() if k[0] in OF_LETTERS and not known.form.pure}
    for known, forgiven in (
        (letters, _in_percent),
        (declared, lambda r, left: _in_percent(r, left) or _hidden(r, left)),
    ):
        found = _contradiction(fair, relations, known, forgiven)
        if found is not None:
            return found
    return None


Forgiven = Callable[[Relation, Form], bool]


def _contradiction(
    said: Sequence[Relation], relations: Relations, known: Mapping[Key, Known], forgiven: Forgiven
) -> Contradiction | None:
    system = _with_units(known)
    for k, relation in enumerate(said):
        left = system.add(relation.form)
        if left is not None and not forgiven(relation, left):
            return Contradiction(relation, _needed(said[: k + 1], known, forgiven, system.involved))
    for key, (what, node) in relations.factors.items():
        form = system.reduced(unknown(key))
        if form.powers or form.dimensions or form.pure:
            continue
        size = math.exp(form.size)
        if math.isclose(abs(node.number), size, rel_tol=_EQUAL):
            return Contradiction(Relation(form, what, node), {}, turned=True)
        if _no_conversion(abs(node.number), size):
            plain = Relation(unknown(key), what, node)
            system.add(plain.form)
            return Contradiction(plain, _needed([*said, plain], known, forgiven, system.involved))
    return None


def _with_units(known: Mapping[Key, Known]) -> System:
    system = System()
    for key, declared in known.items():
        system.add(unknown(key).over(declared.form), key)
    return system


def _needed(
    said: Sequence[Relation], known: Mapping[Key, Known], forgiven: Forgiven, involved: Collection[Key]
) -> dict[Key, Form]:
    """The units that would make all relations hold, each in place of one that is declared and `involved`; of many
    the likeliest."""
    found: dict[Key, Form] = {}
    names = said[-1].node.names()

    def rank(key: Key) -> tuple[bool, ...]:
        own = known[key]
        return not other_time(own.unit), abs(own.form.size) < NEAR, key[1] not in names

    for key in sorted((k for k in known if k in involved), key=rank)[:_MANY]:
        system = _with_units({k: v for k, v in known.items() if k != key})
        left = ((r, system.add(r.form)) for r in said)
        if all(f is None or forgiven(r, f) for r, f in left) and not (form := system.reduced(unknown(key))).powers:
            found[key] = form
    return found


def _no_conversion(number: float, size: float) -> bool:
    """Whether a number between quantities of one kind, whose units differ in size, converts nothing: 2, where
    minutes should be seconds."""
    converts = math.isclose(number * size, 1.0, rel_tol=_EQUAL)
    return not converts and ((number < 10 and number * 2 == int(number * 2)) or number == 0.25)


def _in_percent(relation: Relation, left: Form) -> bool:
    return relation.plain and not left.dimensions and math.isclose(abs(left.size), _SHARE)


def _hidden(relation: Relation, left: Form) -> bool:
    """Whether a coefficient of one that nobody wrote explains it: per second, or of any unit in a function that
    takes numbers."""
    if relation.plain and left.dimensions:
        return True
    return set(left.dimensions) == {"[time]"} and Form({}, {}, left.size).pure


def spelled(form: Form, like: str, beside: Iterable[str] = ()) -> str | None:
    """A unit as people write it: like another one with its times in s, or with a unit that stands `beside`, or of up
    to three SI units."""
    words = [*_COMMON, *sorted({word for text in beside for word in _WORD.findall(text)})]
    starts = like, with_seconds(like)
    swapped = (
        text.replace(old, new)
        for text in starts
        for old in _WORD.findall(text)
        for new in words
        if old != new and _alike(old, new)
    )
    for text in (starts[1], *swapped, _in_si(form)):
        if text is not None and units.known(text) and form_of(units.parse(text)).over(form).pure:
            return text
    return None


def with_seconds(unit: str) -> str:
    """The same unit with its times in s."""
    return _WORD.sub(lambda found: "s" if _alike(found[0], "s") else found[0], unit)


def other_time(unit: str) -> bool:
    """Whether a unit holds a time that is not in s, as km/h does."""
    return any(_alike(word, "s") and word != "s" for word in _WORD.findall(unit))


def _alike(a: str, b: str) -> bool:
    try:
        return units.compatible(a, b)
    except UnitError:
        return False


def _in_si(form: Form) -> str | None:
    if len(form.dimensions) > _FEW or any(d not in _SI for d in form.dimensions):
        return None
    above, below = ([(_SI[d], abs(p)) for d, p in form.dimensions.items() if (p > 0) == up] for up in (True, False))
    top, bottom = ("*".join(s if p == 1 else f"{s}^{_power(p)}" for s, p in side) for side in (above, below))
    return (top or "1") + (f"/({bottom})" if len(below) > 1 else f"/{bottom}" if below else "")


def _power(power: Any) -> str:
    return str(power) if power.denominator == 1 else f"{float(power):g}"


def line_to_write(key: Key, unit: str, known: Known) -> str:
    """Unit and numbers of a declaration in another unit."""
    factor = units.factor(known.unit, unit)
    kind, name = key
    if kind == "constant":
        return f'{name} = "{known.value * factor:.12g} {unit}"'
    line = f'unit = "{unit}"'
    if isinstance(known.value, float | int):
        line += f", value = {known.value * factor:.12g}"
    elif known.bounds is not None and all(isinstance(b, float | int) for b in known.bounds):
        line += f", bounds = [{', '.join(f'{b * factor:.12g}' for b in known.bounds)}]"
    else:
        line += f" and its numbers times {factor:.12g}"
    return f"{line} for {name!r}"


def _listed(words: Sequence[str]) -> str:
    return " or ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} or {words[-1]}"
