"""Passes over a traced graph: dead code elimination, sums into tables, shared reciprocals, contraction to fused
multiply-add, signs taken by what uses them, and reads of step data moved to the branch that needs them.

Contraction is decided here and not by LLVM, so that a lane gives the same bits in every batch.
"""

from collections import Counter
from collections.abc import Sequence

from plantfit.native.graph.nodes import F64, Node, Region, all_regions, count_uses, regions_of
from plantfit.native.passes.table_sums import join_sums


def run_passes(regions: Sequence[Region], *, contract: bool) -> None:
    """Change the regions (prologue, body) in place; `contract` where the processor has fused multiply-add."""
    _eliminate_dead_code(regions)
    join_sums(regions)
    for top in regions:
        for region in all_regions(top):
            _share_reciprocals(region)
    if contract:
        _eliminate_dead_code(regions)
        _contract(regions)
    for top in regions:
        for region in all_regions(top):
            _sink_signs(region)
    _eliminate_dead_code(regions)
    for top in regions:
        _sink_rows(top)


def _eliminate_dead_code(regions: Sequence[Region]) -> None:
    used: set[int] = set()

    def mark(nodes: Sequence[Node]) -> None:
        pending = list(nodes)
        while pending:
            node = pending.pop()
            if id(node) in used:
                continue
            used.add(id(node))
            pending.extend(node.args)
            for inner in regions_of(node):
                pending.extend(inner.results)

    for region in regions:
        mark(region.results)
    for top in regions:
        for region in all_regions(top):
            region.code = [n for n in region.code if id(n) in used]


def _sink_rows(region: Region) -> None:
    """What a step reads only for one branch is read there."""
    readers: dict[
        int, list[tuple[Node, int] | None]
    ] = {}  # by node: the branches that read it, None for the region itself

    def note(node: Node, place: tuple[Node, int] | None) -> None:
        places = readers.setdefault(id(node), [])
        if place not in places:
            places.append(place)

    for node in region.code:
        for a in node.args:
            note(a, None)
        for k, inner in enumerate(regions_of(node)):
            for one in all_regions(inner):
                for a in (*(a for n in one.code for a in n.args), *one.results):
                    note(a, (node, k) if node.op == "cond" else None)
    for a in region.results:
        note(a, None)
    kept: list[Node] = []
    for node in region.code:
        place = readers[id(node)][0] if node.op == "xload" and len(readers[id(node)]) == 1 else None
        if place is None:
            kept.append(node)
        else:
            place[0].data[place[1]].code.insert(0, node)
    region.code = kept


def _share_reciprocals(region: Region) -> None:
    """a/c and b/c become a (1/c) and b (1/c): one division, and at most one more rounding error each."""
    shared = Counter(id(n.args[1]) for n in region.code if n.op == "div" and n.dtype == F64)
    inverse: dict[int, Node] = {}
    code: list[Node] = []
    for node in region.code:
        if node.op == "div" and node.dtype == F64 and shared[id(node.args[1])] > 1:
            over, under = node.args
            if id(under) not in inverse:
                inverse[id(under)] = Node("rcp", (under,), F64, None, None, node.depth)
                code.append(inverse[id(under)])
            node.op, node.args = "mul", (over, inverse[id(under)])
        code.append(node)
    region.code = code


def _contract(regions: Sequence[Region]) -> None:
    """A product that is used once, by a sum or difference, is fused with it."""
    uses = count_uses(regions)
    for region in (r for top in regions for r in all_regions(top)):
        for node in region.code:
            if node.op in ("add", "sub") and node.dtype == F64:
                _contract_one(node, uses)


def _contract_one(node: Node, uses: Counter[int]) -> None:
    left, right = node.args
    minus = node.op == "sub"
    if right.op == "mul" and uses[id(right)] == 1:
        node.op, node.args, node.data = "fma", (*right.args, left), (minus, False)
    elif left.op == "mul" and uses[id(left)] == 1:
        node.op, node.args, node.data = "fma", (*left.args, right), (False, minus)


def _sink_signs(region: Region) -> None:
    """A change of sign goes through products to the sums that take it for nothing; results keep their bits."""
    code: list[Node] = []
    for node in region.code:
        if node.dtype == F64 and node.op in ("mul", "fma", "add", "sub"):
            code.extend(_without_signs(node))
        code.append(node)
    region.code = code


def _without_signs(node: Node) -> list[Node]:
    """Change a node so that it takes the signs of what it is made of; what has to stand ahead of it."""
    minus = [a.op == "neg" for a in node.args]
    if not any(minus):
        return []
    bare = tuple(a.args[0] if m else a for a, m in zip(node.args, minus, strict=True))
    if node.op == "fma":
        of_product, of_sum = node.data
        node.args, node.data = bare, (of_product ^ minus[0] ^ minus[1], of_sum ^ minus[2])
    elif node.op == "mul":
        node.args = bare
        if minus[0] != minus[1]:
            product = Node("mul", bare, F64, None, None, node.depth)
            node.op, node.args = "neg", (product,)
            return [product]
    elif minus[1]:
        if not minus[0]:
            node.op, node.args = "sub" if node.op == "add" else "add", bare
        elif node.op == "sub":  # -a + b
            node.op, node.args = "sub", bare[::-1]
    elif node.op == "add":
        node.op, node.args = "sub", bare[::-1]
    return []
