"""The code of regions: nodes in order, loops, branches, cached table reads and held sums.

Lanes that leave a loop or take another branch are masked; a loop runs until no lane is active, a branch if some lane
takes it.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from plantfit.native.emit.array_access import (
    emit_add_at,
    emit_load,
    emit_pack,
    emit_update,
    lent_to_branches,
    updated_in_place,
)
from plantfit.native.emit.c_library import emit_libm, emit_patched
from plantfit.native.emit.carried import Place, fetch, initial_places, renew, renew_number, renew_one
from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.held_sums import HeldSums
from plantfit.native.emit.instructions import emit_instruction
from plantfit.native.emit.llvm_text import REGISTER, Lanes
from plantfit.native.emit.storage import Row, Storage
from plantfit.native.emit.table_places import TablePlaces
from plantfit.native.graph.nodes import BOOL, F64, Node, Region, regions_of, walk
from plantfit.native.passes.table_reads import TableReads

_RULES: dict[str, Callable[[Emitter, Node], Any]] = {
    "libm": emit_libm,
    "patched": emit_patched,
    "pack": emit_pack,
    "load": emit_load,
    "constant": Emitter.storage,  # interleaved here, ahead of the steps
    "get": lambda e, node: None,  # defined after its loop or branch
}


def _from_outside(region: Region) -> list[Node]:
    """What a region and those inside it use and do not make."""
    used: dict[Node, None] = {}
    own: set[Node] = set()

    def visit(region: Region) -> None:
        own.update(region.params, region.code)
        for node in region.code:
            used.update(dict.fromkeys(node.args))
            for inner in regions_of(node):
                visit(inner)
        used.update(dict.fromkeys(region.results))

    visit(region)
    return [node for node in used if node not in own and node.op != "const"]


class RegionEmitter:
    """Writes regions. `cached` gives the table reads to cache, `sums` those to hold, `read` defines a load from the
    buffers, `tops` are the regions that contain all others."""

    def __init__(
        self,
        emitter: Emitter,
        tops: Sequence[Region],
        cached: dict[Node, TableReads],
        sums: HeldSums,
        read: Callable[[Node], None],
    ):
        self.e, self._sums, self._read = emitter, sums, read
        self._places = TablePlaces(emitter, cached, sums)
        self._gets: dict[Node, list[Node]] = {}  # the results taken from each loop and branch
        self._ahead: set[Node] = set()  # loads that were written ahead of the branch they stand in
        self._apart = False  # whether the vectors of a block are worked off one after another
        for top in tops:
            for node in walk(top):
                if node.op == "get":
                    self._gets.setdefault(node.args[0], []).append(node)

    def emit(self, region: Region, lent: Collection[Node] = ()) -> None:
        """The nodes of a region, in order; arrays that are `lent` to it may be overwritten."""
        in_place, lent_on = updated_in_place(region, lent), lent_to_branches(region, lent)
        for node in region.code:
            if node.op in ("cload", "xload") and node not in self._ahead:
                self._read(node)
        kept = self._places.of(region, apart=self._apart)
        made, places, own = kept.made, kept.indices, set(region.code)
        for index in places:
            if index not in own:
                self._places.arrive(index, kept)
        for node in region.code:
            if node.op in ("cload", "xload") or node in made:
                pass
            elif node.op == "update":
                emit_update(self.e, node, node in in_place)
            elif node in self._sums and self.e.mask is None:
                self._sums.add(node)
            elif node.op == "add_at":
                emit_add_at(self.e, node, node in in_place)
            elif node.op == "cond":
                self._cond(node, lent_on.get(node, {}))
            else:
                self._emit_node(node)
            if node in places:
                self._places.arrive(node, kept)

    def _emit_node(self, node: Node) -> None:
        if node.op == "loop":
            self._loop(node)
        elif node.op == "while":
            self._while(node)
        else:
            _RULES.get(node.op, emit_instruction)(self.e, node)

    # -- loops --------------------------------------------------------------------------------------

    def _loop(self, node: Node) -> None:
        """A loop with a trip count that lanes share."""
        e, (region,) = self.e, node.data
        counter_param, *params = region.params
        places = initial_places(e, params, node.args[1:])
        (counter,) = e.filled_slots("i64", ["0"])
        body, end = e.name("loop"), e.name("done")
        e.line(f"br label %{body}")
        e.label(body)
        e.define(counter_param, [e.put(f"load i64, ptr {counter}")])
        for param, place in zip(params, places, strict=True):
            fetch(e, param, place)
        self.emit(region)
        renew(e, params, region.results, places)
        following = e.put(f"add i64 {e.uniform(counter_param)}, 1")
        e.line(f"store i64 {following}, ptr {counter}")
        more = e.put(f"icmp slt i64 {following}, {e.uniform(node.args[0])}")
        e.line(f"br i1 {more}, label %{body}, label %{end}")
        e.label(end)
        self._publish(node, places)

    def _while(self, node: Node) -> None:
        """A loop with a test; where the test varies, lanes become inactive one by one."""
        e, (test, region) = self.e, node.data
        varying = e.varies(test.results[0])
        places = initial_places(e, region.params, node.args)
        mask_kind = e.vector("i1")
        slots = e.filled_slots(mask_kind, e.mask or ["splat (i1 true)"] * e.vectors) if varying else []
        head, body, end = e.name("test"), e.name("while"), e.name("done")
        e.line(f"br label %{head}")
        e.label(head)
        for param, place in zip(region.params, places, strict=True):
            fetch(e, param, place)
        masks = [e.put(f"load {mask_kind}, ptr {slot}") for slot in slots] if varying else e.mask
        with e.active(masks):
            self.emit(test)
            if varying:
                masks = e.both(masks or [], e.lanes(test.results[0]))
                for slot, value in zip(slots, masks, strict=True):
                    e.line(f"store {mask_kind} {value}, ptr {slot}")
                go = e.any_lane(masks)
            else:
                go = e.uniform(test.results[0])
        e.line(f"br i1 {go}, label %{body}, label %{end}")
        e.label(body)
        with e.active(masks):
            self.emit(region)
            renew(e, region.params, region.results, places)
        e.line(f"br label %{head}")
        e.label(end)
        self._publish(node, places)

    def _publish(self, node: Node, places: Sequence[Place]) -> None:
        for get in self._gets.get(node, ()):
            fetch(self.e, get, places[get.data])

    # -- branches -----------------------------------------------------------------------------------

    def _cond(self, node: Node, lent: Mapping[int, Node]) -> None:
        """Branches one after another, each skipped when no active lane takes it; results that are `lent` stay in
        that array's memory."""
        e, (index,) = self.e, node.args
        varying = e.varies(index)
        gets = self._gets.get(node, [])
        usual = self._usual(node, gets) if varying else None
        places = [self._result_place(get, lent.get(get.data), usual) for get in gets]
        held = {place.pointer for place in places if isinstance(place, Storage)}
        kept = [array for array in lent.values() if e.storage(array).pointer in held]
        end = e.name("joined")
        for k, region in enumerate(node.data):
            if region is usual:
                continue
            taken, following = e.name("case"), e.name("next")
            chosen = self._chosen(index, k, len(node.data))
            e.line(f"br i1 {e.any_lane(chosen) if varying else chosen[0]}, label %{taken}, label %{following}")
            e.label(taken)
            with e.active(e.active_among(chosen) if varying else e.mask):
                if varying and self._seldom(region, gets):
                    for get, place, values in zip(gets, places, self._by_vector(region, gets), strict=True):
                        renew_number(e, get, values, place)  # pyrefly: ignore[bad-argument-type]
                else:
                    self.emit(region, kept)
                    with e.active(e.mask if varying else None):
                        for get, place in zip(gets, places, strict=True):
                            renew_one(e, get, region.results[get.data], place)
            e.line(f"br label %{following if varying else end}")
            e.label(following)
        e.line(f"br label %{end}")
        e.label(end)
        for get, place in zip(gets, places, strict=True):
            fetch(e, get, place)

    def _usual(self, node: Node, gets: Sequence[Node]) -> Region | None:
        """A branch that only hands on numbers from outside: all lanes begin with them, and those that take another
        branch get others."""
        plain = [region for region in node.data if not region.code]
        alone = self.e.mask is None and len(plain) == 1 and all(get.size is None for get in gets)
        return plain[0] if alone else None

    def _seldom(self, region: Region, gets: Sequence[Node]) -> bool:
        """Whether a branch is worked off vector by vector: it searches for something, as few lanes do at a time, and
        gives numbers."""
        e = self.e
        arrays = any(n.size is not None and e.varies(n) for n in (*_from_outside(region), *gets))
        return e.vectors > 1 and not arrays and any(node.op == "while" for node in walk(region))

    def _by_vector(self, region: Region, gets: Sequence[Node]) -> list[Lanes]:
        """The results of a branch, of one vector after another; those without an active lane are skipped."""
        e, masks = self.e, self.e.mask or []
        loads = [node for node in walk(region) if node.op in ("cload", "xload")]
        for node in loads:
            self._read(node)
        outer = [n for n in (*_from_outside(region), *loads) if n.size is None and e.varies(n)]
        start, begun = len(e.lines), [n for n in outer if n.depth == 0] if any(n.depth for n in outer) else []
        given = {n: Row(e, n.dtype, e.value(n)) for n in begun}
        # what no step changes is stored once
        e.before_steps.extend(e.lines[start:])
        del e.lines[start:]
        given |= {n: Row(e, n.dtype, e.value(n)) for n in outer if n not in given}
        mask, found = Row(e, BOOL, masks), [Row(e, get.dtype) for get in gets]
        before = self._ahead, self._apart

        with e.each_vector([e.some_lane(mask) for mask in masks]) as u:
            self._ahead, self._apart = self._ahead | set(loads), True
            with e.one_vector({n: row.load(u) for n, row in given.items()}), e.active([mask.load(u)]):
                self.emit(region)
                for get, row in zip(gets, found, strict=True):
                    row.store(u, e.lanes(region.results[get.data])[0])
            self._ahead, self._apart = before
        return [[row.load(str(i)) for i in range(e.vectors)] for row in found]

    def _result_place(self, get: Node, lent: Node | None, usual: Region | None) -> Place:
        e, varying = self.e, self.e.varies(get)
        if usual is not None:
            return e.filled_slots(e.type_of(get.dtype, varying), e.operand(usual.results[get.data], varying))
        if lent is not None and e.storage(lent).flat != varying:
            return e.storage(lent)
        if get.size is not None:
            return e.reserve(get.dtype, get.size, not varying)
        zero = "zeroinitializer" if varying else {F64: "0.0", BOOL: "false"}.get(get.dtype, "0")
        return e.filled_slots(e.type_of(get.dtype, varying), [zero] * (e.vectors if varying else 1))

    def _chosen(self, index: Node, k: int, count: int) -> Lanes:
        """Masks (or the one i1) of branch k; an index out of range takes the first or last."""
        e, varying = self.e, self.e.varies(index)
        kind = e.type_of(index.dtype, varying)
        how = "eq" if index.dtype == BOOL or 0 < k < count - 1 else "sle" if k == 0 else "sge"
        number = f"splat ({REGISTER[index.dtype]} {k})" if varying else str(k)
        return [e.put(f"icmp {how} {kind} {value}, {number}") for value in e.operand(index, varying)]
