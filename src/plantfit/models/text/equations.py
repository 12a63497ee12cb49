"""Equations written as text to a model."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import EquationError, ModelError, UnitError
from plantfit.models.model import Model, Named
from plantfit.models.parts.tables import Table
from plantfit.models.remade import remade
from plantfit.models.text.declarations import RESERVED, Declarations, declare
from plantfit.models.text.delays import DelayTable
from plantfit.models.text.dimensions.cycles import refuse_cycles
from plantfit.models.text.dimensions.said_later import checked_later
from plantfit.models.text.dimensions.two_zeros import refuse_multiple, refuse_two_zeros
from plantfit.models.text.dimensions.unit_check import UnitChecker, unit_of
from plantfit.models.text.dimensions.whole_model import WholeModel
from plantfit.models.text.evaluate import Evaluate, evaluator
from plantfit.models.text.expression import Node
from plantfit.models.text.friction_text import FrictionTable
from plantfit.models.text.functions import FUNCTIONS, SPECIAL
from plantfit.models.text.hybrid_text import Hybrid
from plantfit.models.text.parse import Statement, parse, parse_expression
from plantfit.models.text.suggest import suggest
from plantfit.units import is_point, known, quantity

# isort: split
import jax.numpy as jnp

TIME = "t"


@remade
def equations(
    text: str,
    *,
    inputs: Mapping[str, Any] | Sequence[str] | None = None,
    states: Mapping[str, Any] | Sequence[str] | None = None,
    outputs: Mapping[str, Any] | Sequence[str],
    parameters: Mapping[str, Any] | Sequence[Any] | None = None,
    constants: Mapping[str, float | str] | None = None,
    tables: Mapping[str, Any] | None = None,
    name: str = "user",
    check: bool = True,
    sentence: str = "",
    source: str = "",
) -> Model:
    """Build a model from equations such as `x1' = -k*x1 + delay(u, Td)` and `y = x1`.

    One equation a line; `;` also separates, `#` begins a comment, a line goes on inside
    parentheses. `name' = ...` is the derivative of a state in state units per second; a declared
    output on the left is an output; any other name is an intermediate value, in any order.
    `t` is the time in seconds; `^` and `**` are powers; `a if condition else b` is piecewise.
    An output with the name of a state needs no equation: it is that state.

    `delay(x, tau)` is an input or a state of tau seconds ago. `when falling(h): v = -c*v, w = 0` sets states
    as h passes zero from above (`rising` from below, `crossing` both ways); the right sides see the values
    before. `friction(v, sliding, breakaway)` in the derivative of the state v is dry friction that sticks, to
    be subtracted as in v' = (F - friction(v, Fc, Fs))/m; without a third argument it breaks away at the
    sliding force. `z = play(x, gap)`, z a state, follows x with `gap` to each side.

    inputs, outputs: names to units (None: unknown), or a list of names.
    states: names to {"unit", "initial"}; `initial` is a number in the unit of the state (default
    0) or an expression of parameters, constants, inputs (first value), outputs (first measured
    value) and t (when the simulation begins).
    parameters: names to `Declared`, a unit, or {"unit", "bounds", "scale", "value", "sentence"}.
    constants: names to numbers (unit not checked) or quantities such as "9.81 m/s^2".
    tables: names to `Table` or {"over", "nodes", "unit"}; `over` lists one or two declared signals,
    `nodes` their operating points, as numbers or {"from", "to", "count"}. `k(y)` or `k(y, u)` is then
    linear between the nodes and constant outside. Its values are a parameter with one entry for each
    node, whose bounds or known value stand in `parameters`.
    check: compare units throughout; those that are not declared may be any, but the declared ones must not contradict
    each other.

    Raises EquationError (with line and column) for anything wrong in the text, ModelError for
    declarations that contradict it, UnitError for units that do not exist.
    """
    if not isinstance(text, str):
        raise ModelError(f"Model {name!r}: the equations are {type(text).__name__}; write them as one text.")
    builder = _Builder(text, declare(name, inputs, states, outputs, parameters, constants, tables), check)
    model = builder.model(sentence, source)
    return checked_later(model, builder.check_beside) if check else model


class _Builder:
    def __init__(self, text: str, declared: Declarations, check: bool):
        self.text = text
        self.declared = declared
        self.table = DelayTable(declared, text)
        self.frictions = FrictionTable(declared, text)
        self.hybrid = Hybrid(declared, text, self.frictions)
        self.derivatives: dict[str, Statement] = {}
        self.values: dict[str, Statement] = {}  # outputs, intermediates and friction forces
        statements, events = parse(text, declared.tables)
        for statement in statements:
            self._place(self._rewritten(statement))
        for event in events:
            resets = tuple(map(self._rewritten, event.resets))
            self.hybrid.add_event(replace(event, condition=self._resolved(event.condition), resets=resets))
        self.values |= self.frictions.values()
        self.initial = {state: self._read_initial(state) for state in declared.states}
        self._check_complete()
        self._check_names()
        self.order = self._ordered()
        self.hybrid.check(self.values, self.derivatives)
        self._check_used()
        self._check_units(check)

    def _rewritten(self, statement: Statement) -> Statement:
        return replace(statement, right=self._resolved(statement.right))

    def _resolved(self, node: Node) -> Node:
        return self.frictions.rewrite(self.table.rewrite(node))

    def model(self, sentence: str, source: str) -> Model:
        d = self.declared
        states = tuple(d.states)
        events, frictions, backlashes = self.hybrid.declarations(self._function, self.values, self.derivatives)
        return Model(
            name=d.model,
            states=d.states,
            inputs=d.inputs,
            outputs=d.outputs,
            parameters=(*d.parameters.values(), *self.table.hidden.values()),
            output=self._function({o: self._output_node(o) for o in d.outputs}),
            derivative=self._function({s: self.derivatives[s].right for s in states}) if states else None,
            initial_state=self._initial_function() if states else None,
            delays=tuple(self.table.delays.values()),
            state_delays=tuple(self.table.state_delays.values()),
            events=events,
            frictions=frictions,
            backlashes=backlashes,
            tables=tuple(d.tables.values()),
            sentence=sentence,
            source=source,
            text=self.text,
        )

    def _fail(self, message: str, place: tuple[int, int]) -> EquationError:
        return EquationError(message, self.text, *place)

    def _place(self, statement: Statement) -> None:
        """Sort a statement under derivatives or values."""
        d, target = self.declared, statement.target
        if statement.derivative:
            if target not in d.states:
                raise self._fail(
                    f"{target!r} is not a state; states are {list(d.states)}.{suggest(target, d.states)}",
                    statement.place,
                )
        elif target in d.states:
            if statement.right.op != "play":
                raise self._fail(f"{target!r} is a state; write {target}' = ... for its derivative.", statement.place)
            self.hybrid.plays[target] = statement
            rest = Node("number", statement.place, statement.place)  # the play gives the value, not a rate
            statement = replace(statement, derivative=True, right=rest)
        elif target in d.inputs or target in d.parameters or target in d.constants:
            kind = "an input" if target in d.inputs else "a parameter" if target in d.parameters else "a constant"
            raise self._fail(
                f"{target!r} is {kind} and cannot be given by an equation; choose another name.", statement.place
            )
        elif target in RESERVED:
            raise self._fail(f"{target!r} has a meaning of its own in equations; choose another name.", statement.place)
        table = self.derivatives if statement.derivative else self.values
        if target in table:
            raise self._fail(
                f"{target!r} has an equation already in line {table[target].place[0] + 1}; keep one.", statement.place
            )
        table[target] = statement

    def _read_initial(self, state: str) -> Node | float:
        given = self.declared.initial[state]
        if not isinstance(given, str):
            return given
        d = self.declared
        known = {*d.parameters, *d.constants, *d.inputs, *d.outputs, TIME}
        try:
            node = parse_expression(given, d.tables)
        except EquationError as error:
            reason = _named_first(state, given) if _is_quantity(given) else error.reason
            raise EquationError(f"Initial value of {state!r}: {reason}", given, error.line, error.column) from None
        for part in node.walk():
            if part.op in SPECIAL:
                raise EquationError(
                    f"Initial value of {state!r}: {part.op}() has no meaning at the start.", given, *part.place
                )
            if part.op == "name" and part.name in d.tables:
                raise EquationError(f"Initial value of {state!r}: {_bare(d.tables[part.name])}", given, *part.place)
            if part.op == "name" and part.name not in known:
                message = f"Initial value of {state!r}: {_unknown(part.name, known)}"
                raise EquationError(message, given, *part.place)
        return node

    def _check_complete(self) -> None:
        d = self.declared
        where = f"Model {d.model!r}"
        if not d.outputs:
            raise ModelError(f"{where} has no outputs; declare what is measured in outputs, as in y = 'V'.")
        for state in d.states:
            if state not in self.derivatives:
                raise ModelError(f"{where}: state {state!r} has no derivative; add the equation {state}' = ...")
        for output in d.outputs:
            if output not in self.values and output not in d.states:
                raise ModelError(f"{where}: output {output!r} has no equation; add the equation {output} = ...")

    def _check_names(self) -> None:
        d = self.declared
        hidden = {*self.table.channels, *self.frictions.terms}
        known = {*d.names(), *self.values, *hidden, TIME}
        for expression in self._expressions():
            for node in expression.walk():
                if node.op == "name" and node.name in d.tables:
                    raise self._fail(_bare(d.tables[node.name]), node.place)
                if node.op != "name" or node.name in known:
                    continue
                if node.name in FUNCTIONS:
                    raise self._fail(f"{node.name!r} is a function; write {FUNCTIONS[node.name].usage}.", node.place)
                raise self._fail(_unknown(node.name, known - hidden), node.place)

    def _expressions(self) -> list[Node]:
        """Every expression but the initial values."""
        return [*(s.right for s in (*self.derivatives.values(), *self.values.values())), *self.hybrid.expressions()]

    def _ordered(self) -> list[str]:
        """Values in an order in which each needs only those before it."""
        order: list[str] = []
        needs = {name: sorted(s.right.names() & set(self.values)) for name, s in self.values.items()}
        for root in self.values:
            path, waiting = [root], [iter(needs[root])]
            while path:
                following = next((n for n in waiting[-1] if n not in order), None)
                if following in path:
                    circle = " -> ".join([*path[path.index(following) :], following])
                    raise self._fail(
                        f"These values need one another in a circle: {circle}; break it or make one a state.",
                        self.values[following].place,
                    )
                if following is not None:
                    path.append(following)
                    waiting.append(iter(needs[following]))
                    continue
                waiting.pop()
                done = path.pop()
                if done not in order:
                    order.append(done)
        return order

    def _check_used(self) -> None:
        d = self.declared
        used = {time.name for time in self.table.times} | {delay.input for delay in self.table.delays.values()}
        used |= set().union(*(expression.names() for expression in self._expressions()))
        for node in self.initial.values():
            used |= node.names() if isinstance(node, Node) else set()
        for kind, names in (("input", d.inputs), ("parameter", d.parameters)):
            for name in names:
                if name not in used:
                    raise ModelError(
                        f"Model {d.model!r}: {kind} {name!r} is never used in the equations; use it or delete it."
                    )

    def _check_units(self, check: bool) -> None:
        """Check every expression; declared units must exist even when `check` is off."""
        named, states, outputs = self._units({})
        if not check:
            return
        whole = self.whole_model()
        try:
            self._check_known_units(named, states, outputs)
        except EquationError as error:
            found = whole.contradiction()
            line = None if found is None else found[0].line(found[1])
            if line is None:
                raise
            raise EquationError(f"{error.reason.rstrip('.')}. {line}", error.text, error.line, error.column) from None
        whole.check()
        self._check_zeros(named, states, outputs)
        self._refuse_two_zeros(named, states, outputs)
        self._refuse_cycles(named, states, outputs)

    def _refuse_cycles(self, named: Mapping[str, Any], states: Mapping[str, Any], outputs: Mapping[str, Any]) -> None:
        refuse_cycles(
            {**named, **outputs, **states, TIME: unit_of("s", "time")},
            {n: c.value for n, c in self.declared.constants.items()},
            {n: self.values[n].right for n in self.order},
            {n: s.right for n, s in self.derivatives.items()},
            self.hybrid.expressions(),
            self.text,
        )

    def _units(self, given: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Units of inputs, parameters and constants, of states and of outputs, those that are not declared as
        `given`, else None."""
        d = self.declared

        def those(kind: str, declared: Mapping[str, str | None]) -> dict[str, Any]:
            return {n: unit_of(given.get(n) if u is None else u, f"{kind} {n!r}") for n, u in declared.items()}

        named = those("input", {**d.inputs, **self.table.channel_units()})
        named |= those("parameter", {n: p.unit for n, p in d.parameters.items()})
        named |= those("constant", {n: c.unit for n, c in d.constants.items()})
        return named, those("state", d.states), those("output", d.outputs)

    def check_beside(self, parameters: Mapping[str, str], recorded: Mapping[str, str]) -> None:
        """Raise EquationError where units that a problem gives to parameters, or recordings to signals, contradict
        the declared ones."""
        self.whole_model().check_beside(parameters, recorded)
        later = self._units({**parameters, **{n: unit for n, unit in recorded.items() if known(unit)}})
        self._refuse_two_zeros(*later)
        self._refuse_cycles(*later)

    def whole_model(self) -> WholeModel:
        """What all statements say about units, also about those that nobody declared."""
        channels = {d.channel: d.input for d in self.table.delays.values()}
        channels |= {d.channel: d.state for d in self.table.state_delays.values()}
        whole = WholeModel(self.declared, self.text, self.values, channels)
        whole.delays(self.table.times)
        whole.values(self.values)
        whole.derivatives(self.derivatives)
        whole.plays_and_events(self.hybrid.plays, self.hybrid.events)
        whole.initial(self.initial)
        return whole

    def _check_known_units(
        self, named: Mapping[str, Any], states: Mapping[str, Any], outputs: Mapping[str, Any]
    ) -> None:
        """Follow declared units through every expression, as far as all that it reads is declared."""
        d = self.declared
        numbers = {n: c.value for n, c in d.constants.items()}
        second = unit_of("s", "time")
        signals = {**named, **states, TIME: second}
        axes = {n: tuple({**signals, **outputs}[s] for s in table.over) for n, table in d.tables.items()}
        checker = UnitChecker(signals, numbers, self.text, axes)
        for time in self.table.times:
            checker.expect(time, second, "A delay")
        for value in self.order:
            right = self.values[value].right
            if value in outputs:
                checker.expect(right, outputs[value], f"Output {value!r}")
            checker.named[value] = outputs[value] if outputs.get(value) is not None else checker.unit(right)
        for state, statement in self.derivatives.items():
            unit = states[state]
            checker.expect(statement.right, None if unit is None else unit / second, f"The derivative of {state!r}")
        self.hybrid.check_units(checker, states)
        for output in (o for o in outputs if o in states):
            UnitChecker({output: states[output]}, {}, output).expect(
                self._output_node(output), outputs[output], f"Output {output!r}"
            )
        for state, node in self.initial.items():
            if isinstance(node, Node) and node.op != "number":
                start = UnitChecker({**named, **outputs, TIME: second}, numbers, str(d.initial[state]), axes)
                start.expect(node, states[state], f"The initial value of {state!r}")

    def _shown_units(
        self, named: Mapping[str, Any], states: Mapping[str, Any], outputs: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Units of states, of those without unit the one that outputs or initial values show."""
        found = dict(states)
        for output, unit in outputs.items():
            shown = self._output_node(output).name
            if shown in states and states[shown] is None:
                found[shown] = unit
        for state, node in self.initial.items():
            if isinstance(node, Node) and found[state] is None:
                found[state] = {**named, **outputs}.get(node.name)
        return found

    def _refuse_two_zeros(
        self, named: Mapping[str, Any], states: Mapping[str, Any], outputs: Mapping[str, Any]
    ) -> None:
        values = {n: self.values[n].right for n in self.order}
        rates = [s.right for s in self.derivatives.values()]
        units = {**named, **outputs, **self._shown_units(named, states, outputs)}
        ends = [*rates, *(event.condition for event in self.hybrid.events)]
        refuse_two_zeros(units, values, [*rates, *self.hybrid.expressions()], ends, self.text)
        for reset in (reset for event in self.hybrid.events for reset in event.resets):
            refuse_multiple(f"The new value of {reset.target!r}", reset.right, units, states[reset.target], self.text)
        for state, node in self.initial.items():
            if isinstance(node, Node):
                refuse_multiple(
                    f"The initial value of {state!r}",
                    node,
                    {**named, **outputs},
                    states[state],
                    str(self.declared.initial[state]),
                )

    def _check_zeros(self, named: Mapping[str, Any], states: Mapping[str, Any], outputs: Mapping[str, Any]) -> None:
        """Quotients and powers of temperatures of states without unit, which outputs or initial values show to be in
        degC."""
        d, found = self.declared, self._shown_units(named, states, outputs)
        degrees = {n: u for n, u in {**named, **found, **outputs}.items() if u is not None and is_point(u)}
        if not any(states[n] is None for n in degrees if n in states):
            return
        axes = {n: (None,) * len(table.over) for n, table in d.tables.items()}
        checker = UnitChecker(
            degrees, {n: c.value for n, c in d.constants.items()}, self.text, axes, numbers_known=False
        )
        for expression in self._expressions():
            checker.unit(expression)

    def _output_node(self, output: str) -> Node:
        if output in self.values:
            return self.values[output].right
        return Node("name", (0, 0), (0, 0), name=output)

    def _needed(self, targets: Mapping[str, Node]) -> list[tuple[str, Evaluate]]:
        """The values that targets need, in order; friction forces are given from outside."""
        wanted = set().union(*(node.names() for node in targets.values()))
        order = [value for value in self.order if value not in self.frictions.terms]
        for value in reversed(order):
            if value in wanted:
                wanted |= self.values[value].right.names()
        return [(value, evaluator(self.values[value].right)) for value in order if value in wanted]

    def _function(self, targets: Mapping[str, Node]) -> Callable[..., Named]:
        """A function (x, u, p) that gives every target; friction forces are 0 but for those in its fourth argument."""
        d = self.declared
        needed = self._needed(targets)
        results = {name: evaluator(node) for name, node in targets.items()}
        read = set().union(*(n.names() for n in targets.values()), *(self.values[v].right.names() for v, _ in needed))
        from_state = tuple(sorted(read & set(d.states)))
        from_input = tuple(sorted(read & {*d.inputs, *self.table.channels, TIME}))
        free = dict.fromkeys(read & set(self.frictions.terms), 0.0)
        from_parameters = tuple(sorted(read & set(d.parameters)))
        constants = {n: d.constants[n].value for n in sorted(read & set(d.constants))}

        def function(x: Named, u: Named, p: Named, forces: Named | None = None) -> Named:
            values = (
                free
                | dict(forces or {})
                | _arrays(constants, constants)
                | _arrays(p, from_parameters)
                | _arrays(u, from_input)
                | _arrays(x, from_state)
            )
            for name, evaluate in needed:
                values[name] = evaluate(values)
            return _one_shape(
                {name: evaluate(values) for name, evaluate in results.items()}, x, u, _without(p, d.tables)
            )

        return function

    def _initial_function(self) -> Callable[[Named, Named, Named], Named]:
        d = self.declared
        given = {
            s: evaluator(n) if isinstance(n, Node) else (lambda _, number=n: number) for s, n in self.initial.items()
        }
        constants = {n: c.value for n, c in d.constants.items()}
        read = set().union(*(n.names() for n in self.initial.values() if isinstance(n, Node)))

        def initial_state(p: Named, u0: Named, y0: Named) -> Named:
            values = _arrays(constants, constants)
            for source, names in ((p, d.parameters), (u0, (*d.inputs, TIME)), (y0, d.outputs)):
                values |= _arrays(source, [n for n in names if n in read])
            return _one_shape({s: evaluate(values) for s, evaluate in given.items()}, _without(p, d.tables), u0, y0)

        return initial_state


def _arrays(source: Named, names: Iterable[str]) -> dict[str, Any]:
    """Named values as float64 arrays, for which 1/0 is infinite and not an error."""
    return {n: jnp.asarray(source[n], dtype=float) for n in names}


def _without(p: Named, tables: Iterable[str]) -> Named:
    return {n: v for n, v in p.items() if n not in tables}


def _one_shape(results: Named, *given: Named) -> Named:
    """Results as float64 of the shape that all given values share, so that constants broadcast too."""
    shape = jnp.broadcast_shapes(*(jnp.shape(v) for values in given for v in values.values()))
    return {name: jnp.broadcast_to(jnp.asarray(value, dtype=float), shape) for name, value in results.items()}


def _is_quantity(text: str) -> bool:
    """Whether a text is a number with a unit, as "20 degC"."""
    try:
        return bool(quantity(text)[1])
    except UnitError:
        return False


def _named_first(state: str, given: str) -> str:
    line = f'constants = {{ {state}_0 = "{given}" }}'
    return (
        f"{given!r} is a number with a unit, which equations do not hold; name it, as in {line}, and write initial "
        f'= "{state}_0".'
    )


def _bare(table: Table) -> str:
    return f"{table.name!r} is a table; write {table.name}({', '.join(table.over)})."


def _unknown(name: str, known: set[str]) -> str:
    hint = suggest(name, {*known, *FUNCTIONS})
    return f"{name!r} is not known.{hint} Known here are {', '.join(sorted(known))}."
