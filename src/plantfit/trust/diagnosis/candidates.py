"""What may be missing in a model, one row for each kind: what it is called, where it is tried, what it does, how the
study file bounds it.

A new kind is its law in `models/extensions/` with a row in `KINDS` there, the same law on samples in `effects.py`, and
a row here. Other packages bring theirs with the model's side as `extension` (docs/plug-ins.md).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, TypeVar

import numpy as np

from plantfit import units
from plantfit.errors import ModelError
from plantfit.models.extensions.changes import inverse
from plantfit.models.extensions.kinds import Kind
from plantfit.models.extensions.of_packages import loaded, packages_kinds
from plantfit.trust.diagnosis import effects, ranges
from plantfit.trust.diagnosis.ranges import Seen, Tried, joined

Law = Callable[[np.ndarray, np.ndarray, np.ndarray, float, float], effects.Shown]  # of `Behind`


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A kind of addition. `name` takes the signal, as in "dead time of u", with `article` before it; `phrase` takes
    value and signal.

    `bounds` gives those of the study file from the range that was tried (low, high) and the value found. A `level` is
    not nothing at zero. `extension` is the addition to a model that a package brings; those of plantfit are in
    `models/extensions/kinds.py`.
    """

    article: str = "a"
    name: str
    phrase: str
    bounds: Callable[[float, float, float], tuple[float, float]]
    level: bool = False
    extension: Kind | None = None


@dataclass(frozen=True, kw_only=True)
class Before(Candidate):
    """It changes a recorded input: `law(t, u, value, held)` gives the input (n,) that the plant gets instead of u
    (n,) at t (n,) s."""

    place: ClassVar = "before"
    linear: ClassVar = False
    differenced: ClassVar = True
    tried: Callable[[Seen], Tried | None]
    law: Callable[[np.ndarray, np.ndarray, float, bool], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Inside(Candidate):
    """It is a parameter of the compiled model, small effects of which are a straight line.

    `unit` is made of that of the state. `low` bounds it. `size(spread, rate)` of the state is one that would be seen at
    once. It is tried on speeds only (`of_speeds`), and may differ between recordings (`per_recording`). `speed` is the
    prefix of a speed that is fitted beside it, from these `shares` of the spread of the state.
    """

    place: ClassVar = "inside"
    linear: ClassVar = True
    differenced: ClassVar = False
    unit: Callable[[str | None], str | None]
    low: float
    size: Callable[[float, float], float]
    of_speeds: bool = False
    per_recording: bool = False
    speed: str = ""
    shares: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Changing(Inside):
    """A parameter or input of the model that changes with an input, a state or time: of the pairs "K with u" that a
    model has, those whose effect looks best by its derivative are fitted. `unit` is made of that of the signal it
    changes with, `size` of its spread."""


@dataclass(frozen=True, kw_only=True)
class Behind(Candidate):
    """It changes a simulated output: `law(t, y, slopes, value, scale)` gives y (n,) and its derivatives (n, d), both
    divided by `scale`, as the sensor shows them, and the derivative by the value (n,); None where that is
    `differenced`. `linear`: y is a straight line of it."""

    place: ClassVar = "behind"
    tried: Callable[[Seen], Tried | None]
    law: Law
    linear: bool = False
    differenced: bool = False


def part_of_an_output(article: str, name: str, phrase: str) -> Inside:
    """A row for what an output may lack, a column of a regression or a part of a static model: of either sign, in a
    unit and of a size that its signal gives."""
    return Inside(
        article=article, name=name, phrase=phrase, low=-np.inf, bounds=ranges.both_signs, unit=lambda unit: unit,
        size=lambda spread, rate: 1.0,
    )  # fmt: skip


CANDIDATES: dict[str, Before | Inside | Behind] = {
    "dead_time": Before(
        name="dead time of {}", phrase="a dead time of {} on {}", tried=ranges.delay, bounds=ranges.up,
        law=effects.late,
    ),
    "lag": Before(
        name="further lag of {}", phrase="a further lag of {} on {}", tried=ranges.lag, bounds=ranges.by_a_factor,
        law=lambda t, u, value, held: effects.lagged(t, u, max(value, 1e-12), held),
    ),
    "dead_zone": Before(
        name="dead zone of {}", phrase="a dead zone of {} to each side on {}", tried=ranges.zone,
        bounds=ranges.up_to_the_range,
        law=lambda t, u, value, held: effects.dead_zone(u, value),
    ),
    "saturation": Before(
        name="saturation of {}", phrase="a saturation at {} of {}", tried=ranges.limit, bounds=ranges.the_range,
        level=True,
        law=lambda t, u, value, held: np.clip(u, -value, value),
    ),
    "backlash": Before(
        name="backlash of {}", phrase="backlash of {} to each side on {}", tried=ranges.gap,
        bounds=ranges.up_to_the_range,
        law=lambda t, u, value, held: effects.played(u, value),
    ),
    "viscous": Inside(
        article="", name="viscous friction of {}", phrase="viscous friction of {} on {}", low=0.0,
        bounds=ranges.up_to_the_range, of_speeds=True, unit=lambda unit: "1/s",
        size=lambda spread, rate: rate / max(spread, 1e-300),
    ),
    "coulomb": Inside(
        article="", name="dry friction of {}", phrase="dry friction of {} on {}", low=0.0,
        bounds=ranges.up_to_the_range, of_speeds=True,
        unit=lambda unit: None if unit is None else joined(unit, "/s"), size=lambda spread, rate: rate,
    ),
    "stribeck": Inside(
        article="", name="friction of {} that falls with speed", phrase="friction of {} on {} that falls with speed",
        low=0.0,
        bounds=ranges.up_to_the_range, of_speeds=True, unit=lambda unit: None if unit is None else joined(unit, "/s"),
        size=lambda spread, rate: rate, speed="stribeck_speed", shares=(0.03, 0.12),
    ),
    "quadratic": Inside(
        article="", name="drag of {} by its square", phrase="a drag by the square of {} on {}", low=0.0,
        bounds=ranges.up_to_the_range,
        of_speeds=True, unit=lambda unit: None if unit is None else f"1/s/({unit or '1'})",
        size=lambda spread, rate: rate / max(spread, 1e-300) ** 2,
    ),
    "start": Inside(
        article="another", name="initial value of {}", phrase="an initial value that is {} off, of {},", low=-np.inf,
        bounds=ranges.both_signs, unit=units.difference_of, size=lambda spread, rate: spread, per_recording=True,
    ),
    "sensor_lag": Behind(
        name="sensor lag of {}", phrase="a sensor lag of {} on {}", tried=ranges.lag, bounds=ranges.by_a_factor,
        law=effects.sensor_lag, differenced=True,
    ),
    "offset": Behind(
        article="an", name="offset of {}", phrase="an offset of {} on {}", tried=ranges.shift, bounds=ranges.both_signs,
        law=effects.offset, linear=True,
    ),
    "input_offset": Before(
        article="an", name="offset of {}", phrase="an offset of {} on {}", tried=ranges.shift_within,
        bounds=ranges.both_signs,
        law=lambda t, u, value, held: u - value,
    ),
    "drift": Behind(
        name="drift of {}", phrase="a drift of {} on {}", tried=ranges.slope, bounds=ranges.both_signs,
        law=effects.drift, linear=True,
    ),
    "sensor_high": Behind(
        article="an", name="upper end of the sensor of {}", phrase="an upper end at {} of the sensor of {}",
        tried=ranges.upper_end,
        bounds=ranges.around_the_range, level=True, law=effects.sensor_high,
    ),
    "sensor_low": Behind(
        name="lower end of the sensor of {}", phrase="a lower end at {} of the sensor of {}", tried=ranges.lower_end,
        bounds=ranges.around_the_range, level=True, law=effects.sensor_low,
    ),
    "change": Changing(
        name="change of {}", phrase="a relative change of {1} by {0}", low=-np.inf, bounds=ranges.both_signs,
        unit=inverse,
        size=lambda spread, rate: 1.0 / spread,
    ),
}  # fmt: skip
"""In the order in which additions that explain alike are named."""


Place = TypeVar("Place", Before, Inside, Changing, Behind)


def candidates(place: type[Place]) -> dict[str, Place]:
    """The rows of one place, Before, Inside, Changing (which are Inside, too) or Behind: those of plantfit, then
    those of packages that can be used."""
    return {kind: c for kind, c in {**CANDIDATES, **of_packages()[0]}.items() if isinstance(c, place)}


def candidate_of(kind: str) -> Before | Inside | Behind:
    """The row of a kind; raises KeyError for a kind that there is not."""
    return CANDIDATES[kind] if kind in CANDIDATES else of_packages()[0][kind]


@cache
def of_packages() -> tuple[dict[str, Before | Inside | Behind], tuple[str, ...]]:
    """The rows of packages by kind, and a sentence for each that cannot be used.

    What one of them does wrong later raises ModelError, which names it.
    """
    found, told = {}, []
    for kind, plugin in packages_kinds().items():
        try:
            candidate, extension = loaded(plugin)
            if wrong := _wrong(candidate, extension):
                package = plugin.package
                raise ModelError(
                    f"{kind!r} of the package {package} cannot be tried: {wrong}; update or uninstall {package}."
                )
        except ModelError as failure:
            told.append(str(failure))
            continue
        own = {n: _guarded(getattr(candidate, n), kind, plugin.package) for n in _FUNCTIONS if hasattr(candidate, n)}
        found[kind] = replace(candidate, **own)
    return found, tuple(told)


PLACES = {Before: "inputs", Inside: "states", Changing: "changes", Behind: "outputs"}
_FUNCTIONS = ("bounds", "tried", "law", "unit", "size")


def _wrong(candidate: Any, extension: Kind) -> str:
    """Why a candidate of a package cannot be tried; "" where it can."""
    if type(candidate) not in PLACES:
        return f"it is a {type(candidate).__name__}, not a Before, Inside, Changing or Behind"
    if extension.to != PLACES[type(candidate)]:
        return f"it is tried on {PLACES[type(candidate)]}, and its extension is to {extension.to}"
    try:
        told = (
            candidate.name.format("SIGNAL"),
            candidate.phrase.format("VALUE", "SIGNAL"),
            extension.sentence.format("SIGNAL"),
        )
    except (IndexError, KeyError, ValueError):
        told = ("", "", "")
    return (
        ""
        if all("SIGNAL" in text for text in told) and "VALUE" in told[1]
        else "its name, phrase or sentence leaves out the signal or value"
    )


def _guarded(function: Callable[..., Any], kind: str, package: str) -> Callable[..., Any]:
    def called(*given: Any) -> Any:
        try:
            return function(*given)
        except Exception as failure:  # whatever the package does
            what = f"{type(failure).__name__}: {str(failure)[:200]}"
            raise ModelError(
                f"The candidate {kind!r} of the package {package} failed ({what}); update or uninstall {package}."
            ) from failure

    return called
