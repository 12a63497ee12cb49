"""Events, dry friction and backlash of equations: their checks, and the declarations they become."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import EquationError
from plantfit.models.parts.switching import Backlash, Event, Friction, Scalar
from plantfit.models.text.declarations import Declarations
from plantfit.models.text.dimensions.unit_check import UnitChecker
from plantfit.models.text.expression import Node
from plantfit.models.text.friction_text import FORM, FrictionTable, FrictionTerm, slope_sign
from plantfit.models.text.parse import Statement, When
from plantfit.models.text.suggest import suggest

# isort: split
import jax
import jax.numpy as jnp

Maker = Callable[[Mapping[str, Node]], Callable[..., Any]]  # named expressions to a function (x, u, p[, forces])

_DIRECTIONS: dict[str, Literal["falling", "rising", "both"]] = {
    "falling": "falling",
    "rising": "rising",
    "crossing": "both",
}


@dataclass
class Hybrid:
    """What stands in the text beside derivatives and values. `plays` are z = play(x, gap) by state."""

    declared: Declarations
    text: str
    frictions: FrictionTable
    plays: dict[str, Statement] = field(default_factory=dict)
    events: list[When] = field(default_factory=list)

    def expressions(self) -> Iterator[Node]:
        """Everything that must be read beside derivatives and values."""
        yield from (part for play in self.plays.values() for part in play.right.args)
        for event in self.events:
            yield event.condition
            yield from (reset.right for reset in event.resets)

    def add_event(self, event: When) -> None:
        """Keep an event whose resets name states, each once."""
        seen: set[str] = set()
        for reset in event.resets:
            if reset.derivative:
                message = f"An event sets the state itself; write {reset.target} = ..., without '."
                raise self._fail(message, reset.place)
            if reset.target not in self.declared.states:
                hint = suggest(reset.target, self.declared.states)
                raise self._fail(
                    f"{reset.target!r} is not a state; events set {list(self.declared.states)}.{hint}", reset.place
                )
            if reset.target in seen:
                raise self._fail(f"{reset.target!r} is set twice by this event; keep one.", reset.place)
            seen.add(reset.target)
        self.events.append(event)

    def check(self, values: Mapping[str, Statement], derivatives: Mapping[str, Statement]) -> None:
        """Raise EquationError where a friction, a backlash or an event stands where it cannot work."""
        rights = {name: s.right for name, s in values.items()}
        self._check_plays(rights, [*rights.values(), *(s.right for s in derivatives.values())])
        for event in self.events:
            for reset in (r for r in event.resets if r.target in self.plays):
                message = f"{reset.target!r} is given by play() and cannot jump; let what drives it jump."
                raise self._fail(message, reset.place)
        for term in self.frictions.terms.values():
            self._check_friction(term, rights, {state: s.right for state, s in derivatives.items()})

    def _check_plays(self, rights: Mapping[str, Node], others: Sequence[Node]) -> None:
        for node in (n for root in (*others, *self.expressions()) for n in root.walk()):
            if node.op == "play":
                message = (
                    "play() must stand alone, right of a state without derivative; write z = play(x, gap) and use z."
                )
                raise self._fail(message, node.place)
        for state, play in self.plays.items():
            gap = play.right.args[1]
            if gap.op == "negative" or (gap.op == "number" and gap.number < 0):
                raise self._fail("The gap of play() is negative; write half of the whole play, 0 or more.", gap.start)
            for part in play.right.args:
                if state in _reach(part, rights):
                    raise self._fail(
                        f"{state!r} follows from play() and cannot drive itself; break the circle.", part.start
                    )

    def _check_friction(self, term: FrictionTerm, rights: Mapping[str, Node], derivatives: Mapping[str, Node]) -> None:
        outside = [*(rights[o] for o in self.declared.outputs if o in rights), *self.expressions()]
        outside += [a for other in self.frictions.terms.values() for a in other.call.args]
        if any(term.name in _reach(node, rights) for node in outside):
            message = (
                f"{term.name} acts in derivatives only; outputs, events, play() and other frictions cannot read it."
            )
            raise self._fail(message, term.call.place)
        rate, nodes = derivatives.get(term.velocity), {n: v for n, v in rights.items() if n not in self.frictions.terms}
        for node in self._affected(term, rights, derivatives).values():
            slope_sign(node, term.name, nodes, self.text)
        sign = slope_sign(rate, term.name, nodes, self.text) if rate is not None else 0
        if sign >= 0:
            how = "does not slow" if sign == 0 else "speeds up"
            raise self._fail(
                f"{term.name} {how} {term.velocity!r}; subtract it in its derivative, as in {FORM}.", term.call.place
            )

    def _affected(
        self, term: FrictionTerm, rights: Mapping[str, Node], derivatives: Mapping[str, Node]
    ) -> dict[str, Node]:
        return {state: node for state, node in derivatives.items() if term.name in _reach(node, rights)}

    def check_units(self, checker: UnitChecker, states: Mapping[str, Any]) -> None:
        """Units of backlashes and resets against those of their states; conditions must agree within."""
        for state, play in self.plays.items():
            checker.expect(play.right, states[state], f"The play that {state!r} follows")
        for event in self.events:
            checker.unit(event.condition)
            for reset in event.resets:
                checker.expect(reset.right, states[reset.target], f"The new value of {reset.target!r}")

    def declarations(
        self, make: Maker, values: Mapping[str, Statement], derivatives: Mapping[str, Statement]
    ) -> tuple[tuple[Event, ...], tuple[Friction, ...], tuple[Backlash, ...]]:
        """Events, frictions and backlashes of the model; `make` turns expressions into functions."""
        rights, rates = {n: s.right for n, s in values.items()}, {n: s.right for n, s in derivatives.items()}
        events = tuple(
            Event(
                f"{e.kind}({e.words}) in line {e.place[0] + 1}",
                _scalar(make, e.condition),
                make({r.target: r.right for r in e.resets}),
                _DIRECTIONS[e.kind],
            )
            for e in self.events
        )
        frictions = tuple(
            Friction(
                t.velocity,
                _scalar(make, t.sliding),
                _scalar(make, t.breakaway),
                _effect(make(self._affected(t, rights, rates)), t.name),
            )
            for t in self.frictions.terms.values()
        )
        plays = tuple(Backlash(s, *(_scalar(make, a) for a in play.right.args)) for s, play in self.plays.items())
        return events, frictions, plays

    def _fail(self, message: str, place: tuple[int, int]) -> EquationError:
        return EquationError(message, self.text, *place)


def _reach(node: Node, rights: Mapping[str, Node]) -> set[str]:
    """Every name that an expression depends on, also through intermediate values."""
    found: set[str] = set()
    waiting = node.names()
    while waiting:
        name = waiting.pop()
        found.add(name)
        waiting |= (rights[name].names() if name in rights else set()) - found
    return found


def _scalar(make: Maker, node: Node) -> Scalar:
    function = make({"value": node})
    return lambda x, u, p: function(x, u, p)["value"]


def _effect(rates: Callable[..., Any], force: str) -> Callable[..., Any]:
    """Rates per unit of a force that acts along the motion: minus those per unit of what is subtracted, in which
    they are linear."""

    def effect(x, u, p):
        slopes = jax.jvp(lambda f: rates(x, u, p, {force: f}), (jnp.zeros(()),), (jnp.ones(()),))[1]
        return {state: -slope for state, slope in slopes.items()}

    return effect
