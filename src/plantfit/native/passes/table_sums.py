"""Sums into tables. Reading an entry, adding to it and writing it back is one node, `add_at`.

A state moves slowly through a table, so what is added to a carried table is summed in registers while a lane stays at
its place.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
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
class TableSum:
    """What one `add_at` adds at an index plus `offset`: a sum of `parts`, less the total of the sum `without`.

    A part is one number or two factors, and whether it is subtracted.
    """

    node: Node
    offset: int
    table: Node  # the carried array
    parts: tuple[tuple[tuple[Node, ...], bool], ...]
    without: Node | None


@dataclass(frozen=True, eq=False)
class TableSums:
    """The sums of a region at one index. Nobody but they needs the nodes `inside`."""

    home: Region
    index: Node
    terms: tuple[TableSum, ...]
    inside: frozenset[Node]


def table_sums(body: Region) -> list[TableSums]:
    """Groups of the sums that can be held: they go to an array of the carry that nothing else in the loop reads."""
    groups: dict[tuple[int, Node], list[tuple[Node, int]]] = {}
    homes: dict[int, Region] = {}
    tables: dict[Node, Node] = {}
    for param, result in zip(body.params, body.results, strict=False):
        found = _sums_between(param, result, body) if param.size is not None else None
        for node, home in found or ():
            index, offset = _origin(node.args[1])
            groups.setdefault((id(home), index), []).append((node, offset))
            homes[id(home)], tables[node] = home, param
    uses = count_uses([body])
    return [_grouped(homes[home], index, terms, tables, uses) for (home, index), terms in groups.items()]


def _grouped(
    home: Region, index: Node, terms: list[tuple[Node, int]], tables: dict[Node, Node], uses: Counter[int]
) -> TableSums:
    own, inside = set(home.code), set[Node]()
    uses = Counter(uses)

    def once(node: Node) -> bool:
        return uses[id(node)] == 1 and node in own

    summed = {(tables[node], node.args[2]): node for node, _ in terms}
    without: dict[Node, Node] = {}
    for node, _ in terms:
        added = node.args[2]
        other = summed.get((tables[node], added.args[1])) if added.op == "sub" and once(added) else None
        # the weights of two neighbours are 1 - w and w: the sum of both and that of the second are kept
        if other is not None and other not in without and node not in without.values():
            without[node] = other
            inside.add(added)
            uses[id(added.args[1])] -= 1
    found = []
    for node, offset in terms:
        added = node.args[2].args[0] if node in without else node.args[2]
        parts = tuple(_parts(added, False, once, inside))
        found.append(TableSum(node, offset, tables[node], parts, without.get(node)))
    return TableSums(home, index, tuple(found), frozenset(inside))


def _parts(
    added: Node, minus: bool, once: Callable[[Node], bool], inside: set[Node]
) -> Iterator[tuple[tuple[Node, ...], bool]]:
    """What a number that is needed only here is a sum of; the nodes that are then not made go into `inside`."""
    if added.op == "fma" and once(added):
        a, b, rest = added.args
        inside.add(added)
        yield from _parts(rest, minus ^ added.data[1], once, inside)
        yield (a, b), minus ^ added.data[0]
    elif added.op == "mul" and once(added):
        inside.add(added)
        yield added.args, minus
    elif added.op == "neg" and once(added):
        inside.add(added)
        yield from _parts(added.args[0], not minus, once, inside)
    else:
        yield (added,), minus


def _sums_between(array: Node, result: Node, region: Region) -> list[tuple[Node, Region]] | None:
    """The sums that lead from an array to a result of the region, with the regions that hold them; None where
    something else reads it."""
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
