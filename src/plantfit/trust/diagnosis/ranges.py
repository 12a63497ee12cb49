"""The ranges and values at which additions are tried, from what the recordings show, and the bounds that the study file
gets.

Bounds are made of the range that was tried (low, high) and the value that was found.
"""

from dataclasses import dataclass

import numpy as np

from plantfit import units

ROOM = 5.0  # times a value, where its bounds go
LEVELS = (0.999, 0.9, 0.7)  # of the range of a signal at which saturation is tried


@dataclass(frozen=True)
class Seen:
    """What the recordings show of a signal: its `unit` and `values` (k,) in it, the `length` of the shortest
    recording (s), the `period` of the samples (s) and `times` (s) to begin with; `late` where the model gives an
    input a dead time already."""

    unit: str | None
    values: np.ndarray
    length: float
    period: float
    times: tuple[float, ...]
    late: bool = False


@dataclass(frozen=True)
class Tried:
    """The parameter of an addition: its unit, its range (low, high), and the values to begin with; none for linear
    effects."""

    unit: str | None
    low: float
    high: float
    starts: tuple[float, ...] = ()


def rounded(value: float) -> float:
    """To the four digits that a study file gets."""
    return float(f"{value:.4g}")


def joined(unit: str, end: str) -> str:
    """A unit for each second, as in "m/s^2"."""
    if end == "/s" and unit.endswith("/s") and unit.count("/") == 1:
        return f"{unit}^2"
    return f"{unit}{end}" if unit.replace("_", "a").isalpha() else f"({unit or '1'}){end}"


def both_signs(low: float, high: float, value: float) -> tuple[float, float]:
    """Bounds of what may have either sign."""
    size = ROOM * abs(value) or 1.0
    return -rounded(size), rounded(size)


def up(low: float, high: float, value: float) -> tuple[float, float]:
    """Bounds of what is not negative, wherever it was tried."""
    return 0.0, rounded(ROOM * abs(value) or 1.0)


def up_to_the_range(low: float, high: float, value: float) -> tuple[float, float]:
    """Bounds of what is not negative and at most the upper end of its range."""
    return 0.0, rounded(min(ROOM * abs(value) or 1.0, high))


def by_a_factor(low: float, high: float, value: float) -> tuple[float, float]:
    """Bounds of a time constant."""
    return rounded(value / 20.0), rounded(20.0 * value)


def the_range(low: float, high: float, value: float) -> tuple[float, float]:
    """Bounds of a size of an input: that of its range, and a little above."""
    return rounded(low), rounded(high + 0.01 * (high - low))


def around_the_range(low: float, high: float, value: float) -> tuple[float, float]:
    """Bounds of an end of a sensor: its range, and a little to both sides."""
    return rounded(low - 0.01 * (high - low)), rounded(high + 0.01 * (high - low))


def delay(s: Seen) -> Tried | None:
    """Of a dead time; none for an input that has one."""
    return None if s.late else Tried("s", 0.0, 0.3 * s.length, s.times)


def lag(s: Seen) -> Tried:
    """Of the time constant of a lag."""
    return Tried("s", 0.02 * s.period, s.length, s.times)


def _ends(s: Seen) -> tuple[float, float]:
    size = np.abs(s.values)
    return float(np.min(size)), float(np.max(size))


def zone(s: Seen) -> Tried:
    """Of a dead zone of an input."""
    least, top = _ends(s)
    inside = tuple(least + part * (top - least) for part in (0.05, 0.15, 0.35)) if least < top else ()
    # an input that keeps away from zero shows a zone below it as a shift
    below = tuple(part * least for part in (0.3, 0.7)) if least > 0.1 * top else ()
    return Tried(s.unit, 0.0, top, (*below, *inside))


def limit(s: Seen) -> Tried:
    """Of the size at which an input saturates."""
    least, top = _ends(s)
    return Tried(
        s.unit, least + 1e-3 * (top - least), top, tuple(least + part * (top - least) for part in (0.9, 0.7, 0.5))
    )


def gap(s: Seen) -> Tried:
    """Of play on an input."""
    span = float(np.ptp(s.values))
    return Tried(s.unit, 0.0, 0.5 * span, tuple(part * span for part in (0.02, 0.07, 0.2)))


def shift(s: Seen) -> Tried:
    """Of an offset."""
    return Tried(units.difference_of(s.unit), -np.inf, np.inf)


def shift_within(s: Seen) -> Tried:
    """Of an offset of an input, at most its range."""
    span = float(np.ptp(s.values))
    return Tried(units.difference_of(s.unit), -span, span, (0.001 * span,))


def slope(s: Seen) -> Tried:
    """Of a drift."""
    step = units.difference_of(s.unit)
    return Tried(None if step is None else joined(step, "/s"), -np.inf, np.inf)


def upper_end(s: Seen) -> Tried | None:
    """Of the upper end of a sensor; none where its signal does not move."""
    low, high = float(np.min(s.values)), float(np.max(s.values))
    return Tried(s.unit, low, high, tuple(low + part * (high - low) for part in LEVELS)) if high > low else None


def lower_end(s: Seen) -> Tried | None:
    """Of the lower end of a sensor; none where its signal does not move."""
    low, high = float(np.min(s.values)), float(np.max(s.values))
    return Tried(s.unit, low, high, tuple(high - part * (high - low) for part in LEVELS)) if high > low else None
