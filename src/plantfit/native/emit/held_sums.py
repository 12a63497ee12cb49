"""Sums into tables that are held in registers: added to memory where a lane leaves its place, and after the last step.

A lane's sums depend on its own path alone, so it gives the same bits in every batch.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from plantfit.native.emit.array_access import common_addresses, gather, scatter, vector_of_addresses
from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.instructions import fused
from plantfit.native.emit.llvm_text import BYTES, REGISTER, SUFFIX, Lanes
from plantfit.native.emit.storage import Row, load_at, store_at
from plantfit.native.graph.nodes import F64, Node, Region
from plantfit.native.passes.table_sums import TableSum, TableSums
from plantfit.native.unsupported import NativeUnsupported


class _Held(NamedTuple):
    """Of a group: where its lanes were, and what they added there since, by term."""

    before: Row
    totals: dict[Node, Row]


class HeldSums:
    """Writes the `add_at` nodes of `groups`."""

    def __init__(self, emitter: Emitter, groups: Sequence[TableSums]):
        self.e = emitter
        self._groups = groups
        self._term = {term.node: (group, term) for group in groups for term in group.terms}
        self._held: dict[TableSums, _Held] = {}

    def __contains__(self, node: Node) -> bool:
        return node in self._term

    def of(self, region: Region) -> Mapping[Node, TableSums]:
        """The groups of a region by their index."""
        return {group.index: group for group in self._groups if group.home is region}

    def add(self, node: Node) -> None:
        """Add to what is held; the group has been told of its place."""
        e, (group, term) = self.e, self._term[node]
        if e.storage(node.args[0]).pointer != e.storage(term.table).pointer:
            raise NativeUnsupported("sums into a table that a branch copies")
        varying = e.varies(node)
        kind, suffix = e.type_of(F64, varying), (f"v{e.width}" if varying else "") + SUFFIX[REGISTER[F64]]
        row = self._held[group].totals[node]
        totals = row.load_all()
        for factors, minus in term.parts:
            rows = e.operands(factors, varying)
            if len(factors) == 2:
                totals = [
                    fused(e, (minus, False), kind, suffix, [*row, total])
                    for row, total in zip(rows, totals, strict=True)
                ]
            else:
                how = "fsub" if minus else "fadd"
                totals = [e.put(f"{how} {kind} {total}, {row[0]}") for row, total in zip(rows, totals, strict=True)]
        for u, total in enumerate(totals):
            row.store(str(u), total)
        e.bind(node, e.storage(node.args[0]))

    def finish(self) -> None:
        """After the last step."""
        for group, held in self._held.items():
            for u in map(str, range(held.before.count)):
                before = held.before.load(u)
                self._deliver(group, u, before, self._somewhere(group, before))

    def open(self, group: TableSums, before: Row) -> None:
        """Begin a group, empty, whose places stand in `before`."""
        totals = {term.node: Row(self.e, F64, varying=self.e.varies(term.node)) for term in group.terms}
        for row in totals.values():
            self.e.before_steps.extend(row.filled("zeroinitializer" if row.varying else "0.0"))
        self._held[group] = _Held(before, totals)

    def renew(self, group: TableSums, u: str, before: str, moved: str) -> None:
        """Deliver the sums of the lanes of vector u that moved away from `before`, and begin new ones; all for a
        place that lanes share."""
        e, wide = self.e, self.e.varies(group.index)
        there = self._somewhere(group, before)
        self._deliver(group, u, before, e.both([moved], [there])[0] if wide else there)
        for row in self._held[group].totals.values():
            if wide:
                row.store(u, *e.selected(F64, True, [moved], ["zeroinitializer"], [row.load(u)]))
            else:
                e.lines.extend(row.filled("zeroinitializer" if row.varying else "0.0"))

    def _somewhere(self, group: TableSums, before: str) -> str:
        """Whether there was a place."""
        wide, dtype = self.e.varies(group.index), group.index.dtype
        return self.e.put(f"icmp ne {self.e.type_of(dtype, wide)} {before}, {nowhere(dtype, wide)}")

    def _deliver(self, group: TableSums, u: str, place: str, where: str) -> None:
        """Add the sums of vector u to the entries at its places, in the lanes `where`; those of all vectors to a
        place that lanes share."""
        e = self.e
        if e.varies(group.index):
            for term in group.terms:
                target = e.storage(term.table)
                pointers = [vector_of_addresses(e, target, group.index.dtype, place, term.offset, u)]
                old = gather(e, target, pointers, [where])
                scatter(e, target, pointers, self._added(group, term, old, [u]), [where])
            return
        some, end = e.name("some"), e.name("end")
        e.line(f"br i1 {where}, label %{some}, label %{end}")
        e.label(some)
        for term in group.terms:
            target = e.storage(term.table)
            pointers = common_addresses(e, target, group.index.dtype, place, term.offset)
            store_at(
                e,
                target,
                pointers,
                self._added(group, term, load_at(e, target, pointers), map(str, range(len(pointers)))),
            )
        e.line(f"br label %{end}")
        e.label(end)

    def _added(self, group: TableSums, term: TableSum, old: Lanes, vectors: Iterable[str]) -> Lanes:
        e, totals = self.e, self._held[group].totals
        kind = e.type_of(F64, e.varies(term.node))

        new = []
        for u, value in zip(vectors, old, strict=True):
            more = totals[term.node].load(u)
            if term.without is not None:
                more = e.put(f"fsub {kind} {more}, {totals[term.without].load(u)}")
            new.append(e.put(f"fadd {kind} {value}, {more}"))
        return new


def nowhere(dtype: str, varying: bool) -> str:
    """No index."""
    number = str(-(2 ** (8 * BYTES[dtype] - 1)))
    return f"splat ({REGISTER[dtype]} {number})" if varying else number
