"""Settings of methods: dataclass fields that carry their range and a sentence, and their checks."""

import dataclasses
import difflib
import math
from collections.abc import Iterable
from typing import Any

from plantfit.errors import SearchError


def number(default: float | None, low: float, high: float, sentence: str) -> Any:
    """A number in [low, high]; a default of None means that the method chooses."""
    return dataclasses.field(default=default, metadata={"range": (low, high), "integer": False, "sentence": sentence})


def integer(default: int | None, low: int, high: int, sentence: str) -> Any:
    """A whole number in [low, high]; a default of None means that the method chooses."""
    return dataclasses.field(default=default, metadata={"range": (low, high), "integer": True, "sentence": sentence})


def choice(default: str, options: tuple[str, ...], sentence: str) -> Any:
    """One of a few words."""
    return dataclasses.field(default=default, metadata={"options": options, "sentence": sentence})


def close_match(word: str, known: Iterable[str]) -> str:
    """' Did you mean ...?' when a known word is near, else nothing."""
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


def build(kind: type, name: str, values: dict[str, Any]) -> Any:
    """`kind(**values)` after checking every value against its field. Raises SearchError."""
    known = {f.name: f for f in dataclasses.fields(kind)}
    for key, value in values.items():
        if key not in known:
            raise SearchError(
                f"Method {name!r} has no setting {key!r}; it has {sorted(known)}.{close_match(key, known)}"
            )
        values = {**values, key: _checked(name, known[key], value)}
    return kind(**values)


def _checked(name: str, field: dataclasses.Field, value: Any) -> Any:
    meta, where = field.metadata, f"Setting {field.name!r} of method {name!r}"
    if "options" in meta:
        if value not in meta["options"]:
            raise SearchError(
                f"{where} is {value!r}; use one of {list(meta['options'])}.{close_match(value, meta['options'])}"
            )
        return value
    if "range" not in meta or (value is None and field.default is None):
        return value
    low, high = meta["range"]
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or (isinstance(value, float) and not math.isfinite(value))
    ):
        raise SearchError(f"{where} is {value!r}; give a number from {low:g} to {high:g}.")
    if not low <= value <= high:
        # an int may have any number of digits
        shown = f"{value:g}" if abs(value) < 1e300 else "a number too large to be one"
        raise SearchError(f"{where} is {shown}, outside its range; give a value from {low:g} to {high:g}.")
    if meta["integer"] and int(value) != value:
        raise SearchError(f"{where} is {value!r}; give a whole number from {low:g} to {high:g}.")
    return int(value) if meta["integer"] else float(value)


def describe(kind: type) -> list[dict[str, Any]]:
    """Plain records of the settings: name, default, range or options, sentence."""
    records = []
    for field in dataclasses.fields(kind):
        record = {"name": field.name, "default": field.default, "sentence": field.metadata.get("sentence", "")}
        for key in ("range", "options"):
            if key in field.metadata:
                record[key] = list(field.metadata[key])
        records.append(record)
    return records
