"""The function around a loop body: groups, blocks of lanes, the time loop, loads and stores, and the entry XLA calls.

Buffers: constants and carry (entries, G, B), rows and results (G, K, entries, B); G counts groups, B lanes in a group.
G or B is 1 where a leaf does not have it. The last block of a group overlaps the one before, so that no block is partly
empty; a group narrower than a block loads under a mask, and the spare lanes repeat its first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from plantfit.native.emit import BYTES, MEMORY, REGISTER, Emitter, Storage
from plantfit.native.graph import Node, Region
from plantfit.native.remember import remembered
from plantfit.native.variance import Variance


@dataclass(frozen=True)
class Leaf:
    """A buffer: how many entries of which type, with a row per step or not, and what it varies over."""

    dtype: str
    size: int
    rows: bool
    groups: bool
    lanes: bool


@dataclass(frozen=True)
class Program:
    """A traced loop body. Leaves are numbered: constants, carry, rows; `carry` and `ys` give results by leaf."""

    prologue: Region
    body: Region
    constants: tuple[tuple[str, int], ...]  # (type, entries)
    carry: tuple[tuple[str, int], ...]
    rows: tuple[tuple[str, int], ...]
    carry_in_memory: tuple[bool, ...]  # carried arrays that are indexed at run time
    ys: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Shape:
    """What the machine code depends on besides the program."""

    width: int  # lanes in a vector
    vectors: int  # vectors that run together
    narrow: bool  # fewer lanes than a block
    reverse: bool
    varies: tuple[tuple[bool, bool], ...]  # (over groups, over lanes) of every input leaf


@dataclass(frozen=True)
class Kernel:
    """LLVM text with the handler `entry`, and the functions of the C library that it calls."""

    text: str
    libm: tuple[str, ...]


def make_kernel(program: Program, shape: Shape) -> Kernel:
    """The kernel of a program; raises NativeUnsupported for arrays too large for the stack."""
    kernel = _Kernel(program, shape)
    return Kernel(kernel.text(), tuple(sorted(kernel.emitter.libm)))


class _Kernel:
    def __init__(self, program: Program, shape: Shape):
        self.program, self.shape = program, shape
        kinds = [(*c, False) for c in (*program.constants, *program.carry)] + [(*r, True) for r in program.rows]
        self.inputs = [Leaf(*kind, *varies) for kind, varies in zip(kinds, shape.varies, strict=True)]
        self.outputs = [Leaf(*c, False, True, True) for c in program.carry] + [Leaf(*y, True, True, True) for y in program.ys]
        self.variance = Variance(self._leaf_varies)
        self.emitter = Emitter(shape.width, shape.vectors, self.variance, self._constant_storage)
        self.tail: list[str] = []  # masks, where blocks are not full
        self.g = self.b = self._row = "0"  # the group, lane and step that addresses refer to
        self.first_carry, self.first_row = len(program.constants), len(program.constants) + len(program.carry)

    @property
    def block(self) -> int:
        return self.shape.width * self.shape.vectors

    def _leaf_varies(self, node: Node) -> bool:
        leaf = node.data if node.op == "constant" else node.data[0]
        return self.inputs[leaf + (self.first_row if node.op == "xload" else 0)].lanes

    # -- the function -------------------------------------------------------------------------------

    def text(self) -> str:
        e, program = self.emitter, self.program
        e.prepare([program.prologue, program.body])
        e.groups = remembered(program.body)
        begin = [self.inputs[self.first_carry + k].lanes for k, (_, size) in self._carried()]
        self.variance.code(program.prologue)
        self.variance.carried(program.body, program.body.params, begin)
        self._loops()
        arguments = ", ".join(
            [f"ptr noalias readonly %in{i}" for i in range(len(self.inputs))]
            + [f"ptr noalias %out{i}" for i in range(len(self.outputs))]
            + ["i64 %K", "i64 %G", "i64 %B"]
        )
        helpers = [self._by_lane(name, count) for name, count in sorted(e.libm.items())]
        return "\n".join(
            [
                *sorted(e.declared),
                *helpers,
                f"define internal void @kernel({arguments}) noinline #0 {{",
                "entry:",
                *e.slots,
                *e.lines,
                "}",
                self._entry(),
                f'attributes #0 = {{ nounwind "prefer-vector-width"="{64 * self.shape.width}" '
                f'"min-legal-vector-width"="{64 * self.shape.width}" "no-stack-arg-probe" }}',
                "",
            ]
        )

    def _carried(self) -> list[tuple[int, tuple[str, int | None]]]:
        """(leaf, (type, entries or None for a number)) of every carried parameter, in order."""
        found: list[tuple[int, tuple[str, int | None]]] = []
        for k, ((dtype, size), memory) in enumerate(zip(self.program.carry, self.program.carry_in_memory, strict=True)):
            found.extend([(k, (dtype, size))] if memory else [(k, (dtype, None))] * size)
        return found

    def _loops(self) -> None:
        e = self.emitter
        self._tail_masks()
        group, lane = e.filled("i64", ["0"])[0], e.slot("i64")
        e.line("br label %groups")
        e.label("groups")
        self.g = e.put(f"load i64, ptr {group}")
        e.line(f"store i64 0, ptr {lane}")
        e.line(f"br i1 {e.put(f'icmp slt i64 {self.g}, %G')}, label %blocks, label %finished")
        e.label("blocks")
        at = e.put(f"load i64, ptr {lane}")
        last = e.put(f"sub i64 %B, {self.block}")
        self.b = "0" if self.shape.narrow else e.call("i64", "llvm.smin.i64", ("i64", at), ("i64", last))
        self._block()
        following = e.put(f"add i64 {at}, {self.block}")
        e.line(f"store i64 {following}, ptr {lane}")
        e.line(f"br i1 {e.put(f'icmp slt i64 {following}, %B')}, label %blocks, label %group_end")
        e.label("group_end")
        e.line(f"store i64 {e.put(f'add i64 {self.g}, 1')}, ptr {group}")
        e.line("br label %groups")
        e.label("finished")
        e.line("ret void")

    def _tail_masks(self) -> None:
        """Which lanes of a group narrower than a block hold something."""
        e, width = self.emitter, self.shape.width
        if not self.shape.narrow:
            return
        count, whole = e.splat("i64", "%B"), e.vector("i64")
        for u in range(self.shape.vectors):
            numbers = ", ".join(f"i64 {u * width + i}" for i in range(width))
            self.tail.append(e.put(f"icmp slt {whole} <{numbers}>, {count}"))

    def _block(self) -> None:
        """One block of lanes: prologue, steps, results."""
        e, program = self.emitter, self.program
        self._row = "0"
        self._load_nodes(program.prologue)
        e.region(_without_loads(program.prologue))
        places = self._begin()
        step = e.filled("i64", ["0"])[0]
        start = len(e.lines)
        e.line("br label %steps")
        e.label("steps")
        k = e.put(f"load i64, ptr {step}")
        e.line(f"br i1 {e.put(f'icmp slt i64 {k}, %K')}, label %step, label %ended")
        e.label("step")
        self._row = e.put(f"sub i64 {e.put('sub i64 %K, 1')}, {k}") if self.shape.reverse else k
        for param, place in zip(program.body.params, places, strict=True):
            e.fetch(param, place)
        self._load_nodes(program.body)
        e.region(_without_loads(program.body))
        carried = len(program.body.params)
        self._store_rows(program.body.results[carried:])
        e.renew(program.body.params, program.body.results[:carried], places)
        e.line(f"store i64 {e.put(f'add i64 {k}, 1')}, ptr {step}")
        e.line("br label %steps")
        e.label("ended")
        e.lines[start:start] = e.at_start
        self._finish(places)

    # -- buffers ------------------------------------------------------------------------------------

    def _address(self, pointer: str, leaf: Leaf, entry: int) -> str:
        """Where this block finds an entry, without the axes that the leaf lacks."""
        e = self.emitter
        lanes = "%B" if leaf.lanes else "1"
        if leaf.rows:  # (G, K, entries, B)
            row = e.put(f"add i64 {e.put(f'mul i64 {self.g}, %K')}, {self._row}") if leaf.groups else self._row
            at = e.put(f"add i64 {e.put(f'mul i64 {row}, {leaf.size}')}, {entry}")
        else:  # (entries, G, B)
            at = e.put(f"add i64 {e.put(f'mul i64 %G, {entry}')}, {self.g}") if leaf.groups else str(entry)
        at = e.put(f"mul i64 {at}, {lanes}")
        if leaf.lanes:
            at = e.put(f"add i64 {at}, {self.b}")
        return e.put(f"getelementptr {MEMORY[leaf.dtype]}, ptr {pointer}, i64 {at}")

    def _read(self, number: int, entry: int) -> list[str]:
        e, leaf = self.emitter, self.inputs[number]
        at = self._address(f"%in{number}", leaf, entry)
        kind, align = MEMORY[leaf.dtype], BYTES[leaf.dtype]
        if not leaf.lanes:
            return [e.from_memory(leaf.dtype, e.put(f"load {kind}, ptr {at}, align {align}"), False)]
        vector = e.vector(kind)
        values = []
        spare = e.splat(kind, e.put(f"load {kind}, ptr {at}, align {align}")) if self.shape.narrow else ""
        for u in range(self.shape.vectors):
            place = e.put(f"getelementptr {kind}, ptr {at}, i64 {u * self.shape.width}") if u else at
            if self.shape.narrow:
                name = f"llvm.masked.load.v{self.shape.width}{_suffix(kind)}.p0"
                raw = e.call(vector, name, ("ptr", place), ("i32", str(align)), (e.vector("i1"), self.tail[u]), (vector, spare))
            else:
                raw = e.put(f"load {vector}, ptr {place}, align {align}")
            values.append(e.from_memory(leaf.dtype, raw, True))
        return values

    def _write(self, number: int, entry: int, values: list[str]) -> None:
        e, leaf = self.emitter, self.outputs[number]
        at = self._address(f"%out{number}", leaf, entry)
        kind, align = MEMORY[leaf.dtype], BYTES[leaf.dtype]
        vector = e.vector(kind)
        for u, value in enumerate(values):
            place = e.put(f"getelementptr {kind}, ptr {at}, i64 {u * self.shape.width}") if u else at
            value = e.to_memory(leaf.dtype, value, True)
            if self.shape.narrow:
                name = f"llvm.masked.store.v{self.shape.width}{_suffix(kind)}.p0"
                e.declared.add(f"declare void @{name}({vector}, ptr, i32, {e.vector('i1')})")
                e.line(f"call void @{name}({vector} {value}, ptr {place}, i32 {align}, {e.vector('i1')} {self.tail[u]})")
            else:
                e.line(f"store {vector} {value}, ptr {place}, align {align}")

    def _load_nodes(self, region: Region) -> None:
        for node in region.code:
            if node.op in ("cload", "xload"):
                leaf, entry = node.data
                self.emitter.define(node, self._read(leaf + (self.first_row if node.op == "xload" else 0), entry))

    def _constant_storage(self, node: Node, e: Emitter) -> Storage:
        """A constant array: where the caller has it, or interleaved on the stack when lanes differ."""
        leaf = self.inputs[node.data]
        if not leaf.lanes and not leaf.groups:
            return Storage(f"%in{node.data}", leaf.dtype, leaf.size, True)
        storage = e.reserve(leaf.dtype, leaf.size, not leaf.lanes)
        for entry in range(leaf.size):
            e.write_entry(storage, entry, self._read(node.data, entry))
        return storage

    def _begin(self) -> list[list[str] | Storage]:
        """Slots and memory of the carry, filled from the buffers."""
        e = self.emitter
        places: list[list[str] | Storage] = []
        entry: dict[int, int] = {}
        for param, (k, (dtype, size)) in zip(self.program.body.params, self._carried(), strict=True):
            varying = e.varies(param)
            count = 1 if size is None else size
            storage = None if size is None else e.reserve(dtype, size, not varying)
            for _ in range(count):
                values = self._read(self.first_carry + k, entry.setdefault(k, 0))
                entry[k] += 1
                if varying and not self.inputs[self.first_carry + k].lanes:
                    values = [e.splat(REGISTER[dtype], values[0])] * self.shape.vectors
                if storage is None:
                    places.append(e.filled(e.type_of(dtype, varying), values))
                else:
                    e.write_entry(storage, entry[k] - 1, values)
            if storage is not None:
                places.append(storage)
        return places

    def _store_rows(self, results: Sequence[Node]) -> None:
        e, position = self.emitter, 0
        for number, (_, size) in enumerate(self.program.ys, len(self.program.carry)):
            for entry in range(size):
                self._write(number, entry, e.lanes(results[position]))
                position += 1

    def _finish(self, places: Sequence[list[str] | Storage]) -> None:
        """Write the carry after the last step."""
        e = self.emitter
        entry: dict[int, int] = {}
        for param, place, (k, (dtype, size)) in zip(self.program.body.params, places, self._carried(), strict=True):
            for i in range(1 if size is None else size):
                varying = e.varies(param)
                if isinstance(place, Storage):
                    values = e.read_entry(place, i)
                else:
                    values = [e.put(f"load {e.type_of(dtype, varying)}, ptr {slot}") for slot in place]
                values = values if varying else [e.splat(REGISTER[dtype], values[0])] * self.shape.vectors
                self._write(k, entry.setdefault(k, 0), values)
                entry[k] += 1

    # -- around it ----------------------------------------------------------------------------------

    def _by_lane(self, name: str, count: int) -> str:
        """A C function applied to each lane of vectors."""
        vector = f"<{self.shape.width} x double>"
        lines = [f"declare double @{name}({', '.join(['double'] * count)}) nounwind"]
        lines.append(f"define internal {vector} @lanes_{name}({', '.join(f'{vector} %a{i}' for i in range(count))}) noinline #0 {{")
        value = "poison"
        for lane in range(self.shape.width):
            lines.extend(f"  %x{lane}_{i} = extractelement {vector} %a{i}, i64 {lane}" for i in range(count))
            lines.append(f"  %y{lane} = call double @{name}({', '.join(f'double %x{lane}_{i}' for i in range(count))})")
            lines.append(f"  %r{lane} = insertelement {vector} {value}, double %y{lane}, i64 {lane}")
            value = f"%r{lane}"
        return "\n".join([*lines, f"  ret {vector} {value}", "}"])

    def _entry(self) -> str:
        """The handler: answers what version it speaks, else calls the kernel on the buffers of the frame.

        Offsets are those of XLA_FFI_CallFrame, XLA_FFI_Metadata_Extension and XLA_FFI_Buffer in xla/ffi/api/c_api.h.
        """
        lines = [
            "define ptr @entry(ptr %frame) #0 {",
            "  %xp = getelementptr i8, ptr %frame, i64 8",
            "  %extension = load ptr, ptr %xp",
            "  %asks = icmp ne ptr %extension, null",
            "  br i1 %asks, label %maybe, label %run",
            "maybe:",
            "  %tp = getelementptr i8, ptr %extension, i64 8",
            "  %type = load i32, ptr %tp",
            "  %is = icmp eq i32 %type, 1",
            "  br i1 %is, label %metadata, label %run",
            "metadata:",
            "  %ap = getelementptr i8, ptr %frame, i64 16",
            "  %api = load ptr, ptr %ap",
            "  %vp = getelementptr i8, ptr %api, i64 32",
            "  %version = load i64, ptr %vp, align 4",
            "  %mp = getelementptr i8, ptr %extension, i64 24",
            "  %answer = load ptr, ptr %mp",
            "  %wp = getelementptr i8, ptr %answer, i64 24",
            "  store i64 %version, ptr %wp, align 4",
            "  %rp = getelementptr i8, ptr %answer, i64 32",
            "  store i32 0, ptr %rp",
            "  ret ptr null",
            "run:",
            "  %args_at = getelementptr i8, ptr %frame, i64 72",
            "  %args = load ptr, ptr %args_at",
            "  %rets_at = getelementptr i8, ptr %frame, i64 112",
            "  %rets = load ptr, ptr %rets_at",
        ]

        def buffer(name: str, array: str, i: int) -> None:
            lines.extend(
                [
                    f"  %{name}_a = getelementptr ptr, ptr %{array}, i64 {i}",
                    f"  %{name}_b = load ptr, ptr %{name}_a",
                    f"  %{name}_c = getelementptr i8, ptr %{name}_b, i64 24",
                    f"  %{name} = load ptr, ptr %{name}_c",
                ]
            )

        buffer("sizes", "args", 0)
        for i in range(len(self.inputs)):
            buffer(f"in{i}", "args", i + 1)
        for i in range(len(self.outputs)):
            buffer(f"out{i}", "rets", i)
        for i, name in enumerate("KGB"):
            lines.append(f"  %{name}_at = getelementptr i64, ptr %sizes, i64 {i}")
            lines.append(f"  %{name} = load i64, ptr %{name}_at")
        passed = [f"ptr %in{i}" for i in range(len(self.inputs))] + [f"ptr %out{i}" for i in range(len(self.outputs))]
        lines.append(f"  call void @kernel({', '.join([*passed, 'i64 %K', 'i64 %G', 'i64 %B'])})")
        return "\n".join([*lines, "  ret ptr null", "}"])


def _suffix(kind: str) -> str:
    return "f64" if kind == "double" else kind


def _without_loads(region: Region) -> Region:
    """The region without the nodes that read buffers, which are known already."""
    code = [n for n in region.code if n.op not in ("cload", "xload")]
    return Region(region.depth, region.params, code, region.results)


__all__ = ["Kernel", "Leaf", "Program", "Shape", "make_kernel"]
