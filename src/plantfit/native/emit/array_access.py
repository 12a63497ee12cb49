"""Array nodes: reads and writes of entries at indices known at run time, and which arrays may be updated in place.

Lanes with a common index use one vector load or store, lanes with their own a gather or scatter.
"""

from collections.abc import Collection

from plantfit.native.emit.emitter import Emitter
from plantfit.native.emit.llvm_text import MEMORY, REGISTER, SUFFIX, Lanes
from plantfit.native.emit.storage import (
    Storage,
    copy,
    entry_pointer,
    from_memory,
    load_at,
    store_at,
    to_memory,
    write_entry,
)
from plantfit.native.graph.nodes import I64, Node, Region, regions_of


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
    e.define(node, load_at(e, s, pointers) if common else gather(e, s, pointers))


def emit_add_at(e: Emitter, node: Node, in_place: bool) -> None:
    """The array with something added to one entry."""
    array, index, added = node.args
    varying = e.varies(node)
    target = _changed(e, node, array, in_place)
    common, pointers = _addresses(e, target, index, 0)
    kind = e.type_of(node.dtype, varying)
    old = load_at(e, target, pointers) if common else gather(e, target, pointers)
    values = [e.put(f"fadd {kind} {a}, {b}") for a, b in zip(old, e.operand(added, varying), strict=True)]
    if not common:
        scatter(e, target, pointers, values, e.mask)
        return
    if varying and e.mask is not None:
        values = e.selected(target.dtype, varying, e.mask, values, old)
    store_at(e, target, pointers, values)


def emit_update(e: Emitter, node: Node, in_place: bool) -> None:
    """The array with one entry replaced where that is allowed."""
    array, index, value, allowed = node.args
    varying = e.varies(node)
    target = _changed(e, node, array, in_place)
    common, pointers = _addresses(e, target, index, 0)
    values = e.operand(value, varying)
    masks = _masks(e, allowed, varying)
    if not common:
        scatter(e, target, pointers, values, masks)
        return
    if masks is not None:
        values = e.selected(target.dtype, varying, masks, values, load_at(e, target, pointers))
    store_at(e, target, pointers, values)


def _changed(e: Emitter, node: Node, array: Node, in_place: bool) -> Storage:
    """The memory of a node that changes an array: the array's own, or a copy."""
    old, varying = e.storage(array), e.varies(node)
    target = old
    if not in_place or old.flat == varying:
        target = e.reserve(node.dtype, node.size or 0, not varying)
        copy(e, old, target)
    e.bind(node, target)
    return target


def _masks(e: Emitter, allowed: Node, varying: bool) -> Lanes | None:
    """Where an update happens; None: everywhere."""
    always = allowed.op == "const" and bool(allowed.data)
    if not varying:
        return None if always else [e.uniform(allowed)]
    return e.mask if always else e.active_among(e.lanes(allowed))


def _addresses(e: Emitter, s: Storage, index: Node, offset: int) -> tuple[bool, Lanes]:
    """(whether lanes have a common index, pointers) of the entry at index + offset."""
    if e.varies(index):
        return False, lane_addresses(e, s, index.dtype, e.lanes(index), offset)
    if index.op == "const":
        return True, [entry_pointer(e, s, offset + int(index.data), u) for u in range(1 if s.flat else e.vectors)]
    return True, common_addresses(e, s, index.dtype, e.uniform(index), offset)


def common_addresses(e: Emitter, s: Storage, dtype: str, at: str, offset: int) -> Lanes:
    """Pointers to the entry at one index of all lanes, plus the offset."""
    at = at if dtype == I64 else e.put(f"sext i32 {at} to i64")
    if not s.flat:
        at = e.put(f"mul i64 {at}, {e.vectors * e.width}")
    vectors = range(1 if s.flat else e.vectors)
    return [e.put(f"getelementptr {MEMORY[s.dtype]}, ptr {entry_pointer(e, s, offset, u)}, i64 {at}") for u in vectors]


def lane_addresses(e: Emitter, s: Storage, dtype: str, at: Lanes, offset: int) -> Lanes:
    """Vectors of pointers to the entries at the lanes' own indices, plus the offset."""
    return [vector_of_addresses(e, s, dtype, place, offset, str(u)) for u, place in enumerate(at)]


def vector_of_addresses(e: Emitter, s: Storage, dtype: str, place: str, offset: int, u: str) -> str:
    """`lane_addresses` of vector u of a block."""
    kind = REGISTER[dtype]
    whole = e.vector(kind)
    base = entry_pointer(e, s, offset)
    if not s.flat:
        number = ", ".join(f"{kind} {i}" for i in range(e.width))
        place = e.put(f"mul {whole} {place}, splat ({kind} {e.vectors * e.width})")
        place = e.put(f"add {whole} {place}, <{number}>")
        base = base if u == "0" else e.put(f"getelementptr {e.vector(MEMORY[s.dtype])}, ptr {base}, i64 {u}")
    return e.put(f"getelementptr {MEMORY[s.dtype]}, ptr {base}, {whole} {place}")


def gather(e: Emitter, s: Storage, pointers: Lanes, masks: Lanes | None = None) -> Lanes:
    """The entries at vectors of pointers; where a mask is not set nothing is read."""
    kind, bits = e.vector(MEMORY[s.dtype]), e.vector("i1")
    name = f"llvm.masked.gather.v{e.width}{SUFFIX[MEMORY[s.dtype]]}.v{e.width}p0"
    masks = masks or ["splat (i1 true)"] * len(pointers)
    raw = [
        e.call(kind, name, (e.vector("ptr"), p), ("i32", str(s.align)), (bits, mask), (kind, "poison"))
        for p, mask in zip(pointers, masks, strict=True)
    ]
    return [from_memory(e, s.dtype, v, True) for v in raw]


def scatter(e: Emitter, s: Storage, pointers: Lanes, values: Lanes, masks: Lanes | None) -> None:
    """Write to vectors of pointers, where a mask is set."""
    kind, bits = e.vector(MEMORY[s.dtype]), e.vector("i1")
    name = f"llvm.masked.scatter.v{e.width}{SUFFIX[MEMORY[s.dtype]]}.v{e.width}p0"
    e.declared.add(f"declare void @{name}({kind}, {e.vector('ptr')}, i32, {bits})")
    for u, (pointer, value) in enumerate(zip(pointers, values, strict=True)):
        value, mask = to_memory(e, s.dtype, value, True), "splat (i1 true)" if masks is None else masks[u]
        e.line(f"call void @{name}({kind} {value}, {e.vector('ptr')} {pointer}, i32 {s.align}, {bits} {mask})")


# -- updates in place -----------------------------------------------------------------------------------


_OWN = ("param", "update", "add_at", "pack", "get")  # what makes an array that is a region's own


def updated_in_place(region: Region, lent: Collection[Node] = ()) -> set[Node]:
    """The updates and sums of a region that may overwrite their array: it is read last by them, and was made by the
    region or is `lent`."""
    last = _last_uses(region)
    made = {*region.params, *region.code}

    def own(array: Node) -> bool:
        made_here = array.depth == region.depth and array.op in _OWN and array in made
        return made_here or array in lent

    return {
        n
        for i, n in enumerate(region.code)
        if n.op in ("update", "add_at") and own(n.args[0]) and last.get(n.args[0]) == i
    }


def lent_to_branches(region: Region, lent: Collection[Node] = ()) -> dict[Node, dict[int, Node]]:
    """For every `cond` of a region its results that may stay in the memory of an array of the region, and which.

    The branches read that array last, and each changes it in place or leaves it. `lent` are arrays from outside that
    are the region's.
    """
    last, found = _last_uses(region), dict[Node, dict[int, Node]]()
    made = {*region.params, *region.code, *lent}
    for i, node in enumerate(region.code):
        if node.op != "cond":
            continue
        taken: dict[int, Node] = {}
        for k, result in enumerate(node.data[0].results):
            array = _changed_array(result, node.data[0])
            mine = array is not None and array in made and last.get(array) == i and array.op in _OWN
            if array is not None and mine and all(_stays(array, k, branch) for branch in node.data):
                taken[k] = array
        if taken:
            found[node] = taken
    return found


def _changed_array(result: Node, branch: Region) -> Node | None:
    """The array from outside of a branch that a result of it is, or was made of."""
    if result.size is None:
        return None
    while result.op in ("update", "add_at") and result.depth == branch.depth:
        result = result.args[0]
    return result if result.depth < branch.depth else None


def _stays(array: Node, k: int, branch: Region) -> bool:
    """Whether result k of a branch is the array, or made of it by changes in place."""
    in_place, result = updated_in_place(branch, (array,)), branch.results[k]
    if sum(r is result for r in branch.results) != 1:
        return False
    while result is not array and result in in_place:
        result = result.args[0]
    return result is array


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
