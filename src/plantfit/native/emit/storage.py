"""Arrays in memory: their layout, and loads and stores of entries at fixed places.

An array that differs between lanes is interleaved, [entry][lane]; a flat array has one number per entry for all lanes.
A bool is a byte in memory and a bit in a register.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from plantfit.native.emit.llvm_text import BYTES, MEMORY, REGISTER, FunctionText, Lanes
from plantfit.native.graph.nodes import BOOL

UNROLLED = 64  # entries copied one by one; of thousands LLVM takes minutes


@dataclass(frozen=True, eq=False)
class Storage:
    """Where an array of `size` entries is."""

    pointer: str
    dtype: str
    size: int
    flat: bool

    @property
    def align(self) -> int:
        return BYTES[self.dtype]


class Row:
    """The vectors of a number in memory, to be taken by their place; of one that does not vary the number alone."""

    def __init__(self, f: FunctionText, dtype: str, values: Sequence[str] = (), *, varying: bool = True):
        self.f, self.dtype, self.varying, self.kind = f, dtype, varying, _memory_type(f, dtype, varying)
        self.count = f.vectors if varying else 1
        self.pointer = f.slot(self.kind, self.count)
        for u, value in enumerate(values):
            self.store(str(u), value)

    def at(self, u: str) -> str:
        return self.pointer if u == "0" else self.f.put(f"getelementptr {self.kind}, ptr {self.pointer}, i64 {u}")

    def store(self, u: str, value: str) -> None:
        value = to_memory(self.f, self.dtype, value, self.varying)
        self.f.line(f"store {self.kind} {value}, ptr {self.at(u)}, align 8")

    def load(self, u: str) -> str:
        return from_memory(self.f, self.dtype, self.f.put(f"load {self.kind}, ptr {self.at(u)}, align 8"), self.varying)

    def load_all(self) -> Lanes:
        return [self.load(str(u)) for u in range(self.count)]

    def filled(self, value: str) -> list[str]:
        """The lines that store one value in all places."""
        if self.count == 1:
            return [f"  store {self.kind} {value}, ptr {self.pointer}, align 8"]
        whole = f"[{self.count} x {self.kind}]"
        return [f"  store {whole} [{', '.join([f'{self.kind} {value}'] * self.count)}], ptr {self.pointer}, align 8"]


def to_memory(f: FunctionText, dtype: str, value: str, vector: bool) -> str:
    """A register value as it is stored."""
    if dtype != BOOL:
        return value
    return f.put(f"zext {f.type_of(BOOL, vector)} {value} to {_memory_type(f, BOOL, vector)}")


def from_memory(f: FunctionText, dtype: str, value: str, vector: bool) -> str:
    """A loaded value as a register holds it."""
    if dtype != BOOL:
        return value
    return f.put(f"icmp ne {_memory_type(f, BOOL, vector)} {value}, {'zeroinitializer' if vector else '0'}")


def each_entry(f: FunctionText, size: int, do: Callable[[int | str], None]) -> None:
    """`do` for every entry of an array: with its number, of a long array inside a loop with the register that
    counts."""
    if size <= UNROLLED:
        for entry in range(size):
            do(entry)
        return
    head, body, end = f.name("entries"), f.name("entry"), f.name("copied")
    (counter,) = f.filled_slots("i64", ["0"])
    f.line(f"br label %{head}")
    f.label(head)
    entry = f.put(f"load i64, ptr {counter}")
    f.line(f"br i1 {f.put(f'icmp slt i64 {entry}, {size}')}, label %{body}, label %{end}")
    f.label(body)
    do(entry)
    f.line(f"store i64 {f.put(f'add i64 {entry}, 1')}, ptr {counter}")
    f.line(f"br label %{head}")
    f.label(end)


def entry_pointer(f: FunctionText, s: Storage, entry: int | str, u: int = 0) -> str:
    """The address of an entry, of its vector `u` when interleaved."""
    if isinstance(entry, str):
        index = entry
        if not s.flat:
            block = f.put(f"mul i64 {entry}, {f.vectors}")
            index = f.put(f"mul i64 {f.put(f'add i64 {block}, {u}')}, {f.width}")
        return f.put(f"getelementptr {MEMORY[s.dtype]}, ptr {s.pointer}, i64 {index}")
    index = entry if s.flat else (entry * f.vectors + u) * f.width
    return f.put(f"getelementptr {MEMORY[s.dtype]}, ptr {s.pointer}, i64 {index}") if index else s.pointer


def load_at(f: FunctionText, s: Storage, pointers: Lanes) -> Lanes:
    """The scalar (flat) or the vectors at these addresses."""
    kind = _memory_type(f, s.dtype, not s.flat)
    raw = [f.put(f"load {kind}, ptr {p}, align {s.align}") for p in pointers]
    return [from_memory(f, s.dtype, v, not s.flat) for v in raw]


def store_at(f: FunctionText, s: Storage, pointers: Lanes, values: Lanes) -> None:
    """Store a scalar (flat) or vectors at these addresses."""
    kind = _memory_type(f, s.dtype, not s.flat)
    for pointer, value in zip(pointers, values, strict=True):
        f.line(f"store {kind} {to_memory(f, s.dtype, value, not s.flat)}, ptr {pointer}, align {s.align}")


def read_entry(f: FunctionText, s: Storage, entry: int | str) -> Lanes:
    """An entry: one scalar (flat) or its vectors."""
    kind = _memory_type(f, s.dtype, not s.flat)
    raw = [
        f.put(f"load {kind}, ptr {entry_pointer(f, s, entry, u)}, align {s.align}")
        for u in range(1 if s.flat else f.vectors)
    ]
    return [from_memory(f, s.dtype, v, not s.flat) for v in raw]


def write_entry(f: FunctionText, s: Storage, entry: int | str, values: Lanes) -> None:
    """Store an entry."""
    kind = _memory_type(f, s.dtype, not s.flat)
    for u, value in enumerate(values):
        value = to_memory(f, s.dtype, value, not s.flat)
        f.line(f"store {kind} {value}, ptr {entry_pointer(f, s, entry, u)}, align {s.align}")


def copy(f: FunctionText, source: Storage, target: Storage, masks: Lanes | None = None) -> None:
    """Copy all entries; lanes outside the masks keep theirs."""
    if source.pointer == target.pointer:
        return

    def one(entry: int | str) -> None:
        values = read_entry(f, source, entry)
        if source.flat and not target.flat:
            values = f.block(REGISTER[source.dtype], values[0])
        if masks is not None and not target.flat:
            values = f.selected(target.dtype, True, masks, values, read_entry(f, target, entry))
        write_entry(f, target, entry, values)

    each_entry(f, target.size, one)


def _memory_type(f: FunctionText, dtype: str, vector: bool) -> str:
    return f.vector(MEMORY[dtype]) if vector else MEMORY[dtype]
