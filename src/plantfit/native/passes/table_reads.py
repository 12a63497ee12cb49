"""Table reads to cache between steps: loads, and what follows from them alone, are repeated only when an index has
changed.

A state moves slowly through a table, so the entries around it are read again only when some lane has left its cell.
"""

from collections import Counter
from dataclasses import dataclass

from plantfit.native.graph.nodes import Node, Region, all_regions, count_uses, regions_of

_UNCACHED = {
    "load",
    "loop",
    "while",
    "cond",
    "get",
    "pack",
    "update",
    "add_at",
    "libm",
    "patched",
    "xload",
    "constant",
    "cload",
}


@dataclass(frozen=True, eq=False)
class TableReads:
    """Loads at one index and the nodes that follow from them, in order; `kept` are the ones used elsewhere."""

    index: Node
    nodes: tuple[Node, ...]
    kept: tuple[Node, ...]


def table_reads(body: Region) -> dict[Node, TableReads]:
    """The group of every node that belongs to one."""
    uses = count_uses([body])
    found: dict[Node, TableReads] = {}
    for region in all_regions(body):
        for group in _groups(region, uses):
            found.update(dict.fromkeys(group.nodes, group))
    return found


def _groups(region: Region, uses: Counter[int]) -> list[TableReads]:
    member: dict[Node, Node] = {}  # to the index of its group
    nodes: dict[Node, list[Node]] = {}
    for node in region.code:
        index = _index(node, member)
        if index is not None:
            member[node] = index
            nodes.setdefault(index, []).append(node)
    groups = []
    for index, inside in nodes.items():
        if sum(n.op == "load" for n in inside) > 1:
            within = Counter(id(a) for n in inside for a in n.args)
            kept = tuple(n for n in inside if uses[id(n)] > within[id(n)])
            groups.append(TableReads(index, tuple(inside), kept))
    return groups


def _index(node: Node, member: dict[Node, Node]) -> Node | None:
    """The one index that a node depends on, besides loop invariants."""
    if node.op == "load":
        array, index = node.args
        return index if array.depth == 0 and index.depth > 0 else None
    if node.op in _UNCACHED or regions_of(node) or node.size is not None:
        return None
    moving = [member.get(a) for a in node.args if a.depth > 0]
    return moving[0] if moving and all(m is moving[0] and m is not None for m in moving) else None
