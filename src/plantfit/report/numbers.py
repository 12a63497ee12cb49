"""Numbers and units for people: significant digits, value ± error, intervals.

`ascii_only` writes 1.2e-06 for terminals; else 1.2×10⁻⁶ with a true minus sign.
"""

# ruff: noqa: RUF001 (true minus, times and dash signs are meant)

import re
from math import isfinite

UNKNOWN = "–"
MOST_DIGITS = 8  # of the ends of an interval
_ALONE = re.compile(r"\((\w+)\)")  # one unit in parentheses
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN_EXPONENTS = range(-3, 6)  # 0.001 to 999999 is written without a power of ten


def exponent(value: float, digits: int) -> int:
    """Decimal exponent of a number once it is rounded to `digits` significant digits; 0 for zero."""
    return int(f"{value:.{digits - 1}e}".split("e")[1]) if value else 0


def significant(value: float | None, digits: int = 4, ascii_only: bool = False) -> str:
    """A number with at most `digits` significant digits; whole numbers below 10^6 keep all of theirs."""
    if value is None or not isfinite(value):
        return UNKNOWN
    if value == 0:
        return "0"
    power = exponent(value, digits)
    if power in _PLAIN_EXPONENTS:
        text = f"{value:.{max(0, digits - 1 - power)}f}"
        return _sign(_trim(text), ascii_only)
    return _sign(_trim(f"{value / 10.0**power:.{digits - 1}f}"), ascii_only) + _power(power, ascii_only)


def plus_minus(value: float | None, error: float | None, ascii_only: bool = False) -> str:
    """`value ± error`, the error with 2 significant digits and the value to the same decimal place."""
    if value is None or not isfinite(value):
        return UNKNOWN
    if error is None or not isfinite(error) or error <= 0:
        return significant(value, ascii_only=ascii_only)
    last = exponent(error, 2) - 1
    power = max(_leading(value, last), last + 1)
    if power in _PLAIN_EXPONENTS and last >= -6:
        return f"{_place(value, last, ascii_only)} ± {_place(error, last, ascii_only)}"
    scale, last = 10.0**power, last - power
    return (
        f"({_place(value / scale, last, ascii_only)} ± "
        f"{_place(error / scale, last, ascii_only)}){_power(power, ascii_only)}"
    )


def interval(low: float | None, high: float | None, ascii_only: bool = False) -> str:
    """`low to high`, both to the decimal place of 2 significant digits of half their distance, in at most
    MOST_DIGITS digits; an end that is not zero is not written as one."""
    if low is None or high is None or not (isfinite(low) and isfinite(high)):
        return UNKNOWN
    if high <= low:
        return f"{significant(low, ascii_only=ascii_only)} to {significant(high, ascii_only=ascii_only)}"
    largest = max(abs(low), abs(high))
    last = max(exponent((high - low) / 2, 2) - 1, exponent(largest, 15) - MOST_DIGITS + 1)
    power = max(_leading(largest, last), last + 1)
    if power in _PLAIN_EXPONENTS and last >= -6:
        return f"{_end(low, last, ascii_only)} to {_end(high, last, ascii_only)}"
    scale = 10.0**power
    return (
        f"({_end(low / scale, last - power, ascii_only)} to "
        f"{_end(high / scale, last - power, ascii_only)}){_power(power, ascii_only)}"
    )


def percent(fraction: float | None) -> str:
    """A fraction as per cent with 3 significant digits."""
    return UNKNOWN if fraction is None else f"{significant(100 * fraction, 3)} %"


def count(value: float | None) -> str:
    """A whole number with thin spaces between thousands."""
    return UNKNOWN if value is None else f"{round(value):,}".replace(",", "\u202f")


def seconds(value: float | None) -> str:
    """A duration in the unit that reads best."""
    if value is None:
        return UNKNOWN
    if value < 1:
        return f"{significant(1000 * value, 2)} ms"
    if value < 120:
        return f"{significant(value, 3)} s"
    return f"{int(value // 60)} min {round(value % 60)} s" if value < 7200 else f"{significant(value / 3600, 3)} h"


def unit_label(unit: str | None) -> str:
    """A unit for reading: `N*m*s**2` becomes `N·m·s²`, a difference of temperatures in degC is one in K; nothing for
    unknown or dimensionless ones."""
    if unit is None or unit.strip() in ("", "1", "dimensionless"):
        return ""
    text = unit.strip().replace("^", "**").replace("delta_degree_Celsius", "K").replace("delta_degC", "K")
    text = _ALONE.sub(r"\1", text)
    for digit in "123456789":
        text = text.replace(f"**-{digit}", f"-{digit}".translate(_SUPERSCRIPT)).replace(
            f"**{digit}", digit.translate(_SUPERSCRIPT)
        )
    return text.replace("**", "^").replace("*", "·").replace(" ", "").replace("ohm", "Ω")


def with_unit(name: str, unit: str | None) -> str:
    """`name [unit]`, or the name alone."""
    label = unit_label(unit)
    return f"{name} [{label}]" if label else name


def _leading(value: float, last: int) -> int:
    """Decimal exponent of a number rounded at the place 10^last; `last` for one that rounds to zero."""
    rounded = round(value, -last)
    return exponent(rounded, 15) if rounded else last


def _end(value: float, last: int, ascii_only: bool) -> str:
    """An end of an interval at the decimal place 10^last, or with 2 digits of its own where it would be zero there."""
    small = value != 0.0 and round(value, -last) == 0.0
    return significant(value, 2, ascii_only) if small else _place(value, last, ascii_only)


def _place(value: float, last: int, ascii_only: bool) -> str:
    """A number rounded at the decimal place 10^last."""
    rounded = round(value, -last)
    return _sign(f"{rounded:.{max(0, -last)}f}", ascii_only)


def _trim(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def _sign(text: str, ascii_only: bool) -> str:
    if float(text) == 0:
        text = text.removeprefix("-")
    return text if ascii_only else text.replace("-", "−")


def _power(power: int, ascii_only: bool) -> str:
    return f"e{power:+03d}" if ascii_only else f"×10{str(power).translate(_SUPERSCRIPT)}"
