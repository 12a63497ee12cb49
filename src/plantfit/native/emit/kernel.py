"""The kernel of a loop body: loops over groups, blocks of lanes and steps, around the code of the body.

The last block of a group overlaps the one before, so that no block is partly empty. A group narrower than a block is
masked.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from plantfit.native.compile.ffi_handler import handler
from plantfit.native.emit.buffers import Buffers, Leaf
from plantfit.native.emit.c_library import lanes_function
from plantfit.native.emit.carried import Place, fetch, load_slots, renew
from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.held_sums import HeldSums
from plantfit.native.emit.llvm_text import REGISTER
from plantfit.native.emit.regions import RegionEmitter
from plantfit.native.emit.storage import Storage, each_entry, read_entry, write_entry
from plantfit.native.graph.nodes import Node, Region, walk
from plantfit.native.passes.table_reads import table_reads
from plantfit.native.passes.table_sums import table_sums
from plantfit.native.passes.uniformity import Uniformity


@dataclass(frozen=True)
class Program:
    """A traced loop body. Input leaves are numbered: constants, carry, rows; `carry` and `ys` give the results by
    leaf."""

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
    vectors: int  # vectors in a block
    narrow: bool  # the lanes of a group end in the last vector of one block
    reverse: bool
    ragged: bool  # whether every group has its own number of steps
    varies: tuple[tuple[bool, bool], ...]  # (over groups, over lanes) of every input leaf


@dataclass(frozen=True)
class Kernel:
    """LLVM text with the handler `entry`, and the functions of the C library that it calls."""

    text: str
    libm: tuple[str, ...]


def make_kernel(program: Program, shape: Shape) -> Kernel:
    """The kernel of a program; raises NativeUnsupported for arrays too large for the stack."""
    kernel = _Kernel(program, shape)
    return Kernel(kernel.text(), tuple(sorted(kernel.e.libm)))


def count_nodes(program: Program, lanes: Sequence[bool]) -> tuple[int, int]:
    """(nodes of the body that are one number for all lanes, the others), given which input leaves vary over the
    lanes."""
    uniformity = _analysed(program, lanes)
    varying = sum(map(uniformity.varies, nodes := list(walk(program.body))))
    return len(nodes) - varying, varying


def _analysed(program: Program, lanes: Sequence[bool]) -> Uniformity:
    first_carry, first_row = len(program.constants), len(program.constants) + len(program.carry)

    def leaf_varies(node: Node) -> bool:
        leaf = node.data if node.op == "constant" else node.data[0]
        return lanes[leaf + (first_row if node.op == "xload" else 0)]

    found = Uniformity(leaf_varies)
    found.analyse(program.prologue)
    found.analyse_loop(program.body, program.body.params, [lanes[first_carry + k] for k, _, _ in _carried(program)])
    return found


def _carried(program: Program) -> list[tuple[int, int, int | None]]:
    """(leaf of the carry, its first entry, entries or None for a number) of every carried parameter, in order."""
    found: list[tuple[int, int, int | None]] = []
    for k, ((_, size), memory) in enumerate(zip(program.carry, program.carry_in_memory, strict=True)):
        found.extend([(k, 0, size)] if memory else [(k, entry, None) for entry in range(size)])
    return found


class _Kernel:
    def __init__(self, program: Program, shape: Shape):
        self.program, self.shape = program, shape
        kinds = [(*c, False) for c in (*program.constants, *program.carry)] + [(*r, True) for r in program.rows]
        self.inputs = [Leaf(*kind, *varies) for kind, varies in zip(kinds, shape.varies, strict=True)]
        outputs = [Leaf(*c, False, True, True) for c in program.carry] + [
            Leaf(*y, True, True, True) for y in program.ys
        ]
        self.uniformity = _analysed(program, [leaf.lanes for leaf in self.inputs])
        self.e = Emitter(shape.width, shape.vectors, self.uniformity.varies, self._constant_storage)
        self.buffers = Buffers(self.e, self.inputs, outputs, shape.narrow)
        self.sums = HeldSums(self.e, table_sums(program.body))
        self.regions = RegionEmitter(
            self.e, (program.prologue, program.body), table_reads(program.body), self.sums, self._read
        )
        self.first_carry, self.first_row = len(program.constants), len(program.constants) + len(program.carry)

    def text(self) -> str:
        e, bits = self.e, 64 * self.shape.width
        self._groups()
        pointers = [f"ptr noalias readonly %in{i}" for i in range(len(self.inputs))]
        pointers += [f"ptr noalias %out{i}" for i in range(len(self.buffers.outputs))]
        return "\n".join(
            [
                *sorted(e.declared),
                *(lanes_function(name, count, e.width) for name, count in sorted(e.libm.items())),
                "define internal void "
                f"@kernel({', '.join([*pointers, 'ptr %sizes', 'i64 %K', 'i64 %G', 'i64 %B'])}) noinline #0 {{",
                "entry:",
                *e.slots,
                *e.lines,
                "}",
                handler(len(self.inputs), len(self.buffers.outputs)),
                f'attributes #0 = {{ nounwind "prefer-vector-width"="{bits}" "min-legal-vector-width"="{bits}" '
                f'"no-stack-arg-probe" }}',
                "",
            ]
        )

    # -- loops --------------------------------------------------------------------------------------

    def _groups(self) -> None:
        e, buffers, block = self.e, self.buffers, self.shape.width * self.shape.vectors
        buffers.mask_tail()
        (group,), lane = e.filled_slots("i64", ["0"]), e.slot("i64")
        e.line("br label %groups")
        e.label("groups")
        buffers.group = e.put(f"load i64, ptr {group}")
        e.line(f"store i64 0, ptr {lane}")
        e.line(f"br i1 {e.put(f'icmp slt i64 {buffers.group}, %G')}, label %blocks, label %finished")
        e.label("blocks")
        at = e.put(f"load i64, ptr {lane}")
        last = e.put(f"sub i64 %B, {block}")
        buffers.lane = "0" if self.shape.narrow else e.call("i64", "llvm.smin.i64", ("i64", at), ("i64", last))
        self._block()
        following = e.put(f"add i64 {at}, {block}")
        e.line(f"store i64 {following}, ptr {lane}")
        e.line(f"br i1 {e.put(f'icmp slt i64 {following}, %B')}, label %blocks, label %group_end")
        e.label("group_end")
        e.line(f"store i64 {e.put(f'add i64 {buffers.group}, 1')}, ptr {group}")
        e.line("br label %groups")
        e.label("finished")
        e.line("ret void")

    def _block(self) -> None:
        """One block of lanes: prologue, steps, results."""
        e, buffers, program = self.e, self.buffers, self.program
        buffers.row = "0"
        end = self._end()
        self.regions.emit(program.prologue)
        params = program.body.params
        places = self._begin()
        (step,) = e.filled_slots("i64", ["0"])
        start = len(e.lines)
        e.line("br label %steps")
        e.label("steps")
        k = e.put(f"load i64, ptr {step}")
        e.line(f"br i1 {e.put(f'icmp slt i64 {k}, {end}')}, label %step, label %ended")
        e.label("step")
        buffers.row = e.put(f"sub i64 {e.put(f'sub i64 {end}, 1')}, {k}") if self.shape.reverse else k
        for param, place in zip(params, places, strict=True):
            fetch(e, param, place)
        self.regions.emit(program.body)
        self._write_rows(program.body.results[len(params) :])
        renew(e, params, program.body.results[: len(params)], places)
        e.line(f"store i64 {e.put(f'add i64 {k}, 1')}, ptr {step}")
        e.line("br label %steps")
        e.label("ended")
        e.lines[start:start] = e.before_steps
        self.sums.finish()
        self._finish(places)

    def _end(self) -> str:
        """The number of steps of a group."""
        if not self.shape.ragged:
            return "%K"
        place = self.e.put(f"add i64 {self.buffers.group}, 3")
        return self.e.put(f"load i64, ptr {self.e.put(f'getelementptr i64, ptr %sizes, i64 {place}')}")

    def _read(self, node: Node) -> None:
        """A load from the buffers."""
        leaf, entry = node.data
        self.e.define(node, self.buffers.read(leaf + (self.first_row if node.op == "xload" else 0), entry))

    # -- constants, carry and results ---------------------------------------------------------------

    def _constant_storage(self, node: Node) -> Storage:
        """A constant array: in the caller's buffer, or copied to the stack when it varies or a group has its own."""
        leaf = self.inputs[node.data]
        if not leaf.lanes and not leaf.groups:
            return Storage(f"%in{node.data}", leaf.dtype, leaf.size, True)
        storage = self.e.reserve(leaf.dtype, leaf.size, not leaf.lanes)
        each_entry(
            self.e, leaf.size, lambda entry: write_entry(self.e, storage, entry, self.buffers.read(node.data, entry))
        )
        return storage

    def _begin(self) -> list[Place]:
        """Places of the carry, holding the initial values."""
        e = self.e
        places: list[Place] = []
        for param, (k, first, size) in zip(self.program.body.params, _carried(self.program), strict=True):
            varying = e.varies(param)
            if size is None:
                places.append(e.filled_slots(e.type_of(param.dtype, varying), self._initial(k, first, varying)))
                continue
            storage = e.reserve(param.dtype, size, not varying)
            each_entry(e, size, partial(self._begin_entry, k, storage, varying))
            places.append(storage)
        return places

    def _begin_entry(self, k: int, storage: Storage, varying: bool, entry: int | str) -> None:
        write_entry(self.e, storage, entry, self._initial(k, entry, varying))

    def _initial(self, k: int, entry: int | str, varying: bool) -> list[str]:
        leaf = self.inputs[self.first_carry + k]
        values = self.buffers.read(self.first_carry + k, entry)
        return self.e.block(REGISTER[leaf.dtype], values[0]) if varying and not leaf.lanes else values

    def _write_rows(self, results: Sequence[Node]) -> None:
        position = 0
        for number, (_, size) in enumerate(self.program.ys, len(self.program.carry)):
            for entry in range(size):
                self.buffers.write(number, entry, self.e.lanes(results[position]))
                position += 1

    def _finish(self, places: Sequence[Place]) -> None:
        """Write the carry after the last step."""
        e = self.e
        for param, place, (k, first, size) in zip(
            self.program.body.params, places, _carried(self.program), strict=True
        ):
            for entry in range(first, first + (1 if size is None else size)):
                values = read_entry(e, place, entry) if isinstance(place, Storage) else load_slots(e, param, place)
                if not e.varies(param):
                    values = e.block(REGISTER[param.dtype], values[0])
                self.buffers.write(k, entry, values)


__all__ = ["Kernel", "Program", "Shape", "count_nodes", "make_kernel"]
