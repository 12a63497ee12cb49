"""LLVM text of a region: every node becomes one instruction per vector, or one scalar instruction when lanes agree.

Values that cross blocks live in stack slots, which LLVM turns into registers. Arrays that differ between lanes lie
interleaved, [entry][lane].
"""

import struct
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from plantfit.native.graph import BOOL, F64, I32, I64, U32, Node, Region, regions_of, walk
from plantfit.native.remember import Remembered
from plantfit.native.unsupported import NativeUnsupported
from plantfit.native.variance import Variance

STACK = 1 << 19  # bytes of arrays that one call may keep on the stack

REGISTER = {F64: "double", I64: "i64", I32: "i32", U32: "i32", BOOL: "i1"}
MEMORY = {F64: "double", I64: "i64", I32: "i32", U32: "i32", BOOL: "i8"}
BYTES = {F64: 8, I64: 8, I32: 4, U32: 4, BOOL: 1}
SUFFIX = {"double": "f64", "i64": "i64", "i32": "i32", "i8": "i8", "i1": "i1"}

_BINARY_F64 = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_BINARY_INT = {"add": "add", "sub": "sub", "mul": "mul", "div": "sdiv", "rem": "srem", "and": "and", "or": "or", "xor": "xor",
               "shl": "shl", "srl": "lshr", "sra": "ashr"}  # fmt: skip
_UNSIGNED = {"div": "udiv", "rem": "urem"}
_UNARY_F64 = {"floor": "floor", "ceil": "ceil", "abs": "fabs", "sqrt": "sqrt", "roundeven": "roundeven", "round": "round"}
_FLOAT_TEST = {"eq": "oeq", "ne": "une", "lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}
_INT_TEST = {"eq": "eq", "ne": "ne", "lt": "slt", "le": "sle", "gt": "sgt", "ge": "sge"}
_UINT_TEST = {"eq": "eq", "ne": "ne", "lt": "ult", "le": "ule", "gt": "ugt", "ge": "uge"}

Lanes = list[str]  # one name per vector


@dataclass(frozen=True, eq=False)
class Storage:
    """Where an array lies: `flat` one number per entry, else interleaved over the lanes."""

    pointer: str
    dtype: str
    size: int
    flat: bool


class Emitter:
    """Collects the text of one function. `width` lanes make a vector, `vectors` of them run together."""

    def __init__(self, width: int, vectors: int, variance: Variance, constant_storage: Callable[[Node, "Emitter"], Storage]):
        self.width, self.vectors, self.variance = width, vectors, variance
        self.lines: list[str] = []
        self.slots: list[str] = []  # at the entry of the function
        self.declared: set[str] = set()
        self.libm: dict[str, int] = {}  # names of C functions and their argument counts
        self.mask: Lanes | None = None  # the lanes that are alive
        self._values: dict[Node, Lanes] = {}
        self._arrays: dict[Node, Storage] = {}
        self._constant_storage = constant_storage
        self.gets: dict[Node, list[Node]] = {}  # the results taken from each loop and branch
        self.groups: dict[Node, Remembered] = {}
        self.at_start: list[str] = []  # stores ahead of the first step of a block
        self._count = 0
        self._stack = 0

    # -- text ---------------------------------------------------------------------------------------

    def name(self, stem: str = "v") -> str:
        self._count += 1
        return f"{stem}{self._count}"

    def line(self, text: str) -> None:
        self.lines.append("  " + text)

    def put(self, text: str) -> str:
        """An instruction with a result."""
        name = "%" + self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def label(self, name: str) -> None:
        self.lines.append(f"{name}:")

    def slot(self, kind: str, count: int = 1) -> str:
        name = "%" + self.name("s")
        self.slots.append(f"  {name} = alloca {kind}, i64 {count}, align 64")
        return name

    def call(self, result: str, function: str, *args: tuple[str, str]) -> str:
        """A call of an intrinsic or helper, declared on first use; args are (type, value)."""
        self.declared.add(f"declare {result} @{function}({', '.join(t for t, _ in args)})")
        return self.put(f"call {result} @{function}({', '.join(f'{t} {v}' for t, v in args)})")

    # -- types and operands -------------------------------------------------------------------------

    def vector(self, kind: str) -> str:
        return f"<{self.width} x {kind}>"

    def type_of(self, dtype: str, varying: bool) -> str:
        return self.vector(REGISTER[dtype]) if varying else REGISTER[dtype]

    def splat(self, kind: str, scalar: str) -> str:
        vector = self.vector(kind)
        first = self.put(f"insertelement {vector} poison, {kind} {scalar}, i64 0")
        return self.put(f"shufflevector {vector} {first}, {vector} poison, <{self.width} x i32> zeroinitializer")

    def varies(self, node: Node) -> bool:
        return self.variance.of(node)

    def lanes(self, node: Node) -> Lanes:
        """One vector operand per vector; a number that all lanes share is spread."""
        if node.op == "const":
            return [f"splat ({REGISTER[node.dtype]} {literal(node)})"] * self.vectors
        if self.varies(node):
            return self._values[node]
        return [self.splat(REGISTER[node.dtype], self._values[node][0])] * self.vectors

    def uniform(self, node: Node) -> str:
        """The operand of a number that all lanes share."""
        return literal(node) if node.op == "const" else self._values[node][0]

    def operands(self, nodes: Sequence[Node], varying: bool) -> list[list[str]]:
        """[vector][argument]; one row when nothing varies."""
        if not varying:
            return [[self.uniform(n) for n in nodes]]
        return [list(row) for row in zip(*(self.lanes(n) for n in nodes), strict=True)]

    def any_lane(self, masks: Lanes) -> str:
        """i1: whether a lane of the masks is set and alive."""
        if self.mask is not None:
            masks = [self.put(f"and {self.vector('i1')} {a}, {b}") for a, b in zip(masks, self.mask, strict=True)]
        total = masks[0]
        for other in masks[1:]:
            total = self.put(f"or {self.vector('i1')} {total}, {other}")
        return self.call("i1", f"llvm.vector.reduce.or.v{self.width}i1", (self.vector("i1"), total))

    @contextmanager
    def alive(self, masks: Lanes | None):
        """Within, only these lanes count."""
        before, self.mask = self.mask, masks
        yield
        self.mask = before

    # -- values and arrays --------------------------------------------------------------------------

    def define(self, node: Node, values: Lanes) -> None:
        self._values[node] = values

    def bind(self, node: Node, storage: Storage) -> None:
        self._arrays[node] = storage

    def storage(self, node: Node) -> Storage:
        if node not in self._arrays and node.op == "constant":
            self._arrays[node] = self._constant_storage(node, self)
        return self._arrays[node]

    def reserve(self, dtype: str, size: int, flat: bool) -> Storage:
        """New memory for an array."""
        count = size if flat else size * self.vectors * self.width
        self._stack += count * BYTES[dtype]
        if self._stack > STACK:
            raise NativeUnsupported(f"arrays of {self._stack} bytes inside a loop")
        return Storage(self.slot(MEMORY[dtype], count), dtype, size, flat)

    def to_memory(self, dtype: str, value: str, vector: bool) -> str:
        if dtype != BOOL:
            return value
        return self.put(f"zext {self.vector('i1') if vector else 'i1'} {value} to {self.vector('i8') if vector else 'i8'}")

    def from_memory(self, dtype: str, value: str, vector: bool) -> str:
        if dtype != BOOL:
            return value
        kind = self.vector("i8") if vector else "i8"
        return self.put(f"icmp ne {kind} {value}, {'zeroinitializer' if vector else '0'}")

    def _place(self, s: Storage, entry: int, u: int = 0) -> str:
        """Pointer to a fixed entry."""
        index = entry if s.flat else (entry * self.vectors + u) * self.width
        return self.put(f"getelementptr {MEMORY[s.dtype]}, ptr {s.pointer}, i64 {index}") if index else s.pointer

    def read_entry(self, s: Storage, entry: int) -> Lanes:
        """A fixed entry: one scalar of a flat array, else its vectors."""
        kind = MEMORY[s.dtype] if s.flat else self.vector(MEMORY[s.dtype])
        count = 1 if s.flat else self.vectors
        raw = [self.put(f"load {kind}, ptr {self._place(s, entry, u)}, align {self._align(s)}") for u in range(count)]
        return [self.from_memory(s.dtype, v, not s.flat) for v in raw]

    def write_entry(self, s: Storage, entry: int, values: Lanes) -> None:
        kind = MEMORY[s.dtype] if s.flat else self.vector(MEMORY[s.dtype])
        for u, value in enumerate(values):
            value = self.to_memory(s.dtype, value, not s.flat)
            self.line(f"store {kind} {value}, ptr {self._place(s, entry, u)}, align {self._align(s)}")

    def _align(self, s: Storage) -> int:
        return BYTES[s.dtype]

    def copy(self, source: Storage, target: Storage, masks: Lanes | None = None) -> None:
        """All entries; under masks the other lanes keep theirs."""
        if source.pointer == target.pointer:
            return
        for entry in range(target.size):
            values = self.read_entry(source, entry)
            if source.flat and not target.flat:
                values = [self.splat(REGISTER[source.dtype], values[0])] * self.vectors
            if masks is not None and not target.flat:
                kind = self.vector(REGISTER[target.dtype])
                old = self.read_entry(target, entry)
                values = [
                    self.put(f"select {self.vector('i1')} {c}, {kind} {a}, {kind} {b}") for c, a, b in zip(masks, values, old, strict=True)
                ]
            self.write_entry(target, entry, values)

    # -- regions ------------------------------------------------------------------------------------

    def region(self, region: Region) -> None:
        """The code of a region, in order."""
        last = last_uses(region)
        for position, node in enumerate(region.code):
            group = self.groups.get(node)
            if group is not None and self.varies(group.index):
                if node is group.nodes[0]:
                    self._remember(group)
                continue
            rule = getattr(self, f"_do_{node.op}", None)
            if node.op == "update":
                self._update(node, in_place=self._owned(node.args[0], region) and last.get(node.args[0]) == position)
            elif rule is not None:
                rule(node)
            else:
                self._plain(node)

    def _remember(self, group: Remembered) -> None:
        """Compute a group again only when the index of some lane has changed; slots keep the results between steps."""
        kind = self.type_of(group.index.dtype, True)
        before = [self.slot(kind) for _ in range(self.vectors)]
        never = -(2 ** (8 * BYTES[group.index.dtype] - 1))  # no index
        self.at_start.extend(f"  store {kind} splat ({REGISTER[group.index.dtype]} {never}), ptr {slot}" for slot in before)
        now = self.lanes(group.index)
        old = [self.put(f"load {kind}, ptr {slot}") for slot in before]
        moved = [self.put(f"icmp ne {kind} {a}, {b}") for a, b in zip(now, old, strict=True)]
        again, same = self.name("moved"), self.name("same")
        with self.alive(None):  # lanes at rest hold whatever belongs to their index
            self.line(f"br i1 {self.any_lane(moved)}, label %{again}, label %{same}")
        self.label(again)
        for slot, value in zip(before, now, strict=True):
            self.line(f"store {kind} {value}, ptr {slot}")
        for node in group.nodes:
            if node.op == "load":
                self._do_load(node)
            else:
                self._plain(node)
        slots: dict[Node, list[str]] = {}
        for node in group.kept:
            whole = self.type_of(node.dtype, self.varies(node))
            slots[node] = self.filled(whole, self._values[node])
            self.at_start.extend(f"  store {whole} zeroinitializer, ptr {slot}" for slot in slots[node])
        self.line(f"br label %{same}")
        self.label(same)
        for node in group.kept:
            self.fetch(node, slots[node])

    def _owned(self, array: Node, region: Region) -> bool:
        """Memory that this region may overwrite."""
        inside = array.depth == region.depth and array.op in ("param", "update", "pack", "get")
        return inside and (array in region.params or array in region.code)

    def _plain(self, node: Node) -> None:
        varying = self.varies(node)
        rows = self.operands(node.args, varying)
        self.define(node, [self._instruction(node, row, varying) for row in rows])

    def _instruction(self, node: Node, args: list[str], vector: bool) -> str:
        op, dtype = node.op, node.dtype
        kind, suffix = self.type_of(dtype, vector), (f"v{self.width}" if vector else "") + SUFFIX[REGISTER[dtype]]
        if op == "neg":
            return self.put(f"fneg {kind} {args[0]}")
        if op == "rcp":
            return self.put(f"fdiv {kind} {literal_of(1.0, vector)}, {args[0]}")
        if op in _BINARY_F64 and dtype == F64:
            return self.put(f"{_BINARY_F64[op]} {kind} {args[0]}, {args[1]}")
        if op in _BINARY_INT:
            name = _UNSIGNED.get(op, _BINARY_INT[op]) if dtype == U32 else _BINARY_INT[op]
            return self.put(f"{name} {kind} {args[0]}, {args[1]}")
        if op in _UNARY_F64:
            return self.call(kind, f"llvm.{_UNARY_F64[op]}.{suffix}", (kind, args[0]))
        if op == "copysign":
            return self.call(kind, f"llvm.copysign.{suffix}", (kind, args[0]), (kind, args[1]))
        if op == "fma":
            return self._fused(node.data, kind, suffix, args)
        if op in _FLOAT_TEST:
            return self._test(node, args, vector)
        if op == "select":
            return self.put(f"select {self.type_of(BOOL, vector)} {args[0]}, {kind} {args[1]}, {kind} {args[2]}")
        if op == "to_int":
            return self._to_int(node, args[0], vector)
        if op in ("convert", "bits", "float"):
            return self._cast(node, args[0], vector)
        raise NativeUnsupported(op)

    def _fused(self, signs: tuple[bool, bool], kind: str, suffix: str, args: list[str]) -> str:
        a, b, c = args
        if signs[0]:
            a = self.put(f"fneg {kind} {a}")
        if signs[1]:
            c = self.put(f"fneg {kind} {c}")
        return self.call(kind, f"llvm.fma.{suffix}", (kind, a), (kind, b), (kind, c))

    def _test(self, node: Node, args: list[str], vector: bool) -> str:
        dtype = node.args[0].dtype
        kind = self.type_of(dtype, vector)
        if dtype == F64:
            return self.put(f"fcmp {_FLOAT_TEST[node.op]} {kind} {args[0]}, {args[1]}")
        return self.put(f"icmp {(_UINT_TEST if dtype == U32 else _INT_TEST)[node.op]} {kind} {args[0]}, {args[1]}")

    def _to_int(self, node: Node, value: str, vector: bool) -> str:
        """Towards zero; NaN gives 0, and what does not fit the nearest whole number that does."""
        source, target = self.type_of(F64, vector), self.type_of(node.dtype, vector)
        if not node.data:
            lanes = f"v{self.width}" if vector else ""
            name = f"llvm.fptosi.sat.{lanes}{SUFFIX[REGISTER[node.dtype]]}.{lanes}f64"
            return self.call(target, name, (source, value))
        real = self.put(f"fcmp ord {source} {value}, {literal_of(0.0, vector)}")
        value = self.put(f"select {self.type_of(BOOL, vector)} {real}, {source} {value}, {source} {literal_of(0.0, vector)}")
        return self.put(f"fptosi {source} {value} to {target}")

    def _cast(self, node: Node, value: str, vector: bool) -> str:
        (source,) = node.args
        old, new = self.type_of(source.dtype, vector), self.type_of(node.dtype, vector)
        if node.op != "convert":
            return self.put(f"bitcast {old} {value} to {new}")
        if node.dtype == F64:
            return self.put(f"{'uitofp' if source.dtype in (U32, BOOL) else 'sitofp'} {old} {value} to {new}")
        before, after = (1 if d == BOOL else 8 * BYTES[d] for d in (source.dtype, node.dtype))
        if before == after:
            return value
        kind = "trunc" if before > after else "zext" if source.dtype in (U32, BOOL) else "sext"
        return self.put(f"{kind} {old} {value} to {new}")

    # -- C library ----------------------------------------------------------------------------------

    def _do_libm(self, node: Node) -> None:
        self.libm[node.data] = len(node.args)
        if not self.varies(node):
            self.define(node, [self._by_lane(node.data, [[self.uniform(n) for n in node.args]], False)[0]])
            return
        self.define(node, self._by_lane(node.data, self.operands(node.args, True), True))

    def _by_lane(self, name: str, rows: list[list[str]], vector: bool) -> Lanes:
        kind = self.type_of(F64, vector)
        function = f"lanes_{name}" if vector else name
        return [self.put(f"call {kind} @{function}({', '.join(f'{kind} {a}' for a in row)})") for row in rows]

    def _do_patched(self, node: Node) -> None:
        """The first argument, but the C function of the third in lanes where the second holds; a branch, rarely taken."""
        near, where, x = node.args
        varying = self.varies(node)
        self.libm[node.data] = 1
        kind, condition = self.type_of(F64, varying), self.type_of(BOOL, varying)
        masks = [row[0] for row in self.operands([where], varying)]
        values = [row[0] for row in self.operands([near], varying)]
        slots = [self.slot(kind) for _ in values]
        for slot, value in zip(slots, values, strict=True):
            self.line(f"store {kind} {value}, ptr {slot}")
        far, end = self.name("far"), self.name("near")
        self.line(f"br i1 {self.any_lane(masks) if varying else masks[0]}, label %{far}, label %{end}")
        self.label(far)
        slow = self._by_lane(node.data, self.operands([x], varying), varying)
        for slot, value, c, s in zip(slots, values, masks, slow, strict=True):
            chosen = self.put(f"select {condition} {c}, {kind} {s}, {kind} {value}")
            self.line(f"store {kind} {chosen}, ptr {slot}")
        self.line(f"br label %{end}")
        self.label(end)
        self.define(node, [self.put(f"load {kind}, ptr {slot}") for slot in slots])

    # -- arrays -------------------------------------------------------------------------------------

    def _do_constant(self, node: Node) -> None:
        self.storage(node)

    def _do_pack(self, node: Node) -> None:
        flat = not self.varies(node)
        storage = self.reserve(node.dtype, node.size or 0, flat)
        for entry, item in enumerate(node.args):
            self.write_entry(storage, entry, [self.uniform(item)] if flat else self.lanes(item))
        self.bind(node, storage)

    def _addresses(self, s: Storage, index: Node, offset: int) -> tuple[bool, Lanes]:
        """(one address for the vector?, pointers) of the entry at index + offset."""
        kind = MEMORY[s.dtype]
        if not self.varies(index):
            if index.op == "const":
                return True, [self._place(s, offset + int(index.data), u) for u in range(1 if s.flat else self.vectors)]
            at = self.uniform(index)
            at = at if index.dtype == I64 else self.put(f"sext i32 {at} to i64")
            if s.flat:
                return True, [self.put(f"getelementptr {kind}, ptr {self._place(s, offset)}, i64 {at}")]
            at = self.put(f"mul i64 {at}, {self.vectors * self.width}")
            return True, [self.put(f"getelementptr {kind}, ptr {self._place(s, offset, u)}, i64 {at}") for u in range(self.vectors)]
        whole = self.vector(REGISTER[index.dtype])
        pointers = []
        for u, at in enumerate(self.lanes(index)):
            base = self._place(s, offset, u)
            if not s.flat:
                number = ", ".join(f"{REGISTER[index.dtype]} {i}" for i in range(self.width))
                at = self.put(f"mul {whole} {at}, splat ({REGISTER[index.dtype]} {self.vectors * self.width})")
                at = self.put(f"add {whole} {at}, <{number}>")
            pointers.append(self.put(f"getelementptr {kind}, ptr {base}, {whole} {at}"))
        return False, pointers

    def _do_load(self, node: Node) -> None:
        array, index = node.args
        s = self.storage(array)
        together, pointers = self._addresses(s, index, node.data)
        self.define(node, self._fetched(s, together, pointers))

    def _fetched(self, s: Storage, together: bool, pointers: Lanes) -> Lanes:
        if together:
            kind = MEMORY[s.dtype] if s.flat else self.vector(MEMORY[s.dtype])
            raw = [self.put(f"load {kind}, ptr {p}, align {self._align(s)}") for p in pointers]
            return [self.from_memory(s.dtype, v, not s.flat) for v in raw]
        kind = self.vector(MEMORY[s.dtype])
        name = f"llvm.masked.gather.v{self.width}{SUFFIX[MEMORY[s.dtype]]}.v{self.width}p0"
        all_lanes = (self.vector("i1"), "splat (i1 true)")
        raw = [self.call(kind, name, (self.vector("ptr"), p), ("i32", str(self._align(s))), all_lanes, (kind, "poison")) for p in pointers]
        return [self.from_memory(s.dtype, v, True) for v in raw]

    def _update(self, node: Node, in_place: bool) -> None:
        array, index, value, allowed = node.args
        old = self.storage(array)
        flat = not self.varies(node)
        target = old
        if not in_place or old.flat != flat:
            target = self.reserve(node.dtype, node.size or 0, flat)
            self.copy(old, target)
        self.bind(node, target)
        together, pointers = self._addresses(target, index, 0)
        values = [self.uniform(value)] if flat else self.lanes(value)
        masks = self._masks(allowed, flat)
        if together:
            self._store_together(target, pointers, values, masks)
        else:
            self._scatter(target, pointers, values, masks)

    def _masks(self, allowed: Node, flat: bool) -> Lanes | None:
        always = allowed.op == "const" and bool(allowed.data)
        if flat:
            return None if always else [self.uniform(allowed)]
        if always:
            return self.mask
        masks = self.lanes(allowed)
        if self.mask is None:
            return masks
        return [self.put(f"and {self.vector('i1')} {a}, {b}") for a, b in zip(masks, self.mask, strict=True)]

    def _store_together(self, s: Storage, pointers: Lanes, values: Lanes, masks: Lanes | None) -> None:
        vector = not s.flat
        kind, register = (self.vector(k) if vector else k for k in (MEMORY[s.dtype], REGISTER[s.dtype]))
        if masks is not None:
            old = self._fetched(s, True, pointers)
            condition = self.type_of(BOOL, vector)
            values = [
                self.put(f"select {condition} {c}, {register} {a}, {register} {b}") for c, a, b in zip(masks, values, old, strict=True)
            ]
        for pointer, value in zip(pointers, values, strict=True):
            self.line(f"store {kind} {self.to_memory(s.dtype, value, vector)}, ptr {pointer}, align {self._align(s)}")

    def _scatter(self, s: Storage, pointers: Lanes, values: Lanes, masks: Lanes | None) -> None:
        kind = self.vector(MEMORY[s.dtype])
        name = f"llvm.masked.scatter.v{self.width}{SUFFIX[MEMORY[s.dtype]]}.v{self.width}p0"
        self.declared.add(f"declare void @{name}({kind}, {self.vector('ptr')}, i32, {self.vector('i1')})")
        for u, (pointer, value) in enumerate(zip(pointers, values, strict=True)):
            value, mask = self.to_memory(s.dtype, value, True), "splat (i1 true)" if masks is None else masks[u]
            self.line(
                f"call void @{name}({kind} {value}, {self.vector('ptr')} {pointer}, i32 {self._align(s)}, {self.vector('i1')} {mask})"
            )

    # -- control flow -------------------------------------------------------------------------------

    def _do_get(self, node: Node) -> None:
        """Defined together with the node it belongs to."""

    def enter(self, params: Sequence[Node], begin: Sequence[Node]) -> list[list[str] | Storage]:
        """Slots or memory of carried values, filled with what they begin with."""
        places: list[list[str] | Storage] = []
        for param, first in zip(params, begin, strict=True):
            varying = self.varies(param)
            if param.size is None:
                kind = self.type_of(param.dtype, varying)
                values = self.lanes(first) if varying else [self.uniform(first)]
                places.append(self.filled(kind, values))
            else:
                target = self.reserve(param.dtype, param.size, not varying)
                self.copy(self.storage(first), target)
                places.append(target)
        return places

    def filled(self, kind: str, values: Lanes) -> list[str]:
        slots = [self.slot(kind) for _ in values]
        for slot, value in zip(slots, values, strict=True):
            self.line(f"store {kind} {value}, ptr {slot}")
        return slots

    def fetch(self, node: Node, place: list[str] | Storage) -> None:
        """Make a carried value known under a node."""
        if isinstance(place, Storage):
            self.bind(node, place)
        else:
            kind = self.type_of(node.dtype, self.varies(node))
            self.define(node, [self.put(f"load {kind}, ptr {slot}") for slot in place])

    def renew(self, params: Sequence[Node], results: Sequence[Node], places: Sequence[list[str] | Storage]) -> None:
        """Carry results over to the next pass; lanes that are not alive keep what they had."""
        arrays = []
        for result, place in zip(results, places, strict=True):
            if isinstance(place, Storage) and self.storage(result).pointer != place.pointer:
                own = {p.pointer for p in places if isinstance(p, Storage)}
                source = self.storage(result)
                if source.pointer in own:  # two arrays that change places
                    source = self.reserve(place.dtype, place.size, place.flat)
                    self.copy(self.storage(result), source)
                arrays.append((source, place))
        for source, place in arrays:
            self.copy(source, place, self.mask)
        for param, result, place in zip(params, results, places, strict=True):
            if not isinstance(place, Storage):
                self._renew_scalar(param, result, place)

    def _renew_scalar(self, param: Node, result: Node, slots: list[str]) -> None:
        varying = self.varies(param)
        kind = self.type_of(param.dtype, varying)
        values = self.lanes(result) if varying else [self.uniform(result)]
        for u, (slot, value) in enumerate(zip(slots, values, strict=True)):
            if varying and self.mask is not None:
                old = self.put(f"load {kind}, ptr {slot}")
                value = self.put(f"select {self.vector('i1')} {self.mask[u]}, {kind} {value}, {kind} {old}")
            self.line(f"store {kind} {value}, ptr {slot}")

    def _do_loop(self, node: Node) -> None:
        (region,) = node.data
        places = self.enter(region.params[1:], node.args[1:])
        counter = self.filled("i64", ["0"])[0]
        body, end = self.name("loop"), self.name("done")
        self.line(f"br label %{body}")
        self.label(body)
        self.define(region.params[0], [self.put(f"load i64, ptr {counter}")])
        for param, place in zip(region.params[1:], places, strict=True):
            self.fetch(param, place)
        self.region(region)
        self.renew(region.params[1:], region.results, places)
        following = self.put(f"add i64 {self.uniform(region.params[0])}, 1")
        self.line(f"store i64 {following}, ptr {counter}")
        more = self.put(f"icmp slt i64 {following}, {self.uniform(node.args[0])}")
        self.line(f"br i1 {more}, label %{body}, label %{end}")
        self.label(end)
        self._publish(node, places)

    def _do_while(self, node: Node) -> None:
        test, region = node.data
        apart = self.varies(test.results[0])
        places = self.enter(region.params, node.args)
        mask_kind = self.vector("i1")
        active = self.filled(mask_kind, self.mask or ["splat (i1 true)"] * self.vectors) if apart else []
        head, body, end = self.name("test"), self.name("while"), self.name("done")
        self.line(f"br label %{head}")
        self.label(head)
        for param, place in zip(region.params, places, strict=True):
            self.fetch(param, place)
        masks = [self.put(f"load {mask_kind}, ptr {slot}") for slot in active] if apart else self.mask
        with self.alive(masks):
            self.region(test)
            if apart:
                wanted = self.lanes(test.results[0])
                masks = [self.put(f"and {mask_kind} {a}, {b}") for a, b in zip(masks or [], wanted, strict=True)]
                for slot, value in zip(active, masks, strict=True):
                    self.line(f"store {mask_kind} {value}, ptr {slot}")
                go = self.any_lane(masks)
            else:
                go = self.uniform(test.results[0])
        self.line(f"br i1 {go}, label %{body}, label %{end}")
        self.label(body)
        with self.alive(masks):
            self.region(region)
            self.renew(region.params, region.results, places)
        self.line(f"br label %{head}")
        self.label(end)
        self._publish(node, places)

    def _publish(self, node: Node, places: Sequence[list[str] | Storage]) -> None:
        for get in self.gets.get(node, ()):
            self.fetch(get, places[get.data])

    def prepare(self, regions: Sequence[Region]) -> None:
        """Find the results that are taken from loops and branches."""
        self.gets = {}
        for top in regions:
            for node in walk(top):
                if node.op == "get":
                    self.gets.setdefault(node.args[0], []).append(node)

    def _do_cond(self, node: Node) -> None:
        (index,) = node.args
        apart = self.varies(index)
        gets = self.gets.get(node, [])
        places: list[list[str] | Storage] = []
        for get in gets:
            varying = self.varies(get)
            if get.size is not None:
                places.append(self.reserve(get.dtype, get.size, not varying))
                continue
            kind = self.type_of(get.dtype, varying)
            zero = "zeroinitializer" if varying else {F64: "0.0", BOOL: "false"}.get(get.dtype, "0")
            places.append(self.filled(kind, [zero] * (self.vectors if varying else 1)))
        end = self.name("joined")
        for k, region in enumerate(node.data):
            taken, following = self.name("case"), self.name("next")
            chosen = self._chosen(index, k, len(node.data))
            self.line(f"br i1 {self.any_lane(chosen) if apart else chosen[0]}, label %{taken}, label %{following}")
            self.label(taken)
            masks = self.mask
            if apart:
                masks = (
                    chosen if masks is None else [self.put(f"and {self.vector('i1')} {a}, {b}") for a, b in zip(chosen, masks, strict=True)]
                )
            with self.alive(masks):
                self.region(region)
                self._leave_branch(gets, region, places, apart)
            self.line(f"br label %{following if apart else end}")
            self.label(following)
        self.line(f"br label %{end}")
        self.label(end)
        for get, place in zip(gets, places, strict=True):
            self.fetch(get, place)

    def _leave_branch(self, gets: Sequence[Node], region: Region, places: Sequence[list[str] | Storage], apart: bool) -> None:
        with self.alive(self.mask if apart else None):
            for get, place in zip(gets, places, strict=True):
                result = region.results[get.data]
                if isinstance(place, Storage):
                    self.copy(self.storage(result), place, self.mask)
                else:
                    self._renew_scalar(get, result, place)

    def _chosen(self, index: Node, k: int, count: int) -> Lanes:
        """Lanes (or the one i1) that want branch k; numbers out of range want the first or last."""
        varying = self.varies(index)
        kind = self.type_of(index.dtype, varying)
        rows = [row[0] for row in self.operands([index], varying)]

        def test(how: str, value: str, limit: int) -> str:
            number = f"splat ({REGISTER[index.dtype]} {limit})" if varying else str(limit)
            return self.put(f"icmp {how} {kind} {value}, {number}")

        if index.dtype == BOOL:
            return [test("eq", v, k) for v in rows]
        if k == 0:
            return [test("sle", v, 0) for v in rows]
        return [test("sge" if k == count - 1 else "eq", v, k) for v in rows]


def last_uses(region: Region) -> dict[Node, int]:
    """Where each array is read last; after the end when the region hands it on."""
    last: dict[Node, int] = {}

    def note(node: Node, position: int) -> None:
        if node.size is not None:
            last[node] = position

    def inside(node: Node, position: int) -> None:
        for a in node.args:
            note(a, position)
        for inner in regions_of(node):
            for other in inner.code:
                inside(other, position)
            for r in inner.results:
                note(r, position)

    for position, node in enumerate(region.code):
        inside(node, position)
    for r in region.results:
        note(r, len(region.code))
    return last


def literal(node: Node) -> str:
    """A constant as LLVM writes it."""
    if node.dtype == F64:
        return hexadecimal(float(node.data))
    if node.dtype == BOOL:
        return "true" if node.data else "false"
    return str(int(node.data))


def hexadecimal(value: float) -> str:
    return "0x" + struct.pack(">d", value).hex().upper()


def literal_of(value: float, vector: bool) -> str:
    return f"splat (double {hexadecimal(value)})" if vector else hexadecimal(value)
