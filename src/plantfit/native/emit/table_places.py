"""What is kept while lanes stay at their places in tables: entries that were read there, and sums that are to be added
there.

Few lanes move in a step. So where some do, the vectors that hold them are renewed, one after another.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from plantfit.native.emit.array_access import gather, vector_of_addresses
from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.held_sums import HeldSums, nowhere
from plantfit.native.emit.instructions import instruction
from plantfit.native.emit.storage import Row
from plantfit.native.graph.nodes import Node, Region
from plantfit.native.passes.table_reads import TableReads
from plantfit.native.passes.table_sums import TableSums


@dataclass(frozen=True)
class Kept:
    """What a region keeps, by index."""

    reads: Mapping[Node, TableReads]
    sums: Mapping[Node, TableSums]

    @property
    def indices(self) -> list[Node]:
        return list(dict.fromkeys([*self.reads, *self.sums]))

    @property
    def made(self) -> set[Node]:
        """The nodes that are made where an index changes, or in sums."""
        return {n for group in self.reads.values() for n in group.nodes} | {
            n for group in self.sums.values() for n in group.inside
        }


class TablePlaces:
    """Writes table reads to cache, and begins and ends what `sums` holds."""

    def __init__(self, emitter: Emitter, cached: Mapping[Node, TableReads], sums: HeldSums):
        self.e, self._cached, self._sums = emitter, cached, sums

    def of(self, region: Region, *, apart: bool) -> Kept:
        """What a region keeps: table reads unless vectors are worked off `apart`, and sums where all lanes are
        active."""
        groups = [] if apart else [self._cached[n] for n in region.code if n in self._cached]
        reads = {group.index: group for group in groups if self.e.varies(group.index)}
        return Kept(reads, self._sums.of(region) if self.e.mask is None else {})

    def arrive(self, index: Node, kept: Kept) -> None:
        """Renew what is kept where an index has changed."""
        e, dtype, wide = self.e, index.dtype, self.e.varies(index)
        reads, sums = kept.reads.get(index), kept.sums.get(index)
        kind, before = e.type_of(dtype, wide), Row(e, dtype, varying=wide)
        e.before_steps.extend(before.filled(nowhere(dtype, wide)))
        if sums is not None:
            self._sums.open(sums, before)
        slots = {node: Row(e, node.dtype) for node in (reads.kept if reads is not None else ())}
        for row in slots.values():
            e.before_steps.extend(row.filled("zeroinitializer"))
        now = e.operand(index, wide)
        moved = [e.put(f"icmp ne {kind} {a}, {b}") for a, b in zip(now, before.load_all(), strict=True)]
        again, same = e.name("moved"), e.name("same")
        with e.active(None):  # inactive lanes, too, hold what belongs to their index
            e.line(f"br i1 {e.any_lane(moved) if wide else moved[0]}, label %{again}, label %{same}")
            e.label(again)
            if wide:
                self._vector_by_vector(index, before, now, reads, sums, slots)
            elif sums is not None:
                self._sums.renew(sums, "0", before.load("0"), moved[0])
                before.store("0", now[0])
        e.line(f"br label %{same}")
        e.label(same)
        for node, row in slots.items():
            e.define(node, row.load_all())

    def _vector_by_vector(
        self,
        index: Node,
        before: Row,
        now: list[str],
        reads: TableReads | None,
        sums: TableSums | None,
        slots: Mapping[Node, Row],
    ) -> None:
        e, kind = self.e, self.e.type_of(index.dtype, True)
        places = Row(e, index.dtype, now)
        own_nodes = reads.nodes if reads is not None else ()
        # in the order of the code, so that the text of a loop is the same in every process
        outer = dict.fromkeys(a for n in own_nodes if n.op != "load" for a in n.args if a not in own_nodes)
        given = {a: Row(e, a.dtype, e.lanes(a)) for a in outer if e.varies(a)}

        def moved(u: str) -> str:
            return e.put(f"icmp ne {kind} {places.load(u)}, {before.load(u)}")

        with e.each_vector([e.any_lane([moved(str(u))]) for u in range(len(now))]) as u:
            if sums is not None:
                self._sums.renew(sums, u, before.load(u), moved(u))
            if reads is not None:
                self._read(reads, u, places.load(u), given, slots)
            before.store(u, places.load(u))

    def _read(
        self, reads: TableReads, u: str, place: str, given: Mapping[Node, Row], slots: Mapping[Node, Row]
    ) -> None:
        """The entries of vector u at its new places, and what follows from them."""
        e, found = self.e, {reads.index: place}
        for node in reads.nodes:
            if node.op == "load":
                storage = e.storage(node.args[0])
                address = vector_of_addresses(e, storage, reads.index.dtype, place, node.data, u)
                (found[node],) = gather(e, storage, [address])
            else:
                args = [
                    found[a] if a in found else given[a].load(u) if a in given else e.lanes(a)[0] for a in node.args
                ]
                found[node] = instruction(e, node, args, True)
            if node in slots:
                slots[node].store(u, found[node])
