"""Table reads that repeat: which loads, and what follows from them alone, need no work while an index stays where it is.

A state moves slowly through a table, so the entries around it are kept between steps and read again only when some lane
has left its cell.
"""

from collections import Counter
from dataclasses import dataclass

from plantfit.native.graph import Node, Region, all_regions, regions_of

_LATER = {"load", "loop", "while", "cond", "get", "pack", "update", "libm", "patched", "xload", "constant", "cload"}


@dataclass(frozen=True, eq=False)
class Remembered:
    """Loads at one index and the nodes that follow from them, in order; `kept` are the ones used elsewhere."""

    index: Node
    nodes: tuple[Node, ...]
    kept: tuple[Node, ...]


def remembered(body: Region) -> dict[Node, Remembered]:
    """For every node that belongs to one, its group."""
    uses: Counter[int] = Counter()
    for region in all_regions(body):
        uses.update(id(a) for n in region.code for a in n.args)
        uses.update(id(r) for r in region.results)
    found: dict[Node, Remembered] = {}
    for region in all_regions(body):
        for group in _groups(region, uses):
            found.update(dict.fromkeys(group.nodes, group))
    return found


def _groups(region: Region, uses: Counter[int]) -> list[Remembered]:
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
            groups.append(Remembered(index, tuple(inside), kept))
    return groups


def _index(node: Node, member: dict[Node, Node]) -> Node | None:
    """The index that a node follows from alone, together with what never changes."""
    if node.op == "load":
        array, index = node.args
        return index if array.depth == 0 and index.depth > 0 else None
    if node.op in _LATER or regions_of(node) or node.size is not None:
        return None
    moving = [member.get(a) for a in node.args if a.depth > 0]
    return moving[0] if moving and all(m is moving[0] and m is not None for m in moving) else None
