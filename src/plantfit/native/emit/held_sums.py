"""Sums into tables that are held in registers: added to memory where a lane leaves its place, and after the last step.

A lane's sums depend on its own path alone, so it gives the same bits in every batch.
"""

from collections.abc import Sequence
from typing import NamedTuple

from plantfit.native.emit.array_access import common_addresses, gather, lane_addresses, scatter
from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.llvm_text import BYTES, REGISTER, Lanes
from plantfit.native.emit.storage import Storage, load_at, store_at
from plantfit.native.graph.nodes import F64, Node
from plantfit.native.passes.table_sums import TableSums
from plantfit.native.unsupported import NativeUnsupported


class _Held(NamedTuple):
    """The slots of a group: where its lanes were, and what they added there since, by term."""

    before: list[str]
    totals: dict[Node, list[str]]


class HeldSums:
    """Writes the `add_at` nodes of `groups`."""

    def __init__(self, emitter: Emitter, groups: Sequence[TableSums]):
        self.e = emitter
        self._group = {node: group for group in groups for node, _ in group.terms}
        self._held: dict[TableSums, _Held] = {}

    def __contains__(self, node: Node) -> bool:
        return node in self._group

    def add(self, node: Node) -> None:
        """Add to what is held, after the group's former place has got its sums, if it is another."""
        e, group = self.e, self._group[node]
        if e.storage(node.args[0]).pointer != self._table(node).pointer:
            raise NativeUnsupported("sums into a table that a branch copies")
        if group not in self._held:
            self._held[group] = self._opened(group)
            self._leave(group)
        kind = e.type_of(F64, e.varies(node))
        for slot, value in zip(self._held[group].totals[node], e.operand(node.args[2], e.varies(node)), strict=True):
            total = e.put(f"fadd {kind} {e.put(f'load {kind}, ptr {slot}')}, {value}")
            e.line(f"store {kind} {total}, ptr {slot}")
        e.bind(node, e.storage(node.args[0]))

    def finish(self) -> None:
        """After the last step."""
        for group in self._held:
            before = self._places(group)
            self._deliver(group, before, self._somewhere(group, before))

    def _opened(self, group: TableSums) -> _Held:
        """Slots, nowhere and empty when a block begins."""
        e, dtype = self.e, group.index.dtype
        wide = e.varies(group.index)
        kind = e.type_of(dtype, wide)
        before = [e.slot(kind) for _ in range(e.vectors if wide else 1)]
        e.before_steps.extend(f"  store {kind} {self._nowhere(group)}, ptr {slot}" for slot in before)
        totals: dict[Node, list[str]] = {}
        for node, _ in group.terms:
            whole = e.type_of(F64, e.varies(node))
            totals[node] = [e.slot(whole) for _ in range(e.vectors if e.varies(node) else 1)]
            e.before_steps.extend(f"  store {whole} zeroinitializer, ptr {slot}" for slot in totals[node])
        return _Held(before, totals)

    def _nowhere(self, group: TableSums) -> str:
        dtype = group.index.dtype
        number = str(-(2 ** (8 * BYTES[dtype] - 1)))
        return f"splat ({REGISTER[dtype]} {number})" if self.e.varies(group.index) else number

    def _places(self, group: TableSums) -> Lanes:
        kind = self.e.type_of(group.index.dtype, self.e.varies(group.index))
        return [self.e.put(f"load {kind}, ptr {slot}") for slot in self._held[group].before]

    def _somewhere(self, group: TableSums, before: Lanes) -> Lanes:
        kind = self.e.type_of(group.index.dtype, self.e.varies(group.index))
        return [self.e.put(f"icmp ne {kind} {a}, {self._nowhere(group)}") for a in before]

    def _leave(self, group: TableSums) -> None:
        """Where the place has changed, deliver the sums and begin new ones."""
        e, held, wide = self.e, self._held[group], self.e.varies(group.index)
        kind = e.type_of(group.index.dtype, wide)
        now, before = e.operand(group.index, wide), self._places(group)
        moved = [e.put(f"icmp ne {kind} {a}, {b}") for a, b in zip(now, before, strict=True)]
        left, stayed = e.name("left"), e.name("stayed")
        e.line(f"br i1 {e.any_lane(moved) if wide else moved[0]}, label %{left}, label %{stayed}")
        e.label(left)
        self._deliver(group, before, self._both(moved, self._somewhere(group, before), wide))
        for node, slots in held.totals.items():
            whole = e.type_of(F64, e.varies(node))
            zero = "zeroinitializer" if e.varies(node) else "0.0"
            old = [e.put(f"load {whole}, ptr {slot}") for slot in slots]
            new = e.selected(F64, True, moved, [zero] * len(slots), old) if wide else [zero] * len(slots)
            for slot, value in zip(slots, new, strict=True):
                e.line(f"store {whole} {value}, ptr {slot}")
        for slot, value in zip(held.before, now, strict=True):
            e.line(f"store {kind} {value}, ptr {slot}")
        e.line(f"br label %{stayed}")
        e.label(stayed)

    def _both(self, a: Lanes, b: Lanes, wide: bool) -> Lanes:
        return self.e.both(a, b) if wide else [self.e.put(f"and i1 {a[0]}, {b[0]}")]

    def _deliver(self, group: TableSums, places: Lanes, where: Lanes) -> None:
        """Add the sums to the entries at `places`, in the lanes `where`."""
        e = self.e
        if e.varies(group.index):
            for node, offset in group.terms:
                target = self._table(node)
                pointers = lane_addresses(e, target, group.index.dtype, places, offset)
                scatter(e, target, pointers, self._added(node, gather(e, target, pointers, where)), where)
            return
        some, end = e.name("some"), e.name("end")
        e.line(f"br i1 {where[0]}, label %{some}, label %{end}")
        e.label(some)
        for node, offset in group.terms:
            target = self._table(node)
            pointers = common_addresses(e, target, group.index.dtype, places[0], offset)
            store_at(e, target, pointers, self._added(node, load_at(e, target, pointers)))
        e.line(f"br label %{end}")
        e.label(end)

    def _table(self, node: Node) -> Storage:
        """The carried array that a sum goes to."""
        return self.e.storage(self._group[node].tables[node])

    def _added(self, node: Node, old: Lanes) -> Lanes:
        e = self.e
        kind = e.type_of(F64, e.varies(node))
        slots = self._held[self._group[node]].totals[node]
        return [e.put(f"fadd {kind} {a}, {e.put(f'load {kind}, ptr {slot}')}") for a, slot in zip(old, slots, strict=True)]
