"""The declared units of a whole model held against one another, through everything whose unit nobody declared."""

from collections.abc import Iterable, Mapping

from plantfit import units
from plantfit.errors import EquationError
from plantfit.models.text.declarations import Declarations
from plantfit.models.text.dimensions.contradictions import Contradiction, Known, contradiction
from plantfit.models.text.dimensions.forms import SECOND, Key, form_of, unknown
from plantfit.models.text.dimensions.relations import TIME, Relations
from plantfit.models.text.dimensions.unit_check import unit_of
from plantfit.models.text.expression import Node
from plantfit.models.text.parse import Statement, When


class WholeModel:
    """Gathers what the statements of a model say about units. `channels` are delayed signals and what they are
    copies of."""

    def __init__(self, declared: Declarations, text: str, values: Iterable[str], channels: Mapping[str, str]):
        d = self.declared = declared
        self.text = text
        keys: dict[str, Key] = {n: ("value", n) for n in values}
        kinds: tuple[tuple[str, Iterable[str]], ...] = (
            ("output", d.outputs), ("state", d.states), ("input", d.inputs), ("parameter", d.parameters),
            ("constant", d.constants),
        )  # fmt: skip
        for kind, names in kinds:
            keys |= {n: (kind, n) for n in names}
        self.scope = keys | {channel: keys[signal] for channel, signal in channels.items()}
        self.at_start = keys | {n: ("output", n) for n in d.outputs}
        axes = {
            n: tuple(("time", TIME) if s == TIME else self.at_start[s] for s in table.over)
            for n, table in d.tables.items()
        }
        self.relations = Relations({n: c.value for n, c in d.constants.items()}, axes)
        self._started: dict[int, str] = {}  # the text that a relation stands in, where it is not that of the equations

    def delays(self, times: Iterable[Node]) -> None:
        for time in times:
            self._say("A delay", time, self.relations.relate, SECOND)

    def values(self, values: Mapping[str, Statement]) -> None:
        """Outputs and intermediate values."""
        for name, statement in values.items():
            what = f"Output {name!r}" if name in self.declared.outputs else f"The equation of {name!r}"
            self._say(what, statement.right, self.relations.relate, unknown(self.scope[name]))
        for name in self.declared.outputs:
            if name not in values:
                node = Node("name", (0, 0), (0, 0), name=name)
                self._say(f"Output {name!r}", node, self.relations.relate, unknown(("output", name)))

    def derivatives(self, derivatives: Mapping[str, Statement]) -> None:
        for state, statement in derivatives.items():
            self._say(
                f"The derivative of {state!r}",
                statement.right,
                self.relations.relate,
                unknown(("state", state)).over(SECOND),
            )

    def plays_and_events(self, plays: Mapping[str, Statement], events: Iterable[When]) -> None:
        for state, play in plays.items():
            self._say(f"The play that {state!r} follows", play.right, self.relations.relate, unknown(("state", state)))
        for event in events:
            self._say("The condition of an event", event.condition, lambda node, _: self.relations.form(node), None)
            for reset in event.resets:
                self._say(
                    f"The new value of {reset.target!r}",
                    reset.right,
                    self.relations.relate,
                    unknown(("state", reset.target)),
                )

    def initial(self, initial: Mapping[str, Node | float]) -> None:
        for state, node in initial.items():
            if isinstance(node, Node):
                before = len(self.relations.all)
                self.relations.at(f"The initial value of {state!r}", self.at_start)
                self.relations.relate(node, unknown(("state", state)))
                self._started |= {id(r): str(self.declared.initial[state]) for r in self.relations.all[before:]}

    def contradiction(self) -> tuple[Contradiction, dict[Key, Known]] | None:
        known = self._known({}, {})
        found = contradiction(self.relations, known)
        return None if found is None else (found, known)

    def check(self) -> None:
        """Raise EquationError where declared units contradict each other."""
        found = self.contradiction()
        if found is not None:
            raise self._error(*found)

    def check_beside(self, parameters: Mapping[str, str], recorded: Mapping[str, str]) -> None:
        """Raise EquationError where units that a problem gives to parameters, or recordings to signals, contradict the
        declared ones.

        A recorded unit of another kind may be misread (C for Celsius is a coulomb) and is left alone; one of another
        size is refused.
        """
        recorded = {n: unit for n, unit in recorded.items() if units.known(unit)}
        if not parameters and not recorded:
            return
        known = self._known(parameters, recorded)
        found = contradiction(self.relations, known)
        if found is not None and any(
            k[1] in parameters or (k[1] in recorded and found.alike(k, known)) for k in found.needed
        ):
            raise self._error(found, known)

    def _error(self, found: Contradiction, known: dict[Key, Known]) -> EquationError:
        return found.error(known, self._started.get(id(found.relation), self.text))

    def _say(self, what: str, node: Node, say, target) -> None:
        self.relations.at(what, self.scope)
        say(node, target)

    def _known(self, parameters: Mapping[str, str], recorded: Mapping[str, str]) -> dict[Key, Known]:
        d, found = self.declared, {}
        found |= {("state", n): (unit, None, None) for n, unit in d.states.items()}
        for kind, signals in (("input", d.inputs), ("output", d.outputs)):
            found |= {
                (kind, n): (unit if unit is not None else recorded.get(n), None, None) for n, unit in signals.items()
            }
        found |= {
            ("parameter", n): (p.unit if p.unit is not None else parameters.get(n), p.value, p.bounds)
            for n, p in d.parameters.items()
        }
        found |= {("constant", n): (c.unit, c.value, None) for n, c in d.constants.items()}
        return {
            key: Known(unit, form_of(unit_of(unit, f"{key[0]} {key[1]!r}")), value, bounds)
            for key, (unit, value, bounds) in found.items()
            if unit is not None
        }
