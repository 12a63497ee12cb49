"""Headers that are a quotient of a quantity and its unit, as DIN 461 and ISO 80000 write them: t/s, f/mHz, T/°C."""

import re

from plantfit.units import compatible, known

_BASES = (
    "Hz|bar|mol|min|rad|rpm|deg|degC|degF|°C|°F|ohm|Ohm|Wh|VA|Nm|Pa|ppm|pH|h|d|g|l|L|m|s|A|V|W|N|J|K|C|F|T|H|S|%|°|Ω|1"
)
_SYMBOL = rf"(?:[numkMGhcdµμ]?(?:{_BASES}))(?:(?:\^|\*\*)?-?[1-4]|[⁻¹²³⁴]+)?"
_UNIT = re.compile(rf"{_SYMBOL}(?:\s*[·⋅*.\s]\s*{_SYMBOL})*")
# what a letter stands for, and the unit that tells so; of others nothing is known
_LETTERS = {
    "t": "s", "T": "K degC", "p": "Pa", "P": "W", "f": "Hz", "F": "N", "m": "kg", "l": "m", "s": "m", "h": "m",
    "d": "m", "r": "m",
    "V": "m^3", "U": "V", "u": "V", "I": "A", "i": "A", "n": "Hz rpm", "R": "ohm", "L": "H", "C": "F", "E": "J V",
    "W": "J", "Q": "J C",
    "B": "T", "G": "S", "a": "m/s^2", "M": "N*m", "N": "rpm", "J": "kg*m^2", "H": "m",
}  # fmt: skip
# units that stand above a slash in names that are a unit as a whole (km/h, mV/V), or end in one (flow l/min)
_ABOVE = {
    "m", "mm", "cm", "km", "um", "µm", "l", "L", "ml", "g", "kg", "mg", "ug", "µg", "t", "mol", "mmol", "rad", "mrad",
    "deg", "°",
    "°C", "degC", "K", "N", "kN", "Nm", "mNm", "V", "mV", "kV", "A", "mA", "W", "kW", "MW", "J", "kJ", "MJ", "Pa",
    "kPa", "bar",
    "mbar", "r", "rev", "U", "tr", "Umdr", "ft", "in", "lb", "counts", "pulses", "Imp", "steps", "S", "F", "C", "H",
    "T", "R", "M",
    "P",
}  # fmt: skip
_TIMES = re.compile(r"(?:[mµu]?s|min|h|d)(?:\^?2|²)?")
# single letters that are rather names: A/F, air/F, B/C
_ONLY_KNOWN = frozenset(("1", "C", "F", "T", "H", "S", "d", "L"))


def quantity_over_unit(header: str) -> tuple[str, str] | None:
    """(name, unit) of a header such as "Pm/MW"; None of a ratio (a/b), a choice (on/off) and a unit by itself
    (km/h)."""
    name, slash, unit = (part.strip() for part in header.partition("/"))
    if not slash or not re.search(r"[^\W\d_]", name) or not _UNIT.fullmatch(unit) or not known(unit):
        return None
    word = re.split(r"\s", name)[-1]
    if word in _LETTERS and any(compatible(unit, meant) for meant in _LETTERS[word].split()):
        return name, unit
    ending = word.rpartition("_")[2]
    if word in _ABOVE or (ending in _ABOVE and _TIMES.fullmatch(unit)):
        return None
    if unit in _ONLY_KNOWN or (len(word) == 1 and len(unit) == 1 and unit not in "%°Ω"):
        return None
    return name, unit
