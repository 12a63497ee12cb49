"""Uniformity analysis: which nodes vary between the lanes of a batch, and which are one number for all."""

from collections.abc import Callable, Sequence

from plantfit.native.graph.nodes import Node, Region


class Uniformity:
    """Answers `varies(node)` for nodes that have been analysed; `leaf_varies` answers for inputs ("cload",
    "constant", "xload")."""

    def __init__(self, leaf_varies: Callable[[Node], bool]):
        self.leaf_varies = leaf_varies
        self._varies: dict[Node, bool] = {}

    def varies(self, node: Node) -> bool:
        return self._varies[node] if node.op != "const" else False

    def analyse(self, region: Region) -> None:
        """All nodes of a region whose parameters have been analysed."""
        for node in region.code:
            self._varies[node] = self._one(node)

    def analyse_loop(
        self, region: Region, params: Sequence[Node], begin: list[bool], *, test: Region | None = None
    ) -> None:
        """A loop body with its carried parameters, to the fixed point; `begin`: which initial values vary."""
        varies = list(begin)
        while True:
            self._varies.update(zip(params, varies, strict=True))
            diverges = False
            if test is not None:
                self.analyse(test)
                diverges = self.varies(test.results[0])
            self.analyse(region)
            # rows may follow
            after = [diverges or a or self.varies(r) for a, r in zip(varies, region.results, strict=False)]
            if after == varies:
                return
            varies = after

    def _one(self, node: Node) -> bool:
        if node.op in ("cload", "constant", "xload"):
            return self.leaf_varies(node)
        if node.op == "loop":
            region = node.data[0]
            self._varies[region.params[0]] = False  # the counter
            self.analyse_loop(region, region.params[1:], [self.varies(a) for a in node.args[1:]])
            return False
        if node.op == "while":
            self.analyse_loop(node.data[1], node.data[1].params, [self.varies(a) for a in node.args], test=node.data[0])
            return False
        if node.op == "cond":
            for region in node.data:
                self.analyse(region)
            return False
        if node.op == "get":
            return self._result(node.args[0], node.data)
        return any(map(self.varies, node.args))

    def _result(self, node: Node, k: int) -> bool:
        """Result k of a loop or branch."""
        if node.op == "loop":
            return self.varies(node.data[0].params[k + 1])
        if node.op == "while":
            return self.varies(node.data[1].params[k])
        return self.varies(node.args[0]) or any(self.varies(r.results[k]) for r in node.data)
