"""Units that benches have: one pint registry, built on first use, and the spellings that people write."""

import difflib
import functools
import hashlib
import math
import re
import shutil
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plantfit.errors import UnitError
from plantfit.folders import code_folder

if TYPE_CHECKING:
    import pint


class LogarithmicUnitError(UnitError):
    """A unit of levels, such as dB."""


class GaugeUnitError(UnitError):
    """A unit of pressures above that of the surroundings, such as barg."""


DIMENSIONLESS = ("", "-", "\N{EN DASH}", "1")

# names that pint lacks; prefixes (mNm, kOhm) follow by themselves
_DEFINITIONS = (
    "newton_meter = newton * meter = Nm",
    "newton_meter_second = newton * meter * second = Nms",
    "volt_second = volt * second = Vs",
    "watt_second = watt * second = Ws",
    "ampere_second = ampere * second = As",
    "pwm = count = _ = PWM",
    "tick = count",
    "pulse = count",
    "lsb = count = _ = LSB = digit",
    "@alias ohm = Ohm",
    "pH = [acidity]",  # and not picohenry
)

_PRESSURE = r"(?<![A-Za-z])((?:[mkMhd]|da)?(?:bar|Pa)|k?psi|[Tt]orr|atm?|(?:mm|in)Hg|(?:[mc]?m|in)H2O)"
_END = r"(?![A-Za-z0-9_])"
_GAUGE = re.compile(
    rf"{_PRESSURE}(?:_?[gG]|[ _]?\((?:[gG]|[Gg]auge|rel|ü)\)|[ _](?:[gG]|[Gg]auge|rel(?:ative)?|ü)|[üÜ]){_END}"
)

_SPELLINGS = (
    ("[·⋅•∙\N{MULTIPLICATION SIGN}]", "*"),
    (rf"{_PRESSURE}(?:_?a|[ _]?\((?:a|abs|absolute)\)|[ _]abs(?:olute)?\.?){_END}", r"\1"),
    (r"(?i)(°\s*|\bdeg(ree)?s?[ _.]*|\b)celsius\b|\bcentigrade\b|\bdeg(ree)?s?[ _.]*c\b", "degC"),
    (r"(?i)(°\s*|\bdeg(ree)?s?[ _.]*|\b)fahrenheit\b|\bdeg(ree)?s?[ _.]*f\b", "degF"),
    (r"(?i)(°\s*|\bdeg(ree)?s?[ _.]*|\b)kelvin\b", "kelvin"),
    (r"℃|°\s*C\b|\bdeg\.?\s+C\b", "degC"),
    (r"℉|°\s*F\b|\bdeg\.?\s+F\b", "degF"),
    (r"°", "deg"),
    ("\N{OHM SIGN}", "Ω"),
    (r"\^", "**"),
    (r"\bkgm(?=\s*(\*\*)?\s*2)", "kg*m"),
    (r"(?<=[A-Za-z])\.(?=[A-Za-z])", "*"),
    (r"\b(mm|cm|dm|m|km|ms|s|min|rad|deg|A|K)(-?[1-4])(?![\d.])", r"\1**\2"),
    (r"^\s*/", "1/"),
    (r"\bRPM\b|\bRpm\b|^\s*[Uu]pm\s*$|^\s*UPM\s*$", "rpm"),
    (r"(?:^\s*|(?<=\())(U|tr|r)\s*/\s*(?=(min|s)\b)", "turn/"),  # Umdrehungen, tours, revolutions
    (r"\brev\b", "turn"),
)

_QUANTITY = re.compile(r"\s*(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)(?P<unit>.*)", re.DOTALL)
_SUPERSCRIPT = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
# levels that pint lacks, or has under other names: dBV, dBFS, dB(A), dB/s, bel, cNp; log10 V
_LEVEL = re.compile(
    r"(?<![A-Za-z])(dB(?!ar)\w*|deci[Bb]els?|[cm]?[Bb]els?|[dcm]?Np|nepers?|phon|dex)(?![A-Za-z])|^(log|ln|lg)(10|2|e)?[\s(]"
)
_ALLOWED = re.compile(r"[\w\s*/()+\-.%µμΩ]{1,80}")
_ANGLES = ("radian", "degree", "arcminute", "arcsecond", "grade", "turn", "revolution", "revolutions_per_minute")
_COUNTED = ("count", "pwm", "tick", "pulse", "lsb")
_COMMON = (
    *(
        "s",
        "ms",
        "us",
        "min",
        "h",
        "V",
        "mV",
        "A",
        "mA",
        "ohm",
        "kohm",
        "W",
        "kW",
        "J",
        "N",
        "N*m",
        "m",
        "mm",
        "kg",
        "g",
    ),
    *(
        "rad",
        "deg",
        "rad/s",
        "deg/s",
        "rpm",
        "Hz",
        "degC",
        "K",
        "%",
        "bar",
        "mbar",
        "Pa",
        "kPa",
        "l/min",
        "m^3/h",
        "PWM",
        "counts",
    ),
)


@functools.cache
def registry() -> "pint.UnitRegistry":
    """The one registry; combine units of different origin only through it."""

    built = _with_parsed_definitions()
    for definition in _DEFINITIONS:
        built.define(definition)
    return built


def _with_parsed_definitions() -> "pint.UnitRegistry":
    """A registry of pint from the definitions that it parsed before, which takes a sixth of the time.

    They are pickles, so they are kept where nobody else can write, and a checksum tells whether they are whole.
    """
    with _without_dask():
        import pint

    folder = code_folder(f"pint-{pint.__version__}")
    if folder is None:
        return pint.UnitRegistry()
    kept = folder / "definitions"
    try:
        if (kept / _SUM).read_text("ascii") == _checksum(kept):
            return pint.UnitRegistry(cache_folder=kept)
    except Exception:  # not there yet; or not to be read, or damaged, which raises many kinds
        pass
    try:
        fresh = Path(tempfile.mkdtemp(dir=folder))
        built = pint.UnitRegistry(cache_folder=fresh)
        (fresh / _SUM).write_text(_checksum(fresh), "ascii")
        shutil.rmtree(kept, ignore_errors=True)
        try:
            fresh.rename(kept)  # at once, so that no other process sees half of it
        except OSError:  # another process was quicker
            shutil.rmtree(fresh, ignore_errors=True)
    except OSError:  # a disk that is full, or cannot be written, costs time only
        return pint.UnitRegistry()
    return built


@contextmanager
def _without_dask() -> Generator[None]:
    """In a command, pint is imported as where Dask is not installed: it would load it whole, in three times its own
    time.

    Only in a command, since pint then takes no arrays of Dask as magnitudes in this process.
    """
    hidden = "plantfit.cli.start" in sys.modules and not {"dask", "pint"} & sys.modules.keys()
    if hidden:
        sys.modules["dask"] = None  # pyrefly: ignore[unsupported-operation]  # what `import` takes for "there is none"
    try:
        yield
    finally:
        if hidden:
            del sys.modules["dask"]


_SUM = "sha256"


def _checksum(folder: Path) -> str:
    """Of the names and bytes of all files of a folder but the one that holds it."""
    found = hashlib.sha256()
    for file in sorted(f for f in folder.iterdir() if f.name != _SUM):
        content = file.read_bytes()
        found.update(f"{file.name} {len(content)} ".encode() + content)
    return found.hexdigest()


def parse(unit: "str | pint.Unit") -> "pint.Unit":
    """The pint unit for a text such as "V s/rad", "°C", "kg·m²" or "l/min".

    "", "-" and "1" are dimensionless. Temperatures inside a product or quotient ("degC/s") count
    as differences. Raises UnitError with close matches.
    """
    if not isinstance(unit, str):
        return unit
    return _parse(unit)


@functools.lru_cache(maxsize=4096)
def _parse(text: str) -> "pint.Unit":
    spelled = _spell(text.strip())
    if spelled in DIMENSIONLESS:
        return registry().parse_units("")
    if _LEVEL.search(text.strip()):
        raise LogarithmicUnitError(f"Unit {text!r} is logarithmic; convert the values to a linear unit first.")
    if (plain := gauge(text)) is not None:
        raise GaugeUnitError(
            f"Unit {text!r} counts from the pressure of the surroundings; write {plain!r}, and where absolute "
            f"pressures are meant add that pressure to the numbers, {surroundings(plain):.6g} {plain} as a rule."
        )
    # towers of powers would keep pint busy for ever
    if not _ALLOWED.fullmatch(spelled) or re.search(r"\d{4}|\*\*[^A-Za-z]*\*\*", spelled):
        raise UnitError(f"{text!r} is not a unit; write for example 'rad/s', 'N*m' or 'degC'.")
    try:
        found = registry().parse_units(spelled)
        found.dimensionality  # noqa: B018  (some texts fail only here)
    except Exception as error:  # pint's parser raises many kinds on free text
        raise UnitError(f"{text!r} is not a known unit{_suggestion(spelled, error)}") from None
    if any("decibel" in name or "neper" in name or name in ("decade", "octave") for name in found._units):
        raise LogarithmicUnitError(f"Unit {text!r} is logarithmic; convert the values to a linear unit first.")
    if not _has_a_size(found):
        raise UnitError(
            f"Unit {text!r} is too large or too small to be a number of SI units; write for example 'mm**2' or 'rad/s'."
        )
    return found


def _has_a_size(unit: "pint.Unit") -> bool:
    """Whether the unit is a number of base units: a mm to the power of 1e9 is 0 of them, a km too many."""
    try:
        size: Any = registry().get_base_units(unit)[0]
    except OverflowError:
        return False
    return 0.0 < float(size) < math.inf


def _spell(text: str) -> str:
    text = _GAUGE.sub(r"\1", text)  # in a product or quotient, where it counts as a difference
    text = re.sub(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+", lambda run: "**" + run.group().translate(_SUPERSCRIPT), text)
    for pattern, replacement in _SPELLINGS:
        text = re.sub(pattern, replacement, text)
    return text


def _suggestion(text: str, error: Exception) -> str:
    names = getattr(error, "unit_names", ())
    unknown = (names if isinstance(names, str) else (names[0] if names else "")) or text
    close = difflib.get_close_matches(unknown, _COMMON, n=3, cutoff=0.6)
    rare = difflib.get_close_matches(unknown, [str(name) for name in registry()._units], n=3, cutoff=0.8)
    close += [name for name in rare if name not in close]
    if not close:
        return "; write for example 'rad/s', 'N*m' or 'degC'."
    return f"; did you mean {' or '.join(repr(name) for name in close[:3])}?"


def known(unit: str) -> bool:
    """Whether `parse` understands the text."""
    try:
        parse(unit)
    except UnitError:
        return False
    return True


def logarithmic(unit: str) -> bool:
    """Whether the text is a unit of levels, such as dB, which `parse` refuses."""
    try:
        parse(unit)
    except LogarithmicUnitError:
        return True
    except UnitError:
        return False
    return False


def gauge(unit: str) -> str | None:
    """The unit without its zero where the text is one of pressures above that of the surroundings: bar of "barg";
    None for other units."""
    found = _GAUGE.fullmatch(unit.strip())
    return found[1] if found is not None else None


def surroundings(unit: str) -> float:
    """The pressure of a standard atmosphere."""
    return float(convert(1.01325, "bar", unit))


def of_another_kind(unit: str) -> bool:
    """Whether `parse` refuses a unit for what its numbers are, levels or pressures above that of the surroundings,
    and not as unknown."""
    return logarithmic(unit) or gauge(unit) is not None


def dimension(unit: "str | pint.Unit") -> Any:
    """Dimensionality of a unit (a comparable, hashable pint UnitsContainer); `%`, `rad` and counts have none."""
    return parse(unit).dimensionality


def compatible(a: "str | pint.Unit", b: "str | pint.Unit") -> bool:
    """Whether values in `a` can be converted to `b`."""
    a, b = parse(a), parse(b)
    return a.dimensionality == b.dimensionality and not _cycles_against_angle(a, b)


def equal(a: "str | pint.Unit", b: "str | pint.Unit") -> bool:
    """Whether a number means the same in both units: in s and in sec, not in min."""
    try:
        factor, offset = factor_offset(a, b)
    except UnitError:
        return False
    return math.isclose(factor, 1.0, rel_tol=1e-9) and offset == 0.0


def factor_offset(source: "str | pint.Unit", target: "str | pint.Unit") -> tuple[float, float]:
    """(factor, offset) with value_in_target = factor * value_in_source + offset.

    Raises UnitError for different dimensions, between Hz, 1/min or counts and angles, where 1 Hz could be 1 rad/s or
    one turn per second and nobody says how many counts a turn has, and between a temperature and a difference of
    temperatures.
    """
    a, b = parse(source), parse(target)
    if a == b and str(a) == str(b):
        return 1.0, 0.0
    if a.dimensionality != b.dimensionality:
        raise UnitError(
            f"Unit {str(source)!r} ({a.dimensionality or 'dimensionless'}) cannot be converted to {str(target)!r} "
            f"({b.dimensionality or 'dimensionless'}); name the unit that the values really have."
        )
    if _cycles_against_angle(a, b):
        raise UnitError(
            f"The units {str(source)!r} and {str(target)!r} do not say how many radians one cycle has; "
            f"{turns_said(a, b)}."
        )
    convert_units = registry().convert
    if (_has_offset(a) and is_difference(b)) or (is_difference(a) and _has_offset(b)):
        raise UnitError(
            f"Of the units {str(source)!r} and {str(target)!r} one is for temperatures and the other for "
            "differences of temperatures; they cannot be converted, so name the unit that the values really have."
        )
    factor = float(convert_units(1.0, _difference(a), _difference(b)))
    zero = float(convert_units(0.0, a, b)) if _has_offset(a) or _has_offset(b) else 0.0
    return factor, zero


def factor(source: "str | pint.Unit", target: "str | pint.Unit") -> float:
    """How many `target` a difference of one `source` is: 1 degC is 1 K. Raises UnitError as `factor_offset` does."""
    a, b = _difference(parse(source)), _difference(parse(target))
    return factor_offset(a, b)[0]


def si_base(unit: "str | pint.Unit") -> tuple[float, float, dict[str, int]] | None:
    """(factor, offset, powers by symbol): value in kg, m, s, A, K, mol, cd and rad = factor * value + offset. None
    for a unit that is not made of whole powers of these, or not known."""
    try:
        parsed = parse(unit)
        # pyrefly: ignore[missing-attribute, bad-argument-count]  (pint's stub of what a registry makes)
        size = registry().Quantity(1.0, _difference(parsed)).to_root_units()
        offset = float(registry().convert(0.0, parsed, "kelvin")) if _has_offset(parsed) else 0.0
    except Exception:  # pint raises many kinds on units that do not convert, as two offsets in one
        return None
    units: Any = size.units
    powers: dict[str, float] = {name: power for name, power in units._units.items() if name not in ("count", "bit")}
    if any(name not in _SI or power != int(power) for name, power in powers.items()):
        return None
    factor = float(size.magnitude) * 1e-3 ** int(powers.get("gram", 0))
    return factor, offset, {_SI[name]: int(power) for name, power in powers.items()}


_SI = {
    "gram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd",
    "radian": "rad",
}  # fmt: skip


def quantity(text: str) -> tuple[float, str]:
    """Number and unit of a text such as "20 degC"; raises UnitError for other texts."""
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise UnitError(f"{text!r} is not a number with a unit; write for example '20 degC'.")
    unit = found["unit"].strip()
    parse(unit)
    return float(found["number"]), unit


def is_point(unit: "str | pint.Unit") -> bool:
    """Whether the zero of a unit is not nothing, as that of degC and degF."""
    return _has_offset(parse(unit))


def is_difference(unit: "str | pint.Unit") -> bool:
    """Whether a unit is that of differences of temperatures only, as delta_degC."""
    parsed = parse(unit)
    return list(parsed._units.values()) == [1] and next(iter(parsed._units)).startswith("delta_")


def difference_of(unit: str | None) -> str | None:
    """The unit of differences: delta_degC of degC, of most others itself."""
    return str(_difference(parse(unit))) if unit is not None and is_point(unit) else unit


def convert(value: Any, source: "str | pint.Unit", target: "str | pint.Unit") -> Any:
    """A number or array in `source` as float64 in `target`; raises UnitError as `factor_offset` does."""
    factor, offset = factor_offset(source, target)
    converted = np.asarray(value, dtype=float) * factor + offset
    return converted if np.ndim(value) else float(converted)


def in_unit(place: str, value: float | str, unit: str | None, difference: bool = False) -> float:
    """A number in `unit`, in which a bare one is taken; a text such as "20 degC" is converted, by its size alone for a
    `difference`.

    `place` begins the sentence where it cannot be. Raises UnitError.
    """
    try:
        return float(value)
    except ValueError:
        pass
    try:
        number, given = quantity(str(value))
    except UnitError as error:
        raise UnitError(f"{place}: {error}") from None
    if unit is None:
        raise UnitError(
            f"{place} = {value!r}: the model has no unit for it, so give a number alone, or declare its unit."
        )
    try:
        return number * factor(given, unit) if difference else float(convert(number, given, unit))
    except UnitError as error:
        raise UnitError(f"{place} = {value!r}: {error}") from None


def per_second(unit: str) -> str:
    """The unit of a time derivative, as text."""
    return "1/s" if unit.strip() in DIMENSIONLESS else f"{unit}/s"


def quotient(above: str, below: str) -> str:
    """The unit of one quantity per another, as text: "V/(rad/s)", "1/K", "%" where `below` is dimensionless."""
    up, down = ("" if unit.strip() in DIMENSIONLESS else unit.strip() for unit in (above, below))
    if not down:
        return up or "1"
    # all of a product stands below the line, however it is written: N·m, N.m, and kgm^2 for kg*m^2
    product = re.search(r"[/* ]", down) or re.search(r"(?<!\*)\*(?!\*)", _spell(down))
    up, down = f"({up})" if "/" in up else up, f"({down})" if product else down
    return f"{up or '1'}/{down}"


def _has_offset(unit: "pint.Unit") -> bool:
    return any(not registry()._units[name].is_multiplicative for name in unit._units if name in registry()._units)


def _difference(unit: "pint.Unit") -> "pint.Unit":
    return registry().Unit(f"delta_{unit}") if _has_offset(unit) else unit


def turns_said(a: "str | pint.Unit", b: "str | pint.Unit") -> str:
    """What to write in place of two units that are not compatible because one of them does not say what part of a
    turn it counts."""
    named = {*parse(a)._units, *parse(b)._units}
    if any(name.endswith("hertz") for name in named):
        return "write 'turn/s' instead of 'Hz' if a cycle is one turn"
    if any(name in _COUNTED for name in named):
        return "make an angle of the counts first (counts_to_angle, or a constant such as '0.001 rad/count')"
    return "write 'rpm' instead of '1/min' if turns are counted"


def _cycles_against_angle(a: "pint.Unit", b: "pint.Unit") -> bool:
    def angle(unit: "pint.Unit") -> bool:
        return any(name.endswith(_ANGLES) for name in unit._units)

    def cycles(unit: "pint.Unit") -> bool:
        return any(name.endswith("hertz") for name in unit._units)

    def counted(unit: "pint.Unit") -> bool:
        # speeds of machines are written in 1/min where turns are meant (DIN), and counts are those of an encoder
        return not angle(unit) and any(name in _COUNTED or name == "minute" for name in unit._units)

    return any((cycles(one) or counted(one)) and angle(other) and not counted(other) for one, other in ((a, b), (b, a)))
