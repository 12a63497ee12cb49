"""Numbers with units on the command line: 6V, 100Hz, 30s, 2min."""

import re
from collections.abc import Sequence

from plantfit.errors import SpecError, UnitError

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})?\s*\.\.\s*({_NUMBER})?\s*(.*?)\s*")


def quantity(option: str, text: str | None, unit: str, *, difference: bool = False) -> float | None:
    """The number of a text in `unit`, in which a bare number is taken; by its size alone for a `difference`; None for
    None.

    Raises SpecError or UnitError.
    """
    if text is None:
        return None
    value, given = number_and_unit(option, text, unit)
    if given == unit:
        return value
    from plantfit.units import convert, factor

    try:
        return value * factor(given, unit) if difference else convert(value, given, unit)
    except UnitError as error:
        raise UnitError(f"{option} {text!r}: {error}") from None


def number_and_unit(option: str, text: str, default: str) -> tuple[float, str]:
    """(number, unit as written, `default` without one)."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise SpecError(f"{option} {text!r} is not a number with a unit; write for example {option} 6{default}.")
    return float(match[1]), match[2] or default


def ranges_by_name(option: str, texts: Sequence[str]) -> dict[str, tuple[str | None, str | None]]:
    """NAME=LOW..HIGH UNIT as (low, high) texts with the unit, None for an end that is left out; raises SpecError."""
    found: dict[str, tuple[str | None, str | None]] = {}
    for text in texts:
        name, sign, ends = text.partition("=")
        match = _RANGE.fullmatch(ends)
        if not sign or match is None or not (match[1] or match[2]):
            raise SpecError(
                f"{option} {text!r} is not a range; write NAME=LOW..HIGH, "
                f"as in {option} 'T=20..80 degC' or {option} T=..80."
            )
        low, high = (f"{end} {match[3]}".strip() if end else None for end in (match[1], match[2]))
        found[name.strip()] = low, high
    return found


def texts_by_name(option: str, texts: Sequence[str]) -> dict[str, str]:
    """NAME=NUMBER UNIT as texts by name; raises SpecError."""
    found = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign or not value.strip():
            raise SpecError(f"{option} {text!r} cannot be read; write NAME=NUMBER, as in {option} u=5.")
        found[name.strip()] = value.strip()
    return found


def fraction(option: str, text: str) -> float:
    """0.95 of "95%", "95 %" and "0.95"; raises SpecError."""
    number, sign, rest = text.strip().partition("%")
    if rest.strip() or re.fullmatch(_NUMBER, number.strip()) is None:
        raise SpecError(f"{option} {text!r} is not a share; write for example {option} 95%.")
    value = float(number)
    return value / 100.0 if sign or value > 1.0 else value
