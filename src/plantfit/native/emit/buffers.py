"""The buffers of a kernel: addresses of entries, loads and stores of the lanes of a block.

Constants and carry are (entries, G, B), rows and results (G, K, entries, B): G groups of B lanes, K steps. G or B is 1
where a leaf does not vary over it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.llvm_text import BYTES, MEMORY, SUFFIX, Lanes
from plantfit.native.emit.storage import from_memory, to_memory


@dataclass(frozen=True)
class Leaf:
    """One buffer: entries of a type, whether it has a row per step, and what it varies over."""

    dtype: str
    size: int
    rows: bool
    groups: bool
    lanes: bool


class Buffers:
    """Buffers %in0, %in1, ... and %out0, ...; `group`, `lane` and `row` are the registers that addresses refer to.

    In a `narrow` kernel, whose groups end in the last vector of a block, that one is masked and spare lanes repeat the
    first.
    """

    def __init__(self, emitter: Emitter, inputs: Sequence[Leaf], outputs: Sequence[Leaf], narrow: bool):
        self.e, self.inputs, self.outputs, self.narrow = emitter, inputs, outputs, narrow
        self.group = self.lane = self.row = "0"
        self._tail = ""  # mask of the lanes that a narrow group has in its last vector

    def mask_tail(self) -> None:
        """Compute the mask of a narrow group."""
        if self.narrow:
            e = self.e
            numbers = ", ".join(f"i64 {(e.vectors - 1) * e.width + i}" for i in range(e.width))
            self._tail = e.put(f"icmp slt {e.vector('i64')} <{numbers}>, {e.splat('i64', '%B')}")

    def _masked(self, u: int) -> bool:
        return self.narrow and u == self.e.vectors - 1

    def read(self, number: int, entry: int | str) -> Lanes:
        """An entry of an input: one scalar when lanes share it, else its vectors."""
        e, leaf = self.e, self.inputs[number]
        at = self._address(f"%in{number}", leaf, entry)
        kind, align = MEMORY[leaf.dtype], BYTES[leaf.dtype]
        if not leaf.lanes:
            return [from_memory(e, leaf.dtype, e.put(f"load {kind}, ptr {at}, align {align}"), False)]
        vector = e.vector(kind)
        values = []
        spare = e.splat(kind, e.put(f"load {kind}, ptr {at}, align {align}")) if self.narrow else ""
        for u in range(e.vectors):
            place = self._vector_of(kind, at, u)
            if self._masked(u):
                name = f"llvm.masked.load.v{e.width}{SUFFIX[kind]}.p0"
                raw = e.call(
                    vector, name, ("ptr", place), ("i32", str(align)), (e.vector("i1"), self._tail), (vector, spare)
                )
            else:
                raw = e.put(f"load {vector}, ptr {place}, align {align}")
            values.append(from_memory(e, leaf.dtype, raw, True))
        return values

    def write(self, number: int, entry: int, values: Lanes) -> None:
        """Store an entry of an output."""
        e, leaf = self.e, self.outputs[number]
        at = self._address(f"%out{number}", leaf, entry)
        kind, align = MEMORY[leaf.dtype], BYTES[leaf.dtype]
        vector = e.vector(kind)
        for u, value in enumerate(values):
            place = self._vector_of(kind, at, u)
            value = to_memory(e, leaf.dtype, value, True)
            if self._masked(u):
                name = f"llvm.masked.store.v{e.width}{SUFFIX[kind]}.p0"
                e.declared.add(f"declare void @{name}({vector}, ptr, i32, {e.vector('i1')})")
                e.line(f"call void @{name}({vector} {value}, ptr {place}, i32 {align}, {e.vector('i1')} {self._tail})")
            else:
                e.line(f"store {vector} {value}, ptr {place}, align {align}")

    def _vector_of(self, kind: str, pointer: str, u: int) -> str:
        return self.e.put(f"getelementptr {kind}, ptr {pointer}, i64 {u * self.e.width}") if u else pointer

    def _address(self, pointer: str, leaf: Leaf, entry: int | str) -> str:
        """The address of an entry at the current group, lane and row, without the axes that the leaf lacks."""
        e = self.e
        if leaf.rows:
            row = e.put(f"add i64 {e.put(f'mul i64 {self.group}, %K')}, {self.row}") if leaf.groups else self.row
            at = e.put(f"add i64 {e.put(f'mul i64 {row}, {leaf.size}')}, {entry}")
        else:
            at = e.put(f"add i64 {e.put(f'mul i64 %G, {entry}')}, {self.group}") if leaf.groups else str(entry)
        at = e.put(f"mul i64 {at}, {'%B' if leaf.lanes else '1'}")
        if leaf.lanes:
            at = e.put(f"add i64 {at}, {self.lane}")
        return e.put(f"getelementptr {MEMORY[leaf.dtype]}, ptr {pointer}, i64 {at}")
