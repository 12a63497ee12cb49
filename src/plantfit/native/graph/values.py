"""Arrays while tracing: numpy arrays of nodes, or memory that is indexed at run time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.native.graph.arithmetic import Arithmetic
from plantfit.native.graph.nodes import BOOL, F64, I32, I64, U32, Node
from plantfit.native.unsupported import NativeUnsupported

LARGEST = 4096  # entries of one array

_DTYPES = {"float64": F64, "int64": I64, "int32": I32, "uint32": U32, "bool": BOOL}


@dataclass(frozen=True, eq=False)
class Memory:
    """A view of an array node: row-major, of a shape, from entry `offset`."""

    node: Node
    shape: tuple[int, ...]
    offset: int = 0

    @property
    def dtype(self) -> str:
        return self.node.dtype


@dataclass(frozen=True, eq=False)
class Sparse:
    """A sparse array: zeros, and sums at entries known at run time, (row-major place, sum, allowed) each."""

    shape: tuple[int, ...]
    sums: tuple[tuple[Node, Node, Node], ...]

    def added_to(self, m: Arithmetic, value: "np.ndarray | Memory") -> "np.ndarray | Memory":
        """A dense array plus this one; only the entries with sums are read and written."""
        together: dict[tuple[int, int], tuple[Node, Node, Node]] = {}
        for place, new, allowed in self.sums:
            key = id(place), id(allowed)
            together[key] = (place, m.add(together[key][1], new) if key in together else new, allowed)
        memory = in_memory(m, value)
        for place, new, allowed in together.values():
            memory = store(m, memory, place, m.add(load(m, memory, place), new), allowed)
        return memory


Value = np.ndarray | Memory


def dtype_of(dtype: Any) -> str:
    """The short name of a jax or numpy dtype; raises NativeUnsupported for the ones without native code."""
    name = np.dtype(dtype).name if not hasattr(dtype, "_rules") else str(dtype)
    if name not in _DTYPES:
        raise NativeUnsupported(f"dtype {name}")
    return _DTYPES[name]


def array_of(shape: tuple[int, ...], at: Callable[[tuple[int, ...]], Node]) -> np.ndarray:
    """An object array of `shape` with at(index) in every place."""
    if int(np.prod(shape)) > LARGEST:
        raise NativeUnsupported(f"an array of shape {shape}")
    out = np.empty(shape, dtype=object)
    for index in np.ndindex(*shape):
        out[index] = at(index)
    return out


def constant(m: Arithmetic, value: Any) -> np.ndarray:
    """Constants of the code."""
    value = np.asarray(value)
    dtype = dtype_of(value.dtype)
    return array_of(value.shape, lambda index: m.graph.const(value[index], dtype))


def entries(m: Arithmetic, value: Value) -> np.ndarray:
    """Every entry as a node."""
    if isinstance(value, np.ndarray):
        return value
    zero = m.integer(0, I32)
    flat = [load(m, value, zero, i) for i in range(int(np.prod(value.shape)))]
    out = np.empty(len(flat), dtype=object)
    out[:] = flat
    return out.reshape(value.shape)


def load(m: Arithmetic, memory: Memory, index: Node, offset: int = 0) -> Node:
    """The entry at `index` + `offset` in row-major order."""
    if index.op == "const":
        offset, index = offset + int(index.data), m.integer(0, I32)
    place, node = memory.offset + offset, memory.node
    if node.op == "pack" and index.op == "const":
        return node.args[place]
    return m.graph.make("load", (node, index), memory.dtype, place)


def in_memory(m: Arithmetic, value: Value) -> Memory:
    """The array in memory; entries that are already contiguous there are not copied."""
    if isinstance(value, Memory):
        return value
    flat = value.reshape(-1).tolist()
    if not flat:
        raise NativeUnsupported("an index into an empty array")
    first = flat[0]
    if first.op == "cload" and all(
        n.op == "cload" and n.data == (first.data[0], first.data[1] + i) for i, n in enumerate(flat)
    ):
        leaf, offset = first.data
        return Memory(m.graph.make("constant", (), first.dtype, leaf, size=offset + len(flat)), value.shape, offset)
    static = (
        first.op == "load" and first.args[1].op == "const"
        and all(n.op == "load" and n.args == first.args and n.data == first.data + i for i, n in enumerate(flat))
    )  # fmt: skip
    if static:
        return Memory(first.args[0], value.shape, first.data)
    return Memory(m.graph.make("pack", tuple(flat), first.dtype, None, size=len(flat)), value.shape)


def store(m: Arithmetic, memory: Memory, index: Node, value: Node, allowed: Node) -> Memory:
    """A new version of the array with one entry changed where `allowed`."""
    if memory.offset or memory.node.size != int(np.prod(memory.shape)):
        memory = in_memory(m, entries(m, memory).copy())
    if memory.node.op == "constant":
        node = m.graph.make("pack", tuple(entries(m, memory).reshape(-1)), memory.dtype, None, size=memory.node.size)
        memory = Memory(node, memory.shape)
    node = m.graph.make("update", (memory.node, index, value, allowed), memory.dtype, None, size=memory.node.size)
    return Memory(node, memory.shape)


def whole(m: Arithmetic, value: Value) -> Memory:
    """The array as the whole of a node that is no input."""
    memory = in_memory(m, value)
    if memory.offset or memory.node.size != int(np.prod(memory.shape)) or memory.node.op == "constant":
        flat = entries(m, memory).reshape(-1)
        return Memory(m.graph.make("pack", tuple(flat), memory.dtype, None, size=len(flat)), memory.shape)
    return memory
