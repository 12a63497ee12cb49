"""gather, scatter and dynamic slices as reads and writes of single entries."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plantfit.native.arithmetic import Arithmetic, span
from plantfit.native.graph import BOOL, F64, I32, I64, Node
from plantfit.native.unsupported import NativeUnsupported
from plantfit.native.values import Pending, Value, array_of, entries, in_memory, load, store


def _true(m: Arithmetic) -> Node:
    return m.graph.const(True, BOOL)


def _clamped(m: Arithmetic, index: Node, top: int) -> Node:
    low, high = span(index)
    if low < 0:
        index = m.maximum(m.integer(0, index.dtype), index)
    return m.minimum(m.integer(top, index.dtype), index) if high > top else index


def _inside(m: Arithmetic, index: Node, top: int) -> Node:
    low, high = span(index)
    inside = _true(m)
    if low < 0:
        inside = m.compare("ge", index, m.integer(0, index.dtype))
    if high > top:
        below = m.compare("le", index, m.integer(top, index.dtype))
        inside = below if inside.op == "const" else m.op("and", inside, below)
    return inside


def _both(m: Arithmetic, a: Node, b: Node) -> Node:
    if a.op == "const":
        return b if a.data else a
    return m.op("and", a, b) if b.op != "const" or not b.data else a


def _flat(m: Arithmetic, starts: Sequence[Node], shape: Sequence[int]) -> Node:
    """The place counted through the array (row-major) of one index per axis."""
    place = m.integer(0, I32)
    for index, stride in zip(starts, np.cumprod([1, *shape[:0:-1]])[::-1].tolist(), strict=True):
        narrow = index.dtype if index.dtype != I64 or max(map(abs, span(index))) >= 2**31 else I32
        term = m.mul(m.convert(index, narrow), m.integer(stride, narrow))
        if term.dtype != place.dtype:
            term, place = m.convert(term, I64), m.convert(place, I64)
        place = m.add(place, term)
    return place


def _read(m: Arithmetic, value: Value, starts: Sequence[Node], steps: Sequence[int]) -> Node:
    """The entry at starts + steps; starts are in range."""
    if isinstance(value, np.ndarray) and all(s.op == "const" for s in starts):
        return value[tuple(int(s.data) + k for s, k in zip(starts, steps, strict=True))]
    memory = in_memory(m, value)
    offset = int(np.ravel_multi_index(tuple(steps), memory.shape)) if memory.shape else 0
    return load(m, memory, _flat(m, starts, memory.shape), offset)


def _write(m: Arithmetic, value: Value, starts: Sequence[Node], steps: Sequence[int], new: Node, allowed: Node) -> Value:
    if isinstance(value, np.ndarray) and all(s.op == "const" for s in starts):
        place = tuple(int(s.data) + k for s, k in zip(starts, steps, strict=True))
        changed = value.copy()
        changed[place] = m.select(allowed, new, value[place])
        return changed
    memory = in_memory(m, value)
    moved = [m.add(s, m.integer(k, s.dtype)) for s, k in zip(starts, steps, strict=True)]
    return store(m, memory, _flat(m, moved, memory.shape), new, allowed)


def dynamic_slice(m: Arithmetic, value: Value, *starts: np.ndarray, slice_sizes: Sequence[int], **_: Any) -> np.ndarray:
    """A window whose start is clamped so that it fits."""
    at = [_clamped(m, s.item(), n - k) for s, n, k in zip(starts, value.shape, slice_sizes, strict=True)]
    return array_of(tuple(slice_sizes), lambda index: _read(m, value, at, index))


def dynamic_update_slice(m: Arithmetic, value: Value, update: Value, *starts: np.ndarray, **_: Any) -> Value:
    """A window replaced, its start clamped so that it fits."""
    update = entries(m, update)
    at = [_clamped(m, s.item(), n - k) for s, n, k in zip(starts, value.shape, update.shape, strict=True)]
    for index in np.ndindex(*update.shape):
        value = _write(m, value, at, index, update.item(index), _true(m))
    return value


def _mode(mode: Any) -> str:
    return mode.name


def gather(
    m: Arithmetic, value: Value, indices: Value, *, dimension_numbers: Any, slice_sizes: Sequence[int], mode: Any, fill_value: Any,
    out_shape: tuple[int, ...], **_: Any,
) -> np.ndarray:  # fmt: skip
    """lax.gather; out-of-range windows are clamped, or filled in the mode that says so."""
    d, indices = dimension_numbers, entries(m, indices)
    rank = len(value.shape)
    collapsed = (*d.collapsed_slice_dims, *d.operand_batching_dims)
    window_dims = [a for a in range(rank) if a not in collapsed]
    batch_dims = [a for a in range(len(out_shape)) if a not in d.offset_dims]
    filled = _mode(mode) == "FILL_OR_DROP"

    def one(index: tuple[int, ...]) -> Node:
        batch, steps = tuple(index[a] for a in batch_dims), [0] * rank
        for axis, place in zip(window_dims, d.offset_dims, strict=True):
            steps[axis] = index[place]
        starts, inside = [m.integer(0, I32)] * rank, _true(m)
        for axis, row in zip(d.operand_batching_dims, d.start_indices_batching_dims, strict=True):
            starts[axis] = m.integer(batch[row], I32)
        for k, axis in enumerate(d.start_index_map):
            start, top = indices[(*batch, k)], value.shape[axis] - slice_sizes[axis]
            inside = _both(m, inside, _inside(m, start, top)) if filled else inside
            starts[axis] = _clamped(m, start, top)
        found = _read(m, value, starts, steps)
        return m.select(inside, found, m.graph.const(_fill(found.dtype, fill_value), found.dtype))

    return array_of(out_shape, one)


def _fill(dtype: str, value: Any) -> Any:
    if value is not None:
        return value
    return {"f64": np.nan, "i64": np.iinfo(np.int64).min, "i32": np.iinfo(np.int32).min, "u32": np.iinfo(np.uint32).max, "bool": True}[
        dtype
    ]


def scatter(m: Arithmetic, value: Value, indices: Value, updates: Value, *, how: str, **params: Any) -> Value | Pending:
    """lax.scatter ("set") and scatter_add ("add"), entry by entry in order; windows out of range are dropped.

    What is added to zeros stays pending.
    """
    if how not in ("add", "set"):
        raise NativeUnsupported(f"scatter_{how}")
    targets = _targets(m, value.shape, indices, updates, **params)
    if how == "add" and _nothing(value):
        shape = value.shape
        sums = []
        for starts, steps, new, inside in targets:
            moved = [m.add(s, m.integer(k, s.dtype)) for s, k in zip(starts, steps, strict=True)]
            sums.append((_flat(m, moved, shape), new, inside))
        return Pending(shape, tuple(sums))
    for starts, steps, new, inside in targets:
        if how == "add":
            old = _read(m, value, starts, steps)
            new = m.op("or", old, new) if old.dtype == BOOL else m.add(old, new)
        value = _write(m, value, starts, steps, new, inside)
    return value


def _nothing(value: Value) -> bool:
    """Whether an array is known to be zeros of float64."""
    return (
        isinstance(value, np.ndarray) and value.size > 0 and all(n.op == "const" and n.dtype == F64 and n.data == 0.0 for n in value.flat)
    )


def _targets(m: Arithmetic, shape: Sequence[int], indices: Value, updates: Value, *, dimension_numbers: Any, mode: Any, **_: Any):
    """(starts, steps, new value, whether it is in range) of every entry that a scatter writes, in order."""
    d, indices, updates = dimension_numbers, entries(m, indices), entries(m, updates)
    rank = len(shape)
    fixed = (*d.inserted_window_dims, *d.operand_batching_dims)
    window_dims = [a for a in range(rank) if a not in fixed]
    batch_dims = [a for a in range(updates.ndim) if a not in d.update_window_dims]
    extent = [1] * rank
    for axis, place in zip(window_dims, d.update_window_dims, strict=True):
        extent[axis] = updates.shape[place]
    for index in np.ndindex(*updates.shape):
        batch, steps = tuple(index[a] for a in batch_dims), [0] * rank
        for axis, place in zip(window_dims, d.update_window_dims, strict=True):
            steps[axis] = index[place]
        starts, inside = [m.integer(0, I32)] * rank, _true(m)
        for axis, row in zip(d.operand_batching_dims, d.scatter_indices_batching_dims, strict=True):
            starts[axis] = m.integer(batch[row], I32)
        for k, axis in enumerate(d.scatter_dims_to_operand_dims):
            start, top = indices[(*batch, k)], shape[axis] - extent[axis]
            if _mode(mode) == "FILL_OR_DROP":
                inside = _both(m, inside, _inside(m, start, top))
            starts[axis] = _clamped(m, start, top)
        yield starts, steps, updates.item(index), inside
