"""What cannot be a plant, found before its equations are solved: nodes that hang, and quantities that are given
twice or by nothing."""

from plantfit.errors import EquationError
from plantfit.models.networks.netlist import Netlist, Placed
from plantfit.models.networks.parts import GROUND


def check(netlist: Netlist) -> None:
    """Raise EquationError that names the parts and says what to write."""
    _hanging(netlist)
    _loops(netlist)
    _cuts(netlist)


def rigid(netlist: Netlist, parts: tuple[str, ...]) -> EquationError:
    """What the matching of equations to unknowns found, where gears, wheels and motors join ports."""
    parts = tuple(p for p in netlist.parts if p in parts)
    stores = [p for p in parts if netlist.parts[p].part.law == "stores across"]
    line = netlist.parts[parts[0]].line if parts else 0
    named = _listed(parts)
    if len(stores) > 1:
        return netlist.wrong(
            f"{named} are joined rigidly, so that {_listed(stores)} "
            "are one store: write one of them, which then stands "
            "for all, or join them by a spring or a resistor", line, parts[0])  # fmt: skip
    return netlist.wrong(
        f"{named} fix one quantity twice, or leave it to none; take one away, or put a part between that gives way",
        line,
        parts[0] if parts else "")  # fmt: skip


def ports(placed: Placed) -> list[tuple[str, str]]:
    """Pairs of nodes between which a part acts."""
    part = placed.part
    if part.second is None:
        return [(placed.nodes[0], GROUND if part.grounded else placed.nodes[1])]
    first = (placed.nodes[0], GROUND if len(part.nodes) == 2 else placed.nodes[1])
    return [first, (placed.nodes[-1], GROUND)]


def _hanging(netlist: Netlist) -> None:
    for node, domain in netlist.domains.items():
        touching = [p for p in netlist.parts.values() if node in p.nodes]
        if len(touching) == 1:
            only = touching[0]
            raise netlist.wrong(
                f"node {node!r} hangs at {only.name} alone, so that no "
                f"{domain.through.word} can pass; join another part to it, or 0",
                only.line, node)  # fmt: skip


def _loops(netlist: Netlist) -> None:
    """Loops of parts that all set the quantity across them."""
    tree: dict[str, list[tuple[str, str]]] = {}
    for placed in netlist.parts.values():
        if placed.part.law not in ("sets across", "stores across"):
            continue
        ((a, b),) = ports(placed)
        way = _way(tree, a, b)
        if way is None:
            tree.setdefault(a, []).append((b, placed.name))
            tree.setdefault(b, []).append((a, placed.name))
            continue
        parts = [*way, placed.name]
        word = placed.part.domain.across.word
        stores = [p for p in parts if netlist.parts[p].part.law == "stores across"]
        if not stores:
            raise netlist.wrong(
                f"{_listed(parts)} give one {word} twice (a shorted source); take one away, or put a part between",
                placed.line, placed.name)  # fmt: skip
        between = {"electric": "a resistor", "thermal": "a heat_resistance", "hydraulic": "a pipe or a valve"}.get(
            placed.part.domain.name, "a spring or a damper"
        )
        one = f", or write {_listed(stores)} as one" if len(stores) == len(parts) else ""
        raise netlist.wrong(
            f"{_listed(parts)} form a loop in which every {word} is set, so that {_listed(stores)} "
            f"{'are' if len(stores) > 1 else 'is'} no "
            f"free store; put {between} into it{one}", placed.line, placed.name)  # fmt: skip


def _way(tree: dict[str, list[tuple[str, str]]], a: str, b: str) -> list[str] | None:
    """Names of the parts between two nodes of the tree."""
    waiting, seen = [(a, [])], {a}
    while waiting:
        node, way = waiting.pop()
        if node == b:
            return way
        for other, name in tree.get(node, []):
            if other not in seen:
                seen.add(other)
                waiting.append((other, [*way, name]))
    return None


def _cuts(netlist: Netlist) -> None:
    """Nodes that only parts reach which set what passes through them: nothing says what is across."""
    group = {node: node for node in (GROUND, *netlist.domains)}

    def root(node: str) -> str:
        while group[node] != node:
            node = group[node]
        return node

    free = {"stores through", "is elastic", "sets through", "curve"}
    for placed in netlist.parts.values():
        if placed.part.law not in free:
            for a, b in ports(placed):
                group[root(a)] = root(b)
    for node, domain in netlist.domains.items():
        if root(node) == root(GROUND):
            continue
        island = [n for n in netlist.domains if root(n) == root(node)]
        meeting = [p for p in netlist.parts.values() if any(n in island for n in p.nodes)]
        setting = [p.name for p in meeting if p.part.law in free]
        one = island[0] if len(island) == 1 else "nodes " + _listed(island)
        where = f"node {one!r}" if len(island) == 1 else one
        if setting:
            raise netlist.wrong(
                f"nothing settles the {domain.across.word} at {where}, where only {_listed(setting)} "
                f"lead{'s' * (len(setting) == 1)}; "
                f"add {domain.holds} there", netlist.parts[setting[0]].line, island[0])  # fmt: skip
        raise netlist.wrong(
            f"{where} floats: no part leads from there to node 0; join one of its parts to 0",
            meeting[0].line,
            island[0],
        )


def _listed(names: list[str] | tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
