"""Settings of a method as coordinates of a unit cube.

A number turns evenly over its range, or over its decades where the range spans more than two of them; whole
numbers are rounded; words, and settings that cost a compilation for every value, have equal slices.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.errors import SearchError
from plantfit.optimize.contract import Facts
from plantfit.optimize.loop.many_settings import Options, traceable
from plantfit.optimize.registry import known, make
from plantfit.optimize.settings import close_match

FACTOR = 100.0  # a range of many decades is searched this far to either side of the default
DECADES = 2
STEEP = 10.0  # few levels are spread by factors from here on
NUMBERS, WHOLES = 9, 5  # levels of a setting that compiles anew for every value
DIGITS = 6  # significant digits of a value, so that what is written down is what was tried
GENERATIONS = 10  # a population leaves the budget at least so many, unless a range is given


@dataclasses.dataclass(frozen=True)
class Dial:
    """One setting. `levels` are its only values if it has few; else it takes all of [low, high].

    `offset` is added before a logarithm is taken (1 for whole numbers, which may be 0).
    """

    name: str
    default: Any
    levels: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    whole: bool = False

    @property
    def offset(self) -> float:
        return 1.0 if self.whole else 0.0

    def value(self, z: float) -> Any:
        """The value at a place of [0, 1]."""
        if self.levels:
            return self.levels[min(int(z * len(self.levels)), len(self.levels) - 1)]
        low, high = self._ends()
        v = low + min(max(float(z), 0.0), 1.0) * (high - low)
        v = 10.0**v - self.offset if self.log else v
        v = round(v) if self.whole else float(f"{v:.{DIGITS}g}")
        return min(max(v, _as(self.low, self.whole)), _as(self.high, self.whole))

    def place(self, value: Any) -> float:
        """A place with this value, the nearest end for a number outside the range, the middle for anything else."""
        if self.levels:
            return (self.levels.index(value) + 0.5) / len(self.levels) if value in self.levels else 0.5
        low, high = self._ends()
        v = min(max(float(value), self.low), self.high)
        v = math.log10(v + self.offset) if self.log else v
        return (v - low) / (high - low) if high > low else 0.5

    def record(self) -> dict[str, Any]:
        """Plain record: name, default, and values or range with its scale."""
        if self.levels:
            return {"name": self.name, "default": self.default, "values": list(self.levels)}
        ends = [_as(self.low, self.whole), _as(self.high, self.whole)]
        return {"name": self.name, "default": self.default, "range": ends, "scale": "log" if self.log else "linear"}

    def _ends(self) -> tuple[float, float]:
        if not self.log:
            return self.low, self.high
        return math.log10(self.low + self.offset), math.log10(self.high + self.offset)


@dataclasses.dataclass(frozen=True)
class Dials:
    """Settings of the method `method` that are searched; those `held` keep these values, the others their defaults.

    `traced` and `options` are the numbers and the words whose values need no compilation of their own.
    """

    method: str
    dials: tuple[Dial, ...]
    traced: tuple[str, ...] = ()
    options: Options = ()
    held: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def settings(self, z: Sequence[float] | np.ndarray) -> dict[str, Any]:
        """Settings at a cube point (d,)."""
        return {**self.held, **{d.name: d.value(float(place)) for d, place in zip(self.dials, z, strict=True)}}

    def places(self, settings: Mapping[str, Any]) -> np.ndarray:
        """The cube point (d,) of settings."""
        return np.array([d.place(settings[d.name]) for d in self.dials])

    @property
    def defaults(self) -> dict[str, Any]:
        return {**self.held, **{d.name: d.default for d in self.dials}}


def dials_of(
    method: str,
    facts: Facts,
    only: Iterable[str] | None = None,
    ranges: Mapping[str, Sequence[Any]] | None = None,
    held: Mapping[str, Any] | None = None,
) -> Dials:
    """The settings of a registered method that can be searched for runs with these facts.

    `only` names them (by default all that have a range or options), `ranges` narrows them: (low, high) for numbers,
    the words allowed for words. `held` are settings that keep a value of the user's.
    Raises SearchError for names and ranges that do not exist.
    """
    held = dict(held or {})
    template = make(method, **held)
    fields = {
        f.name: f for f in dataclasses.fields(known()[method].kind) if "range" in f.metadata or "options" in f.metadata
    }
    ranges = dict(ranges or {})
    chosen = [n for n in fields if n not in held] if only is None else list(dict.fromkeys(only))
    for name in [*chosen, *ranges]:
        if name not in fields:
            raise SearchError(
                f"Method {method!r} has no setting {name!r} to tune; it has {list(fields)}.{close_match(name, fields)}"
            )
    for name in held:
        if name in chosen:
            raise SearchError(f"Setting {name!r} of method {method!r} is held and also to be tuned; choose one.")
    for name in ranges:
        if name not in chosen:
            raise SearchError(
                f"There is a range for setting {name!r}, which is not among those to tune; name it there too."
            )
    if not chosen:
        raise SearchError(f"There is no setting of method {method!r} to tune; choose another method.")
    population = hasattr(template, "ask")
    numeric = [n for n in chosen if "range" in fields[n].metadata and fields[n].default is not None]
    words = {
        n: _words(_where(method, n), fields[n].metadata["options"], ranges.get(n))
        for n in chosen
        if "options" in fields[n].metadata
    }
    traced, options = traceable(template, numeric, tuple(words.items()), facts) if population else ((), ())  # pyrefly: ignore[bad-argument-type]
    for name in [
        n for n in words if n not in dict(options)
    ]:  # every value compiles anew, and may make a shape of another number
        traced = tuple(
            n for n in traced if all(n in _traced_at(template, {name: w}, traced, options, facts) for w in words[name])
        )
    found = []
    for name in chosen:
        if name in words:
            found.append(Dial(name, fields[name].default, words[name]))
            continue
        smooth = name in traced or (not population and not fields[name].metadata.get("integer", True))
        found.append(
            _dial(method, template, fields[name], ranges.get(name), smooth and fields[name].default is not None, facts)
        )
    return Dials(method, tuple(found), traced, options, held)


def _traced_at(
    template: Any, change: Mapping[str, Any], names: Sequence[str], options: Options, facts: Facts
) -> Sequence[str]:
    """Those of the names that can be data when other settings have changed; all where these contradict the template."""
    try:
        changed = dataclasses.replace(template, **change)
    except SearchError:
        return names
    return traceable(changed, names, options, facts)[0]


def _where(method: str, name: str) -> str:
    return f"setting {name!r} of method {method!r}"


def _dial(
    method: str, template: Any, field: dataclasses.Field, given: Sequence[Any] | None, smooth: bool, facts: Facts
) -> Dial:
    whole, default = field.metadata["integer"], field.default
    if given is None:
        low, high = _sensible(template, field, facts)
    else:
        low, high = _range(_where(method, field.name), given, field.metadata["range"], whole)
    offset = 1 if whole else 0
    log = low + offset > 0 and (high + offset) / (low + offset) > 10**DECADES
    dial = Dial(field.name, default, (), low, high, log, whole)
    if smooth:
        return dial
    dial = dataclasses.replace(dial, log=log or (low > 0 and high / low >= STEEP))
    return dataclasses.replace(dial, levels=_levels(template, dial, given is None, facts))


def _words(where: str, options: Sequence[str], given: Sequence[Any] | None) -> tuple[str, ...]:
    for word in given or ():
        if word not in options:
            raise SearchError(
                f"{word!r} is no value of {where}; use some of {list(options)}.{close_match(str(word), options)}"
            )
    return tuple(dict.fromkeys(given)) if given else tuple(options)


def _range(where: str, given: Sequence[Any], allowed: tuple[float, float], whole: bool) -> tuple[float, float]:
    try:
        low, high = (float(v) for v in given)
    except (TypeError, ValueError):
        raise SearchError(f"The range {given!r} of {where} cannot be read; give two numbers, low and high.") from None
    if not (allowed[0] <= low < high <= allowed[1]):
        raise SearchError(
            f"The range {low:g} to {high:g} of {where} must rise and lie within {allowed[0]:g} to {allowed[1]:g}."
        )
    if whole and (low != int(low) or high != int(high)):
        raise SearchError(f"The range {low:g} to {high:g} of {where} must end at whole numbers.")
    return low, high


def _sensible(template: Any, field: dataclasses.Field, facts: Facts) -> tuple[float, float]:
    """The range of the setting, no further than FACTOR from its default where it spans many decades."""
    low, high = (float(v) for v in field.metadata["range"])
    middle: Any = field.default
    if field.name.endswith("population"):
        if middle is None and hasattr(template, "rows"):
            middle = template.rows(facts)
        high = max(min(high, facts.budget // GENERATIONS), middle or low)
    if middle is None or middle <= 0 or high / (low if low > 0 else middle) <= 10**DECADES:
        return low, high
    near = max(low, middle / FACTOR), min(high, middle * FACTOR)
    return (float(math.floor(near[0])), float(math.ceil(near[1]))) if field.metadata["integer"] else near


def _levels(template: Any, dial: Dial, free: bool, facts: Facts) -> tuple[Any, ...]:
    """A few values over the range with the default among them, first the method's own choice if that is the default."""
    count = WHOLES if dial.whole else NUMBERS
    values = {dial.value(z) for z in np.linspace(0, 1, count)}
    if isinstance(dial.default, int | float) and dial.low <= dial.default <= dial.high and dial.default not in values:
        # the default takes the place of its neighbour, so that it costs no level
        values.remove(min(values, key=lambda v: abs(dial.place(v) - dial.place(dial.default))))
        values.add(dial.default)
    most = max(facts.budget // GENERATIONS, _rows(template, {}, facts) or 0) if free else facts.budget
    fits = [v for v in sorted(values) if (_rows(template, {dial.name: v}, facts) or 0) <= most]
    levels = (*((None,) if dial.default is None else ()), *fits)
    if not levels:
        raise SearchError(f"No value of setting {dial.name!r} fits a budget of {facts.budget} evaluations; give more.")
    return levels


def _rows(template: Any, change: Mapping[str, Any], facts: Facts) -> int | None:
    """Candidates of one generation; None for a host method and for settings that contradict one another."""
    if not hasattr(template, "rows"):
        return None
    try:
        return dataclasses.replace(template, **change).rows(facts)
    except SearchError:
        return None


def _as(value: float, whole: bool) -> Any:
    return int(value) if whole else float(value)
