"""What equations say about units, as products that must be 1: every sum, comparison, derivative and output says
something."""

from collections.abc import Mapping
from dataclasses import dataclass

from plantfit.models.text.dimensions.forms import NUMBER, SECOND, Form, Key, fraction, unknown
from plantfit.models.text.expression import Node
from plantfit.models.text.functions import FUNCTIONS

TIME = "t"


@dataclass(frozen=True)
class Relation:
    """A product of units that must be 1. `what` begins a sentence; a `plain` one comes of a function that takes
    numbers."""

    form: Form
    what: str
    node: Node
    plain: bool = False


class Relations:
    """Collects relations; `numbers` are the values of constants, for exponents. None is the unit of zero, which fits
    beside any other.

    Numbers in the text may carry units that nobody wrote, so each has an unknown unit of its own; `factors` are those
    that multiply or divide, by key.
    """

    def __init__(self, numbers: Mapping[str, float], axes: Mapping[str, tuple[Key, ...]]):
        self.numbers = numbers
        self.axes = axes
        self.all: list[Relation] = []
        self.factors: dict[Key, tuple[str, Node]] = {}
        self._count = 0
        self._what = ""
        self._scope: Mapping[str, Key] = {}

    def at(self, what: str, scope: Mapping[str, Key]) -> None:
        """What follows is said by one statement, whose names are these things."""
        self._what, self._scope = what, scope

    def say(self, form: Form | None, node: Node, plain: bool = False) -> None:
        """That a product is 1."""
        if form is not None and (form.powers or not form.pure):
            self.all.append(Relation(form, self._what, node, plain))

    def relate(self, node: Node, target: Form | None) -> None:
        """That an expression has a unit; every part of a sum has it by itself."""
        if target is None:
            self.form(node)
            return
        if node.op == "number":
            return
        rule = FUNCTIONS[node.op].rule if node.table is None and node.op != "name" else ""
        if rule in ("same", "choose"):
            for arg in node.args[1:] if rule == "choose" else node.args:
                self.relate(arg, target)
            if rule == "choose":
                self.form(node.args[0])
            return
        if rule in ("times", "over"):
            first, second = node.args
            if _is_sum(first):
                other = self._factor(second)
                if other is not None:
                    self.relate(first, target.over(other) if rule == "times" else target.times(other))
                return
            if _is_sum(second) and rule == "times":
                other = self._factor(first)
                if other is not None:
                    self.relate(second, target.over(other))
                return
        found = self.form(node)
        self.say(None if found is None else found.over(target), node)

    def form(self, node: Node) -> Form | None:
        """The unit of an expression."""
        if node.op == "number":
            return None if node.number == 0 else self._fresh()
        if node.op == "name":
            return (
                SECOND
                if node.name == TIME
                else unknown(self._scope[node.name])
                if node.name in self._scope
                else self._fresh()
            )
        if node.table is not None:
            for arg, axis in zip(node.args, self.axes[node.name], strict=True):
                self.relate(arg, SECOND if axis[0] == "time" else unknown(axis))
            return unknown(self._scope[node.name])
        rule = FUNCTIONS[node.op].rule
        if rule in ("times", "over"):
            a, b = map(self._factor, node.args)
            if a is None or b is None:
                return self._fresh() if a is not None and rule == "over" else None
            return a.times(b) if rule == "times" else a.over(b)
        if rule == "power":
            return self._power(node)
        if rule == "root":
            found = self.form(node.args[0])
            return None if found is None else NUMBER.times(found, fraction(0.5))
        if rule in ("plain", "angle", "logic"):
            for arg in node.args:
                found = self.form(arg)
                if rule != "logic":
                    self.say(found, arg, plain=True)
            return NUMBER
        if rule == "law":
            own = FUNCTIONS[node.op].like_result
            return [
                self._alike(tuple(a for k, a in enumerate(node.args) if (k in own) == inside))
                for inside in (False, True)
            ][1]
        if rule == "choose":
            self.form(node.args[0])
        shared = self._alike(node.args[1:] if rule == "choose" else node.args)
        return NUMBER if rule == "ratio" else shared

    def _alike(self, args: tuple[Node, ...]) -> Form | None:
        """The unit that all arguments share."""
        rest = [a for a in args if a.op != "number"]
        if not rest:
            return None if all(a.number == 0 for a in args) else self._fresh()
        shared = self.form(rest[0])
        for arg in rest[1:]:
            if shared is None:
                shared = self.form(arg)
            else:
                self.relate(arg, shared)
        return shared

    def _factor(self, node: Node) -> Form | None:
        """The unit of what multiplies or divides; a 1 has none."""
        if node.op != "number" or node.number == 0:
            return self.form(node)
        if node.number == 1:
            return NUMBER
        key = self._key()
        self.factors[key] = self._what, node
        return unknown(key)

    def _power(self, node: Node) -> Form | None:
        base, power = self.form(node.args[0]), node.args[1]
        number = power.number if power.op == "number" else self.numbers.get(power.name) if power.op == "name" else None
        if power.op == "negative" and power.args[0].op == "number":
            number = -power.args[0].number
        if base is None or number is not None:
            return base if base is None else NUMBER.times(base, fraction(number))
        self.form(power)
        if len(base.powers) == 1 and next(iter(base.powers))[0] == "parameter":
            # a parameter with a power that changes is a number, as the rangeability of a valve
            self.say(base, node.args[0], plain=True)
            return NUMBER
        return self._fresh() if base.powers or not base.pure else NUMBER

    def _fresh(self) -> Form:
        return unknown(self._key())

    def _key(self) -> Key:
        self._count += 1
        return "number", str(self._count)


def _is_sum(node: Node) -> bool:
    return node.table is None and node.op not in ("number", "name") and FUNCTIONS[node.op].rule in ("same", "choose")
