"""Which nodes differ between the lanes of a batch, and which are one number for all."""

from collections.abc import Callable, Sequence

from plantfit.native.graph import Node, Region


class Variance:
    """`varies[node]` after `region(...)`; `leaf_varies` tells it for the inputs ("cload", "constant", "xload")."""

    def __init__(self, leaf_varies: Callable[[Node], bool]):
        self.leaf_varies = leaf_varies
        self.varies: dict[Node, bool] = {}

    def of(self, node: Node) -> bool:
        return self.varies[node] if node.op != "const" else False

    def code(self, region: Region) -> None:
        """All nodes of a region whose parameters are known."""
        for node in region.code:
            self.varies[node] = self._one(node)

    def carried(self, region: Region, params: Sequence[Node], begin: list[bool], *, test: Region | None = None) -> list[bool]:
        """Carried parameters of a loop body, from what they begin with and what one pass makes of them."""
        varies = list(begin)
        while True:
            self.varies.update(zip(params, varies, strict=True))
            stops_apart = False
            if test is not None:
                self.code(test)
                stops_apart = self.of(test.results[0])
            self.code(region)
            after = [stops_apart or a or self.of(r) for a, r in zip(varies, region.results, strict=False)]  # a row may follow
            if after == varies:
                return varies
            varies = after

    def _one(self, node: Node) -> bool:
        if node.op in ("cload", "constant", "xload"):
            return self.leaf_varies(node)
        if node.op == "loop":
            region = node.data[0]
            self.varies[region.params[0]] = False  # the counter
            self.carried(region, region.params[1:], [self.of(a) for a in node.args[1:]])
            return False
        if node.op == "while":
            self.carried(node.data[1], node.data[1].params, [self.of(a) for a in node.args], test=node.data[0])
            return False
        if node.op == "cond":
            for region in node.data:
                self.code(region)
            return False
        if node.op == "get":
            return self._result(node.args[0], node.data)
        return any(map(self.of, node.args))

    def _result(self, node: Node, k: int) -> bool:
        if node.op == "loop":
            return self.of(node.data[0].params[k + 1])
        if node.op == "while":
            return self.of(node.data[1].params[k])
        return self.of(node.args[0]) or any(self.of(r.results[k]) for r in node.data)
