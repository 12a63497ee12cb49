"""Primitives of lax that rearrange, join or reduce arrays, as numpy operations on arrays of nodes."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from plantfit.native.graph.arithmetic import Arithmetic
from plantfit.native.graph.nodes import F64, Node
from plantfit.native.graph.values import Memory, Value, array_of, entries
from plantfit.native.trace import indexing
from plantfit.native.trace.scalar_rules import SCALAR_RULES
from plantfit.native.unsupported import NativeUnsupported


def _broadcast_in_dim(
    m: Arithmetic, a: Value, *, out_shape: tuple[int, ...], broadcast_dimensions: Sequence[int], **_: Any
) -> np.ndarray:
    a = entries(m, a)
    shape = [1] * len(out_shape)
    for axis, place in enumerate(broadcast_dimensions):
        shape[place] = a.shape[axis]
    return np.broadcast_to(a.reshape(shape), out_shape)


def _reshape(m: Arithmetic, a: Value, *, out_shape: tuple[int, ...], **_: Any) -> Value:
    return Memory(a.node, out_shape, a.offset) if isinstance(a, Memory) else a.reshape(out_shape)


def _slice(
    m: Arithmetic, a: Value, *, start_indices: Sequence[int], limit_indices: Sequence[int], strides: Any, **_: Any
) -> np.ndarray:
    steps = strides or (1,) * len(start_indices)
    return entries(m, a)[tuple(slice(i, j, k) for i, j, k in zip(start_indices, limit_indices, steps, strict=True))]


def _iota(m: Arithmetic, *, out_shape: tuple[int, ...], out_dtype: str, dimension: int, **_: Any) -> np.ndarray:
    return array_of(out_shape, lambda index: m.graph.const(index[dimension], out_dtype))


def _reduction(join: Callable) -> Callable:
    def rule(
        m: Arithmetic, a: Value, *, axes: Sequence[int], out_shape: tuple[int, ...], out_dtype: str, **_: Any
    ) -> np.ndarray:
        a = entries(m, a)
        rest = [i for i in range(a.ndim) if i not in axes]
        flat = np.transpose(a, (*rest, *axes)).reshape(*out_shape, -1)

        def one(index: tuple[int, ...]) -> Node:
            row = list(flat[index])
            if not row:
                raise NativeUnsupported("a reduction of nothing")
            while len(row) > 1:  # pairwise: short dependency chains
                row = [join(m, *row[i : i + 2]) if i + 1 < len(row) else row[i] for i in range(0, len(row), 2)]
            return row[0]

        return array_of(out_shape, one)

    return rule


def _arg_extreme(kind: str) -> Callable:
    def rule(
        m: Arithmetic, a: Value, *, axes: Sequence[int], out_shape: tuple[int, ...], out_dtype: str, **_: Any
    ) -> np.ndarray:
        rows = np.moveaxis(entries(m, a), axes[0], -1)

        def one(index: tuple[int, ...]) -> Node:
            best, place = rows[index][0], m.integer(0, out_dtype)
            for k, node in enumerate(rows[index][1:], 1):
                better = m.compare(kind, node, best)
                if node.dtype == F64:  # the first NaN wins
                    nan = m.op("and", m.compare("ne", node, node), m.compare("eq", best, best))
                    better = m.op("or", better, nan)
                best, place = m.select(better, node, best), m.select(better, m.integer(k, out_dtype), place)
            return place

        return array_of(out_shape, one)

    return rule


def _cumulative(join: Callable) -> Callable:
    def rule(m: Arithmetic, a: Value, *, axis: int, reverse: bool, **_: Any) -> np.ndarray:
        rows = np.moveaxis(entries(m, a), axis, 0)
        out = np.empty(rows.shape, dtype=object)
        order = range(len(rows))
        for k in reversed(order) if reverse else order:
            before = k + 1 if reverse else k - 1
            first = not 0 <= before < len(rows)
            for index in np.ndindex(*rows.shape[1:]):
                out[(k, *index)] = rows[(k, *index)] if first else join(m, out[(before, *index)], rows[(k, *index)])
        return np.moveaxis(out, 0, axis)

    return rule


def _dot_general(
    m: Arithmetic, a: Value, b: Value, *, dimension_numbers: Any, out_shape: tuple[int, ...], **_: Any
) -> np.ndarray:
    (ca, cb), (ba, bb) = dimension_numbers
    a, b = entries(m, a), entries(m, b)
    fa = [i for i in range(a.ndim) if i not in (*ca, *ba)]
    fb = [i for i in range(b.ndim) if i not in (*cb, *bb)]
    a, b = np.transpose(a, (*ba, *fa, *ca)), np.transpose(b, (*bb, *fb, *cb))
    batch, left, inner = len(ba), len(fa), a.shape[len(ba) + len(fa) :]

    def one(index: tuple[int, ...]) -> Node:
        row, column = a[index[: batch + left]], b[(*index[:batch], *index[batch + left :])]
        terms = [m.mul(row[k], column[k]) for k in np.ndindex(*inner)]
        total = terms[0]
        for term in terms[1:]:
            total = m.add(total, term)
        return total

    return array_of(out_shape, one)


def _concatenate(m: Arithmetic, *parts: Value, dimension: int, **_: Any) -> np.ndarray:
    return np.concatenate([entries(m, p) for p in parts], axis=dimension)


def _stack(m: Arithmetic, *parts: Value, axis: int, **_: Any) -> np.ndarray:
    return np.stack([entries(m, p) for p in parts], axis=axis)


def _pad(
    m: Arithmetic, a: Value, fill: np.ndarray, *, padding_config: Any, out_shape: tuple[int, ...], **_: Any
) -> np.ndarray:
    a, node = entries(m, a), fill.item()
    out = array_of(out_shape, lambda _: node)
    for index in np.ndindex(*a.shape):
        place = tuple(low + i * (inner + 1) for i, (low, _, inner) in zip(index, padding_config, strict=True))
        if all(0 <= p < n for p, n in zip(place, out_shape, strict=True)):
            out[place] = a[index]
    return out


def _with(rule: Callable, **fixed: Any) -> Callable:
    return lambda m, *args, **params: rule(m, *args, **{**params, **fixed})


_ADD, _MAX, _MIN = SCALAR_RULES["add"], SCALAR_RULES["max"], SCALAR_RULES["min"]
ARRAY_RULES: dict[str, Callable] = {
    "reshape": _reshape,
    "squeeze": _reshape,
    "expand_dims": _reshape,
    "broadcast_in_dim": _broadcast_in_dim,
    "transpose": lambda m, a, *, permutation, **_: np.transpose(entries(m, a), permutation),
    "rev": lambda m, a, *, dimensions, **_: np.flip(entries(m, a), dimensions),
    "slice": _slice,
    "pad": _pad,
    "concatenate": _concatenate,
    "stack": _stack,
    "iota": _iota,
    "reduce_sum": _reduction(_ADD),
    "reduce_prod": _reduction(SCALAR_RULES["mul"]),
    "reduce_max": _reduction(_MAX),
    "reduce_min": _reduction(_MIN),
    "reduce_and": _reduction(SCALAR_RULES["and"]),
    "reduce_or": _reduction(SCALAR_RULES["or"]),
    "argmin": _arg_extreme("lt"),
    "argmax": _arg_extreme("gt"),
    "cumsum": _cumulative(_ADD),
    "cumprod": _cumulative(SCALAR_RULES["mul"]),
    "cummax": _cumulative(_MAX),
    "cummin": _cumulative(_MIN),
    "dot_general": _dot_general,
    "dynamic_slice": indexing.dynamic_slice,
    "dynamic_update_slice": indexing.dynamic_update_slice,
    "gather": indexing.gather,
    "scatter": _with(indexing.scatter, how="set"),
    "scatter_add": _with(indexing.scatter, how="add"),
    "scatter-add": _with(indexing.scatter, how="add"),
}
