"""Numbers with units on the command line: 6V, 100Hz, 30s, 2min."""

import re

from plantfit.errors import SpecError

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


def quantity(option: str, text: str | None, unit: str) -> float | None:
    """The number of a text in `unit`, in which a bare number is taken; None for None. Raises SpecError or UnitError."""
    if text is None:
        return None
    value, given = number_and_unit(option, text, unit)
    if given == unit:
        return value
    from plantfit.units import convert

    return convert(value, given, unit)


def number_and_unit(option: str, text: str, default: str) -> tuple[float, str]:
    """(number, unit as written, `default` without one)."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise SpecError(f"{option} {text!r} is no number; write for example {option} 6{default}.")
    return float(match[1]), match[2] or default
