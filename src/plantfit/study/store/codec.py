"""Plain values and exact bytes: what goes into a database column and comes back unchanged."""

import enum
import json
import math
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

_NAN = struct.pack(">d", math.nan).hex()
RAW, PACKED = 0, 1  # how a history is kept: as `to_blob`, or as `pack`


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


def spelled(value: float) -> float | str:
    """A float as strict JSON can say it: itself, or "Infinity", "-Infinity", "NaN", "NaN" with its bits if it is
    another one."""
    if math.isfinite(value):
        return value
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    bits = struct.pack(">d", value).hex()
    return "NaN" if bits == _NAN else f"NaN {bits}"


def unspelled(value: float | str) -> float:
    """The inverse of `spelled`; ValueError or TypeError if it is none."""
    if isinstance(value, bool):
        raise TypeError(f"{value} in place of a number")
    if not isinstance(value, str):
        return float(value)
    if value in ("Infinity", "-Infinity", "NaN"):
        return float(value)
    kind, _, bits = value.partition(" ")
    number = struct.unpack(">d", bytes.fromhex(bits))[0] if kind == "NaN" and len(bits) == 16 else 0.0
    if not math.isnan(number):
        raise ValueError(f"{value!r} in place of a number")
    return number


def exact_tree(value: Mapping[str, Any]) -> dict[str, Any] | str:
    """A tree of JSON types as it is, or its `to_json` text where strict JSON could not say a number in it."""
    tree = plain(value)
    try:
        json.dumps(tree, allow_nan=False)
    except ValueError:
        return to_json(tree)
    return tree


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


def pack(values: Any) -> bytes:
    """A vector (n,) as `to_blob`, in less room: like bytes of all numbers side by side, then zlib."""
    return zlib.compress(np.frombuffer(to_blob(values), np.uint8).reshape(-1, 8).T.tobytes())


def unpack(blob: bytes, packing: int = PACKED) -> np.ndarray:
    """The vector (n,) of `pack`, or of `to_blob` where `packing` is RAW; float64, read-only."""
    if packing == RAW:
        return from_blob(blob)
    if packing != PACKED:
        raise ValueError(f"packing {packing}")
    columns = np.frombuffer(zlib.decompress(blob), np.uint8).reshape(8, -1)
    return from_blob(columns.T.tobytes())
