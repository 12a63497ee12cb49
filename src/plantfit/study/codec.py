"""Plain values and exact bytes: what goes into a database column and comes back unchanged."""

import enum
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """JSON types for nested mappings, sequences, arrays, numbers and enums; anything else as its repr."""
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return value
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in (sorted(value, key=repr) if isinstance(value, set | frozenset) else value)]
    if hasattr(value, "tolist"):
        return plain(np.asarray(value).tolist())
    return repr(value)


def strict(value: Any) -> Any:
    """The same with None for numbers that JSON cannot say (NaN, infinities)."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {k: strict(v) for k, v in value.items()}
    if isinstance(value, list):
        return [strict(v) for v in value]
    return value


def to_json(value: Any) -> str:
    """Text that `from_json` turns back exactly, not-finite floats too (repr of a float is exact)."""
    return json.dumps(plain(value), ensure_ascii=False)


def from_json(text: str) -> Any:
    """The value of `to_json`."""
    return json.loads(text)


def to_blob(values: Any) -> bytes:
    """A vector (n,) as little-endian float64, every bit kept."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def from_blob(blob: bytes) -> np.ndarray:
    """The vector (n,) of `to_blob`, float64, read-only."""
    values = np.frombuffer(blob, dtype="<f8").astype(float)
    values.flags.writeable = False
    return values
