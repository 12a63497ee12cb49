"""The expression tree that equations are read into."""

from collections.abc import Iterator
from dataclasses import dataclass

from plantfit.models.parts.tables import Table
from plantfit.models.text.scan import Place


@dataclass(frozen=True)
class Node:
    """`op` is "number" (with `number`), "name" (with `name`), "table" (with `name` and `table`) or a key of
    `functions.FUNCTIONS`.

    `place` is the (line, column) of the operator, function name, number or name, `start` that of
    the first character of the whole expression.
    """

    op: str
    place: Place
    start: Place
    args: tuple["Node", ...] = ()
    number: float = 0.0
    name: str = ""
    table: Table | None = None

    def walk(self) -> Iterator["Node"]:
        """This node and all below it, from left to right."""
        waiting: list[Node] = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting.extend(reversed(node.args))

    def names(self) -> set[str]:
        """Names of signals and parameters that the expression reads; tables are parameters."""
        return {n.name for n in self.walk() if n.op in ("name", "table")}
