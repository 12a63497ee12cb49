"""Units as products of powers of units that are not known, of base dimensions and of a size; and linear systems of
such products."""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from plantfit import units

Key = tuple[str, str]  # kind and name of what has a unit
NEAR = 1e-9  # of logarithms of sizes


@dataclass(frozen=True)
class Form:
    """The unit prod(powers) * prod(dimensions) * exp(size) base units."""

    powers: Mapping[Key, Fraction] = field(default_factory=dict)
    dimensions: Mapping[str, Fraction] = field(default_factory=dict)
    size: float = 0.0

    def times(self, other: "Form", power: Fraction | int = 1) -> "Form":
        """This unit times a power of another."""
        return Form(
            _sum(self.powers, other.powers, power),
            _sum(self.dimensions, other.dimensions, power),
            self.size + power * other.size,
        )

    def over(self, other: "Form") -> "Form":
        return self.times(other, -1)

    @property
    def pure(self) -> bool:
        """Without dimension and of size 1."""
        return not self.dimensions and abs(self.size) < NEAR


NUMBER = Form()
SECOND = Form(dimensions={"[time]": Fraction(1)})


def unknown(key: Key) -> Form:
    """The unit of something, as yet unknown."""
    return Form({key: Fraction(1)})


@functools.lru_cache(maxsize=4096)
def form_of(unit: Any) -> Form:
    """A pint unit; of a temperature in degC that of its differences."""
    unit = units.parse(units.difference_of(str(unit)) or "") if units.is_point(unit) else unit
    size: Any = units.registry().get_base_units(unit)[0]
    dimensions = {d: fraction(power) for d, power in unit.dimensionality.items()}
    return Form({}, {d: power for d, power in dimensions.items() if power}, math.log(float(size)))


def fraction(power: Any) -> Fraction:
    """A power as a ratio: 0.333... is a third."""
    return Fraction(float(power)).limit_denominator(1000)


class System:
    """Products that are 1, in echelon form. `involved` are the sources of the last contradiction."""

    def __init__(self) -> None:
        self._rows: dict[Key, tuple[Form, frozenset[Key]]] = {}
        self.involved: frozenset[Key] = frozenset()

    def reduced(self, form: Form) -> Form:
        """The form with everything replaced that is known of its units."""
        return self._reduced(form)[0]

    def add(self, form: Form, source: Key | None = None) -> Form | None:
        """Say that a product is 1. Returns what is left of it if that contradicts what was said before, and does not
        take it then."""
        form, used = self._reduced(form)
        used = used if source is None else used | {source}
        if not form.powers:
            self.involved = used
            return None if form.pure else form
        key, power = next(iter(form.powers.items()))
        self._rows[key] = NUMBER.times(form, 1 / power), used
        return None

    def _reduced(self, form: Form) -> tuple[Form, frozenset[Key]]:
        used: frozenset[Key] = frozenset()
        while True:
            key = next((k for k in form.powers if k in self._rows), None)
            if key is None:
                return form, used
            row, sources = self._rows[key]
            form, used = form.times(row, -form.powers[key]), used | sources


def _sum(a: Mapping[Any, Fraction], b: Mapping[Any, Fraction], power: Fraction | int) -> dict[Any, Fraction]:
    found = dict(a)
    for key, value in b.items():
        found[key] = found.get(key, Fraction(0)) + power * value
    return {key: value for key, value in found.items() if value}
