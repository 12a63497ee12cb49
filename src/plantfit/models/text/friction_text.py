"""friction(v, sliding, breakaway) in equations: dry friction that sticks, found in the derivatives it acts in."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from plantfit.errors import EquationError
from plantfit.models.text.declarations import Declarations
from plantfit.models.text.expression import Node
from plantfit.models.text.parse import Statement

FORM = "v' = (F - friction(v, sliding, breakaway))/m"


@dataclass(frozen=True)
class FrictionTerm:
    """The friction of one velocity: its force stands in the equations under `name`."""

    name: str
    velocity: str
    call: Node

    @property
    def sliding(self) -> Node:
        return self.call.args[1]

    @property
    def breakaway(self) -> Node:
        """The sliding force where no breakaway force is given."""
        return self.call.args[-1]


class FrictionTable:
    """Collects the frictions of a model while its expressions are rewritten."""

    def __init__(self, declared: Declarations, text: str):
        self.declared = declared
        self.text = text
        self.terms: dict[str, FrictionTerm] = {}  # by name

    def rewrite(self, node: Node) -> Node:
        """The expression with every friction replaced by the name of its force."""
        if node.args:
            node = replace(node, args=tuple(self.rewrite(a) for a in node.args))
        if node.op != "friction":
            return node
        velocity = node.args[0]
        if velocity.op != "name" or velocity.name not in self.declared.states:
            message = (
                f"friction() takes the velocity first, one of the states {list(self.declared.states)}; write {FORM}."
            )
            raise EquationError(message, self.text, *velocity.start)
        name = f"friction({velocity.name})"
        known = self.terms.setdefault(name, FrictionTerm(name, velocity.name, node))
        if not _alike(known.call, node):
            message = (
                f"{velocity.name!r} has another friction in line "
                f"{known.call.place[0] + 1}; add the forces up inside of one."
            )
            raise EquationError(message, self.text, *node.place)
        return Node("name", node.place, node.start, name=name)

    def values(self) -> dict[str, Statement]:
        """The forces as intermediate values, for the checks of names and units."""
        return {name: Statement(name, False, term.call.place, term.call) for name, term in self.terms.items()}


def slope_sign(node: Node, force: str, values: Mapping[str, Node], text: str) -> int:
    """With which sign a force enters an expression: 1, -1, or 0 when it does not; other factors count as positive.

    `values` are the intermediate values. Raises EquationError where it enters with both signs or not linearly.
    """
    if node.op == "name":
        if node.name == force:
            return 1
        return slope_sign(values[node.name], force, values, text) if node.name in values else 0
    signs = [slope_sign(a, force, values, text) for a in node.args]
    if not any(signs):
        return 0
    match node.op:
        case "+":
            return _joined(signs, node, force, text)
        case "-":
            return _joined([signs[0], -signs[1]], node, force, text)
        case "negative":
            return -signs[0]
        case "*" if not all(signs):
            other = node.args[signs.index(0)]
            return sum(signs) * (-1 if _is_negative(other) else 1)
        case "/" if not signs[1]:
            return signs[0] * (-1 if _is_negative(node.args[1]) else 1)
        case "where" if not signs[0]:
            return _joined(signs[1:], node, force, text)
    raise EquationError(
        f"{force} must enter linearly, times or over what does not hold it; write {FORM}.", text, *node.place
    )


def _joined(signs: list[int], node: Node, force: str, text: str) -> int:
    found = {s for s in signs if s}
    if len(found) > 1:
        raise EquationError(f"{force} enters here with + and with -; write it once.", text, *node.place)
    return found.pop()


def _is_negative(node: Node) -> bool:
    return node.op == "negative" or (node.op == "number" and node.number < 0)


def _alike(a: Node, b: Node) -> bool:
    """The same expression, wherever it stands."""
    same = (a.op, a.name, a.number, len(a.args)) == (b.op, b.name, b.number, len(b.args))
    return same and all(_alike(c, d) for c, d in zip(a.args, b.args, strict=True))
