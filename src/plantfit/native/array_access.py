"""Array nodes: reads and writes of entries at indices known at run time, and which arrays may be updated in place.

Lanes with a common index use one vector load or store, lanes with their own a gather or scatter.
"""

from plantfit.native.emitter import Emitter
from plantfit.native.graph import I64, Node, Region, regions_of
from plantfit.native.llvm_text import MEMORY, REGISTER, SUFFIX, Lanes
from plantfit.native.storage import Storage, copy, entry_pointer, from_memory, load_at, store_at, to_memory, write_entry


def emit_pack(e: Emitter, node: Node) -> None:
    """An array of the arguments."""
    varying = e.varies(node)
    storage = e.reserve(node.dtype, node.size or 0, not varying)
    for entry, item in enumerate(node.args):
        write_entry(e, storage, entry, e.operand(item, varying))
    e.bind(node, storage)


def emit_load(e: Emitter, node: Node) -> None:
    """The entry at an index plus the offset `node.data`."""
    array, index = node.args
    s = e.storage(array)
    common, pointers = _addresses(e, s, index, node.data)
    e.define(node, load_at(e, s, pointers) if common else _gather(e, s, pointers))


def emit_update(e: Emitter, node: Node, in_place: bool) -> None:
    """The array with one entry replaced where that is allowed."""
    array, index, value, allowed = node.args
    old, varying = e.storage(array), e.varies(node)
    target = old
    if not in_place or old.flat == varying:
        target = e.reserve(node.dtype, node.size or 0, not varying)
        copy(e, old, target)
    e.bind(node, target)
    common, pointers = _addresses(e, target, index, 0)
    values = e.operand(value, varying)
    masks = _masks(e, allowed, varying)
    if not common:
        _scatter(e, target, pointers, values, masks)
        return
    if masks is not None:
        values = e.selected(target.dtype, varying, masks, values, load_at(e, target, pointers))
    store_at(e, target, pointers, values)


def _masks(e: Emitter, allowed: Node, varying: bool) -> Lanes | None:
    """Where an update happens; None: everywhere."""
    always = allowed.op == "const" and bool(allowed.data)
    if not varying:
        return None if always else [e.uniform(allowed)]
    return e.mask if always else e.active_among(e.lanes(allowed))


def _addresses(e: Emitter, s: Storage, index: Node, offset: int) -> tuple[bool, Lanes]:
    """(whether lanes have a common index, pointers) of the entry at index + offset."""
    if e.varies(index):
        return False, _lane_addresses(e, s, index, offset)
    vectors = range(1 if s.flat else e.vectors)
    if index.op == "const":
        return True, [entry_pointer(e, s, offset + int(index.data), u) for u in vectors]
    at = e.uniform(index)
    at = at if index.dtype == I64 else e.put(f"sext i32 {at} to i64")
    if not s.flat:
        at = e.put(f"mul i64 {at}, {e.vectors * e.width}")
    return True, [e.put(f"getelementptr {MEMORY[s.dtype]}, ptr {entry_pointer(e, s, offset, u)}, i64 {at}") for u in vectors]


def _lane_addresses(e: Emitter, s: Storage, index: Node, offset: int) -> Lanes:
    """Vectors of pointers."""
    kind = REGISTER[index.dtype]
    whole = e.vector(kind)
    pointers = []
    for u, at in enumerate(e.lanes(index)):
        base = entry_pointer(e, s, offset, u)
        if not s.flat:
            number = ", ".join(f"{kind} {i}" for i in range(e.width))
            at = e.put(f"mul {whole} {at}, splat ({kind} {e.vectors * e.width})")
            at = e.put(f"add {whole} {at}, <{number}>")
        pointers.append(e.put(f"getelementptr {MEMORY[s.dtype]}, ptr {base}, {whole} {at}"))
    return pointers


def _gather(e: Emitter, s: Storage, pointers: Lanes) -> Lanes:
    kind = e.vector(MEMORY[s.dtype])
    name = f"llvm.masked.gather.v{e.width}{SUFFIX[MEMORY[s.dtype]]}.v{e.width}p0"
    all_lanes = (e.vector("i1"), "splat (i1 true)")
    raw = [e.call(kind, name, (e.vector("ptr"), p), ("i32", str(s.align)), all_lanes, (kind, "poison")) for p in pointers]
    return [from_memory(e, s.dtype, v, True) for v in raw]


def _scatter(e: Emitter, s: Storage, pointers: Lanes, values: Lanes, masks: Lanes | None) -> None:
    kind, bits = e.vector(MEMORY[s.dtype]), e.vector("i1")
    name = f"llvm.masked.scatter.v{e.width}{SUFFIX[MEMORY[s.dtype]]}.v{e.width}p0"
    e.declared.add(f"declare void @{name}({kind}, {e.vector('ptr')}, i32, {bits})")
    for u, (pointer, value) in enumerate(zip(pointers, values, strict=True)):
        value, mask = to_memory(e, s.dtype, value, True), "splat (i1 true)" if masks is None else masks[u]
        e.line(f"call void @{name}({kind} {value}, {e.vector('ptr')} {pointer}, i32 {s.align}, {bits} {mask})")


# -- updates in place -----------------------------------------------------------------------------------


def updated_in_place(region: Region) -> set[Node]:
    """The updates of a region that may overwrite their array: it was made by the region and is read last by the update."""
    last = _last_uses(region)
    made = {*region.params, *region.code}

    def own(array: Node) -> bool:
        return array.depth == region.depth and array.op in ("param", "update", "pack", "get") and array in made

    return {n for i, n in enumerate(region.code) if n.op == "update" and own(n.args[0]) and last.get(n.args[0]) == i}


def _last_uses(region: Region) -> dict[Node, int]:
    """The position in a region of the last read of each array; past the end for results."""
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
