"""Sums into tables. Reading an entry, adding to it and writing it back is one node, `add_at`.

A state moves slowly through a table, so what is added to a carried table is summed in registers while a lane stays at its place.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from plantfit.native.graph.nodes import F64, INTEGERS, Node, Region, all_regions, count_uses, regions_of


def join_sums(regions: Sequence[Region]) -> None:
    """Change the regions in place: `update(a, i, load(a, i) + d)` becomes `add_at(a, i, d)`."""
    uses = count_uses(regions)
    for top in regions:
        for region in all_regions(top):
            for node in region.code:
                added = _added(node, uses) if node.op == "update" else None
                if added is not None:
                    node.op, node.args, node.data = "add_at", (*node.args[:2], added), None


def _added(update: Node, uses: Counter[int]) -> Node | None:
    """What an update adds to the entry that it replaces."""
    array, index, value, allowed = update.args
    always = allowed.op == "const" and bool(allowed.data)
    if not always or value.op != "add" or value.dtype != F64 or uses[id(value)] != 1:
        return None
    for old, added in (value.args, value.args[::-1]):
        if old.op == "load" and old.args == (array, index) and old.data == 0 and uses[id(old)] == 1:
            return added
    return None


@dataclass(frozen=True, eq=False)
class TableSums:
    """The `add_at` nodes of a region at one index, each with the offset of its entry from there and the carried array it adds to."""

    index: Node
    terms: tuple[tuple[Node, int], ...]
    tables: dict[Node, Node]


def table_sums(body: Region) -> list[TableSums]:
    """Groups of the sums that can be held: they go to an array of the carry that nothing else in the loop reads."""
    groups: dict[tuple[int, Node], list[tuple[Node, int]]] = {}
    tables: dict[Node, Node] = {}
    for param, result in zip(body.params, body.results, strict=False):
        found = _sums_between(param, result, body) if param.size is not None else None
        for node, home in found or ():
            index, offset = _origin(node.args[1])
            groups.setdefault((id(home), index), []).append((node, offset))
            tables[node] = param
    return [TableSums(index, tuple(terms), tables) for (_, index), terms in groups.items()]


def _sums_between(array: Node, result: Node, region: Region) -> list[tuple[Node, Region]] | None:
    """The sums that lead from an array to a result of the region, with the regions that hold them; None where something else reads it."""
    found: list[tuple[Node, Region]] = []
    while array is not result:
        readers = [n for n in region.code if array in n.args or any(_reads(array, inner) for inner in regions_of(n))]
        if len(readers) != 1 or any(r is array for r in region.results):
            return None
        (reader,) = readers
        if reader.op == "add_at" and array not in reader.args[1:]:
            found.append((reader, region))
            array = reader
        elif reader.op == "cond":
            passed = _through(array, reader, region)
            if passed is None:
                return None
            array, more = passed
            found += more
        else:
            return None
    return found if sum(r is result for r in region.results) == 1 else None


def _through(array: Node, node: Node, region: Region) -> tuple[Node, list[tuple[Node, Region]]] | None:
    """The result that a `cond` makes of an array, and the sums of its branches."""
    for get in region.code:
        if get.op == "get" and get.args[0] is node and get.size is not None:
            parts = [_sums_between(array, branch.results[get.data], branch) for branch in node.data]
            if all(part is not None for part in parts):
                return get, [one for part in parts for one in part or ()]
    return None


def _reads(array: Node, region: Region) -> bool:
    inside = any(array in n.args or any(_reads(array, inner) for inner in regions_of(n)) for n in region.code)
    return inside or any(r is array for r in region.results)


def _origin(index: Node) -> tuple[Node, int]:
    """The index without a constant added to it, and the constant."""
    if index.op == "add" and index.dtype in INTEGERS:
        for origin, more in (index.args, index.args[::-1]):
            if more.op == "const":
                return origin, int(more.data)
    return index, 0
