"""gather, scatter and dynamic slices as reads and writes of single entries."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.graph.arithmetic import Arithmetic, span
from plantfit.native.graph.nodes import BOOL, F64, I32, I64, Node
from plantfit.native.graph.values import Sparse, Value, array_of, entries, in_memory, load, store
from plantfit.native.unsupported import NativeUnsupported

# isort: split
from jax.lax import GatherDimensionNumbers


def _true(m: Arithmetic) -> Node:
    return m.graph.const(True, BOOL)


def _clamped(m: Arithmetic, index: Node, top: int) -> Node:
    """The index clamped to 0 .. top."""
    low, high = span(index)
    if low < 0:
        index = m.maximum(m.integer(0, index.dtype), index)
    return m.minimum(m.integer(top, index.dtype), index) if high > top else index


def _inside(m: Arithmetic, index: Node, top: int) -> Node:
    """Whether the index is in 0 .. top."""
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
    """The row-major place of one index per axis."""
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


def _write(
    m: Arithmetic, value: Value, starts: Sequence[Node], steps: Sequence[int], new: Node, allowed: Node
) -> Value:
    """The array with the entry at starts + steps replaced where `allowed`; starts are in range."""
    if isinstance(value, np.ndarray) and all(s.op == "const" for s in starts):
        place = tuple(int(s.data) + k for s, k in zip(starts, steps, strict=True))
        changed = value.copy()
        changed[place] = m.select(allowed, new, value[place])
        return changed
    memory = in_memory(m, value)
    return store(m, memory, _flat(m, _moved(m, starts, steps), memory.shape), new, allowed)


def _moved(m: Arithmetic, starts: Sequence[Node], steps: Sequence[int]) -> list[Node]:
    return [m.add(s, m.integer(k, s.dtype)) for s, k in zip(starts, steps, strict=True)]


def dynamic_slice(m: Arithmetic, value: Value, *starts: np.ndarray, slice_sizes: Sequence[int], **_: Any) -> np.ndarray:
    """A window whose start is clamped so that it fits."""
    at = _fitting(m, starts, value.shape, slice_sizes)
    return array_of(tuple(slice_sizes), lambda index: _read(m, value, at, index))


def dynamic_update_slice(m: Arithmetic, value: Value, update: Value, *starts: np.ndarray, **_: Any) -> Value:
    """A window replaced, its start clamped so that it fits."""
    update = entries(m, update)
    at = _fitting(m, starts, value.shape, update.shape)
    for index in np.ndindex(*update.shape):
        value = _write(m, value, at, index, update.item(index), _true(m))
    return value


def _fitting(m: Arithmetic, starts: Sequence[np.ndarray], shape: Sequence[int], sizes: Sequence[int]) -> list[Node]:
    """Starts clamped so that a window of these sizes fits."""
    return [_clamped(m, s.item(), n - k) for s, n, k in zip(starts, shape, sizes, strict=True)]


def gather(
    m: Arithmetic, value: Value, indices: Value, *, dimension_numbers: GatherDimensionNumbers,
    slice_sizes: Sequence[int], mode: Any,
    fill_value: Any, out_shape: tuple[int, ...], **_: Any,
) -> np.ndarray:  # fmt: skip
    """lax.gather; windows out of range are clamped, or filled in the mode that says so."""
    locate = _locator(m, dimension_numbers, value.shape, entries(m, indices), slice_sizes, mode)

    def one(index: tuple[int, ...]) -> Node:
        at = locate(index)
        found = _read(m, value, at.starts, at.steps)
        return m.select(at.inside, found, m.graph.const(_fill(found.dtype, fill_value), found.dtype))

    return array_of(out_shape, one)


def _fill(dtype: str, value: Any) -> Any:
    if value is not None:
        return value
    return {
        "f64": np.nan,
        "i64": np.iinfo(np.int64).min,
        "i32": np.iinfo(np.int32).min,
        "u32": np.iinfo(np.uint32).max,
        "bool": True,
    }[dtype]


def scatter(
    m: Arithmetic,
    value: Value,
    indices: Value,
    updates: Value,
    *,
    how: str,
    dimension_numbers: Any,
    mode: Any,
    **_: Any,
) -> Value | Sparse:
    """lax.scatter ("set") and scatter_add ("add"), entry by entry in order; windows out of range are dropped or
    clamped, by the mode.

    What is added to zeros stays sparse.
    """
    if how not in ("add", "set"):
        raise NativeUnsupported(f"scatter_{how}")
    indices, updates, d, shape = entries(m, indices), entries(m, updates), _as_gather(dimension_numbers), value.shape
    locate = _locator(m, d, shape, indices, _window_sizes(d, len(shape), updates.shape), mode)
    places = ((locate(index), updates.item(index)) for index in np.ndindex(*updates.shape))
    if how == "add" and _all_zero(value):
        return Sparse(
            shape, tuple((_flat(m, _moved(m, at.starts, at.steps), shape), new, at.inside) for at, new in places)
        )
    for at, new in places:
        if how == "add":
            old = _read(m, value, at.starts, at.steps)
            new = m.op("or", old, new) if old.dtype == BOOL else m.add(old, new)
        value = _write(m, value, at.starts, at.steps, new, at.inside)
    return value


def _all_zero(value: Value) -> bool:
    """Whether an array is known to be zeros of float64."""
    return (
        isinstance(value, np.ndarray)
        and value.size > 0
        and all(n.op == "const" and n.dtype == F64 and n.data == 0.0 for n in value.flat)
    )


@dataclass(frozen=True)
class _Location:
    """The entry of an array at starts + steps; starts are clamped, and `inside` tells whether they were in range."""

    starts: list[Node]
    steps: list[int]
    inside: Node


def _locator(
    m: Arithmetic,
    d: GatherDimensionNumbers,
    shape: Sequence[int],
    indices: np.ndarray,
    slice_sizes: Sequence[int],
    mode: Any,
) -> Callable[[tuple[int, ...]], _Location]:
    """Locates, for an index into the result of a gather or the updates of a scatter, the entry that is read or written.

    `inside` is True in modes other than FILL_OR_DROP.
    """
    rank, offset_dims = len(shape), d.offset_dims
    window_dims = _window_dims(d, rank)
    checked = mode.name == "FILL_OR_DROP"

    def locate(index: tuple[int, ...]) -> _Location:
        batch, steps = tuple(i for a, i in enumerate(index) if a not in offset_dims), [0] * rank
        for axis, place in zip(window_dims, offset_dims, strict=True):
            steps[axis] = index[place]
        starts, inside = [m.integer(0, I32)] * rank, _true(m)
        for axis, row in zip(d.operand_batching_dims, d.start_indices_batching_dims, strict=True):
            starts[axis] = m.integer(batch[row], I32)
        for k, axis in enumerate(d.start_index_map):
            start, top = indices[(*batch, k)], shape[axis] - slice_sizes[axis]
            inside = _both(m, inside, _inside(m, start, top)) if checked else inside
            starts[axis] = _clamped(m, start, top)
        return _Location(starts, steps, inside)

    return locate


def _window_dims(d: GatherDimensionNumbers, rank: int) -> list[int]:
    """The axes of the array that offset_dims stand for."""
    return [a for a in range(rank) if a not in (*d.collapsed_slice_dims, *d.operand_batching_dims)]


def _as_gather(d: Any) -> GatherDimensionNumbers:
    """ScatterDimensionNumbers in the terms of the gather that reads the same windows."""
    return GatherDimensionNumbers(
        offset_dims=d.update_window_dims,
        collapsed_slice_dims=d.inserted_window_dims,
        start_index_map=d.scatter_dims_to_operand_dims,
        operand_batching_dims=d.operand_batching_dims,
        start_indices_batching_dims=d.scatter_indices_batching_dims,
    )


def _window_sizes(d: GatherDimensionNumbers, rank: int, updates: Sequence[int]) -> list[int]:
    """The slice_sizes that a scatter implies by the shape of its updates."""
    sizes = [1] * rank
    for axis, place in zip(_window_dims(d, rank), d.offset_dims, strict=True):
        sizes[axis] = updates[place]
    return sizes
