"""The text of one LLVM function: types, literals, instructions, stack slots and declarations."""

import struct
from collections.abc import Sequence

from plantfit.native.graph.nodes import BOOL, F64, I32, I64, U32, Node

REGISTER = {F64: "double", I64: "i64", I32: "i32", U32: "i32", BOOL: "i1"}
MEMORY = {F64: "double", I64: "i64", I32: "i32", U32: "i32", BOOL: "i8"}
BYTES = {F64: 8, I64: 8, I32: 4, U32: 4, BOOL: 1}
SUFFIX = {"double": "f64", "i64": "i64", "i32": "i32", "i8": "i8", "i1": "i1"}  # of intrinsics

Lanes = list[str]  # operands: one per vector


class FunctionText:
    """Collects the lines of a function. `width` lanes make a vector; `vectors` of them are a block."""

    def __init__(self, width: int, vectors: int):
        self.width, self.vectors = width, vectors
        self.lines: list[str] = []
        self.slots: list[str] = []  # allocas of the entry block
        self.declared: set[str] = set()
        self._count = 0

    # -- lines --------------------------------------------------------------------------------------

    def name(self, stem: str = "v") -> str:
        """A name that is not taken."""
        self._count += 1
        return f"{stem}{self._count}"

    def line(self, text: str) -> None:
        """An instruction without a result."""
        self.lines.append("  " + text)

    def put(self, text: str) -> str:
        """An instruction; its result."""
        name = "%" + self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def label(self, name: str) -> None:
        """The start of a basic block."""
        self.lines.append(f"{name}:")

    def call(self, result: str, function: str, *args: tuple[str, str]) -> str:
        """A call of an intrinsic, declared on first use; args are (type, value)."""
        self.declared.add(f"declare {result} @{function}({', '.join(t for t, _ in args)})")
        return self.put(f"call {result} @{function}({', '.join(f'{t} {v}' for t, v in args)})")

    # -- stack slots --------------------------------------------------------------------------------

    def slot(self, kind: str, count: int = 1) -> str:
        """Memory on the stack; LLVM promotes slots of one number to registers."""
        name = "%" + self.name("s")
        self.slots.append(f"  {name} = alloca {kind}, i64 {count}, align 64")
        return name

    def filled_slots(self, kind: str, values: Sequence[str]) -> list[str]:
        """One slot per value, holding it."""
        slots = [self.slot(kind) for _ in values]
        for slot, value in zip(slots, values, strict=True):
            self.line(f"store {kind} {value}, ptr {slot}")
        return slots

    # -- types, vectors and masks -------------------------------------------------------------------

    def vector(self, kind: str) -> str:
        return f"<{self.width} x {kind}>"

    def type_of(self, dtype: str, vector: bool) -> str:
        return self.vector(REGISTER[dtype]) if vector else REGISTER[dtype]

    def splat(self, kind: str, scalar: str) -> str:
        """A scalar in every lane of a vector."""
        vector = self.vector(kind)
        first = self.put(f"insertelement {vector} poison, {kind} {scalar}, i64 0")
        return self.put(f"shufflevector {vector} {first}, {vector} poison, <{self.width} x i32> zeroinitializer")

    def block(self, kind: str, scalar: str) -> Lanes:
        """A scalar in every lane of a block."""
        return [self.splat(kind, scalar)] * self.vectors

    def both(self, a: Lanes, b: Lanes) -> Lanes:
        """The intersection of two masks."""
        return [self.put(f"and {self.vector('i1')} {x}, {y}") for x, y in zip(a, b, strict=True)]

    def selected(self, dtype: str, vector: bool, masks: Lanes, yes: Lanes, no: Lanes) -> Lanes:
        """`yes` where the mask is set, else `no`."""
        condition, kind = self.type_of(BOOL, vector), self.type_of(dtype, vector)
        return [
            self.put(f"select {condition} {c}, {kind} {a}, {kind} {b}") for c, a, b in zip(masks, yes, no, strict=True)
        ]


def literal(node: Node) -> str:
    """The value of a `const` node."""
    if node.dtype == F64:
        return _hexadecimal(float(node.data))
    if node.dtype == BOOL:
        return "true" if node.data else "false"
    return str(int(node.data))


def float_literal(value: float, vector: bool) -> str:
    """A float64, or a vector of it."""
    return f"splat (double {_hexadecimal(value)})" if vector else _hexadecimal(value)


def _hexadecimal(value: float) -> str:
    return "0x" + struct.pack(">d", value).hex().upper()
