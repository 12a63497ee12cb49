"""A network of parts as explicit equations with units, bounds and sentences."""

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from plantfit.errors import EquationError
from plantfit.models.networks import topology
from plantfit.models.networks.laws import Equation, State, Tableau, Terms, across_at, across_of, tableau, through
from plantfit.models.networks.loops import Singular, solved
from plantfit.models.networks.netlist import Measured, Netlist, read
from plantfit.models.networks.ordering import Unmatched, blocks
from plantfit.models.networks.polynomials import ONE, Polynomial, gcd_of, joined

if TYPE_CHECKING:
    from plantfit.models.model import Model


@dataclass(frozen=True)
class Network:
    """Equations as text and what they declare, in the form that `plantfit.equations` and study files take.

    `sentences` say what the left sides are, by name; `idle` are parameters that change nothing which is measured, and
    are left out.
    """

    equations: str
    inputs: dict[str, str]
    states: dict[str, dict[str, Any]]
    outputs: dict[str, str]
    parameters: dict[str, dict[str, Any]]
    constants: dict[str, str]
    sentences: dict[str, str] = field(default_factory=dict)
    idle: tuple[str, ...] = ()

    def model(self, name: str = "network") -> "Model":
        """The model of these equations."""
        from plantfit.models.text.equations import equations

        return equations(
            self.equations, inputs=self.inputs, states=self.states, outputs=self.outputs, parameters=self.parameters,
            constants=self.constants, name=name,
        )  # fmt: skip


def network(text: str, source: str = "the network") -> Network:
    """Equations of a list of parts (`docs/networks.md`), one part a line:

        R1 resistor a b
        C1 capacitor b 0
        u source a 0
        measure v(b)

    `source` is what messages call it. States are what capacitors, masses, inertias, heat capacities and tanks hold,
    what flows through inductors and pipe_inertias, how far springs are shortened, and positions and angles that are
    measured. What resistive parts settle among themselves at every instant is solved exactly.

    Raises EquationError with line and word: an unknown part, a wrong number of nodes, a unit that does not fit, a node
    that hangs or floats, a shorted source, stores that are not free.
    """
    netlist = read(text, source)
    topology.check(netlist)
    made = tableau(netlist)
    try:
        order = blocks(made.equations, list(made.unknowns))
    except Unmatched as error:
        raise topology.rigid(netlist, error.parts) from None
    return _Explicit(netlist, made, order).network()


class _Explicit:
    """Values in the order in which they are computed; what is only another name, or zero, is replaced."""

    def __init__(self, netlist: Netlist, made: Tableau, order: list[tuple[list[Equation], list[str]]]):
        self.netlist, self.made = netlist, made
        self.same: dict[str, Terms] = {}  # unknowns that are another name with a sign, or zero
        self.values: dict[str, tuple[str, set[str]]] = {}  # their text and what it names
        for equations, unknowns in order:
            self._solve(equations, unknowns)

    def _solve(self, equations: list[Equation], unknowns: list[str]) -> None:
        curves = [e for e in equations if e.curve]
        if curves and len(unknowns) > 1:
            names = [p for e in curves for p in e.parts]
            domain = self.netlist.parts[names[0]].part.domain
            raise self.netlist.wrong(
                f"what passes through {' and '.join(names)} and the {domain.across.word} there need one another; put "
                f"{domain.holds.removeprefix('a ').removeprefix('an ').split(' or ')[0]} at its node",
                self.netlist.parts[names[0]].line,
                names[0])  # fmt: skip
        if curves:
            across = self._replaced({curves[0].across: ONE})
            text = _text(across, ONE)
            inner = text if text.isidentifier() else f"({text})"
            self.values[unknowns[0]] = (curves[0].curve.format(x=inner), {*across, *curves[0].parts})
            return
        replaced = [Equation(self._replaced(e.terms), e.parts, e.gives) for e in equations]
        try:
            found = solved(replaced, unknowns)
        except Singular:
            parts = tuple(dict.fromkeys(p for e in equations for p in e.parts if len(e.parts) == 1))
            raise topology.rigid(self.netlist, parts) from None
        for unknown, terms, over in found:
            terms = self._replaced(terms)
            if not terms or (len(terms) == 1 and over.is_one and _sign(terms) is not None):
                self.same[unknown] = terms
            else:
                self.values[unknown] = (
                    _text(terms, over),
                    {*terms, *over.symbols(), *(s for c in terms.values() for s in c.symbols())},
                )

    def _replaced(self, terms: Terms) -> Terms:
        found: Terms = {}
        for v, c in terms.items():
            for name, factor in self.same.get(v, {v: ONE}).items():
                found[name] = found.get(name, Polynomial()) + c * factor
        return {v: c for v, c in found.items() if c}

    def network(self) -> Network:
        made, netlist = self.made, self.netlist
        rates = {s.name: self._rate(s) for s in made.states.values()}
        outputs = {m.name: (m, self._replaced({self._variable(m): ONE})) for m in netlist.measured}
        self._check_names(outputs)
        given = {v for _, v in netlist.starts if isinstance(v, str)}
        used = self._needed(
            [given, *({*terms} for _, terms in outputs.values())], {n: names for n, (_, names) in rates.items()}
        )
        idle = next((i for i in made.inputs if i not in used), None)
        if idle is not None:
            raise EquationError(
                f"{netlist.source}: the input {idle} moves nothing that is measured; measure something that it drives."
            )
        states, starts = self._states({m.name: terms for m, terms in outputs.values()}, used)
        lines = {name: f"{name} = {self.values[name][0]}" for name in self.values if name in used}
        lines |= {f"{name}'": f"{name}' = {text}" for name, (text, _) in rates.items() if name in used}
        lines |= {
            m.name: f"{m.name} = {_text(t, ONE)}"
            for m, t in outputs.values()
            if m.name not in made.states and t != {m.name: ONE}
        }
        text = "\n".join(lines.values())
        words = set(re.findall(r"\w+", text))
        sentences = {**made.unknowns, **{s.name: s.sentence for s in made.states.values()}}
        return Network(
            text, made.inputs, states, {m.name: m.unit for m in netlist.measured},
            {n: p for n, p in made.parameters.items() if n in used} | starts,
            {n: c for n, c in made.constants.items() if n in words},
            {n.rstrip("'"): sentences.get(n.rstrip("'"), "") for n in lines},
            tuple(n for n in made.parameters if n not in used),
        )  # fmt: skip

    def _states(
        self, outputs: dict[str, Terms], used: set[str]
    ) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
        """States with their initial values: what is measured begins there, the rest at zero or at a value that is
        searched for."""
        states, starts = {}, {}
        given = self._given()
        for s in (s for s in self.made.states.values() if s.name in used):
            initial: float | str | None = given.get(
                s.name, next((name for name, terms in outputs.items() if terms == {s.name: ONE}), None)
            )
            if initial is None and s.start is None:
                initial = 0.0
            elif initial is None:
                initial = f"{s.name}_start"
                starts[initial] = {
                    "unit": s.unit,
                    "sentence": f"{s.sentence} at the start",
                    "bounds": s.start,
                    "scale": "linear",
                }
            states[s.name] = {"unit": s.unit, "initial": initial}
        return states, starts

    def _given(self) -> dict[str, float | str]:
        """What the lines `start` say of states."""
        found: dict[str, float | str] = {}
        for quantity, value in self.netlist.starts:
            terms = self._replaced({self._variable(quantity): ONE})
            name = next(iter(terms), "")
            if len(terms) != 1 or name not in self.made.states or not terms[name].is_one:
                states = ", ".join(self.made.states) or "none"
                raise self.netlist.wrong(
                    f"{quantity.name} is no state, so that it has no start of its own; states are {states}",
                    quantity.line,
                    "start",
                )
            found[name] = value
        return found

    def _check_names(self, outputs: "dict[str, tuple[Measured, Terms]]") -> None:
        """Names that equations make must not be those of parts and inputs, nor `as` a name that equations make of
        something else."""
        made, netlist = self.made, self.netlist
        variables = {*made.unknowns, *made.states}
        for p in netlist.parts.values():
            for name in (p.name, p.by):
                if name in variables:
                    raise netlist.wrong(
                        f"{name} is also what the equations call the {self._what(name)}; choose another name",
                        p.line,
                        name,
                    )
        for m, _ in outputs.values():
            if m.name in {*variables, *made.inputs} and m.name != self._variable(m):
                raise netlist.wrong(
                    f"{m.name} is also what the equations call the {self._what(m.name)}; choose another name",
                    m.line,
                    m.name,
                )

    def _what(self, name: str) -> str:
        state = self.made.states.get(name)
        return self.made.unknowns.get(name) or (state.sentence if state is not None else "input")

    def _rate(self, state: State) -> tuple[str, set[str]]:
        terms = self._replaced(state.rate)
        over = Polynomial.symbol(state.divisor) if state.divisor else ONE
        return _text(terms, over), {*terms, *over.symbols(), *(s for c in terms.values() for s in c.symbols())}

    def _needed(self, roots: list[set[str]], rates: dict[str, set[str]]) -> set[str]:
        """Every name that outputs hang on."""
        needed: set[str] = set()
        waiting = [name for names in roots for name in names]
        while waiting:
            name = waiting.pop()
            if name not in needed:
                needed.add(name)
                waiting += [*(self.values[name][1] if name in self.values else ()), *rates.get(name, ())]
        return needed

    def _variable(self, m: Measured) -> str:
        placed = self.netlist.parts.get(m.of)
        if m.kind == "through":
            assert placed is not None
            return through(placed)
        if m.kind == "across":
            return across_at(self.netlist, m.of) if placed is None else across_of(placed)
        domain = self.netlist.domains[m.of] if placed is None else placed.part.domain
        assert domain.integral is not None
        return f"{domain.integral.letter}_{m.of}"


def _sign(terms: Terms) -> int | None:
    """1 or -1 of a single term without factor."""
    (coefficient,) = terms.values()
    return coefficient.terms.get(()) if len(coefficient.terms) == 1 and coefficient.terms.get(()) in (1, -1) else None


def _text(terms: Terms, over: Polynomial) -> str:
    """A sum of named values with their factors, over a polynomial; what all factors share stands before it."""
    if not terms:
        return "0"
    front = gcd_of(terms.values()) if len(terms) > 1 else ONE
    pieces = [_signed(name, coefficient.over(front)) for name, coefficient in terms.items()]
    text = joined(sorted(pieces, key=lambda p: p[0] < 0))
    if not front.is_one:
        text = f"{_factor(front)}*({text})"
    if over.is_one:
        return text
    below = str(over)
    above = text if len(pieces) == 1 or not front.is_one else f"({text})"
    return f"{above}/{below if below.isidentifier() else f'({below})'}"


def _signed(name: str, coefficient: Polynomial) -> tuple[int, str]:
    """The sign of a term, and the term without it."""
    negative = all(c < 0 for c in coefficient.terms.values())
    size = -coefficient if negative else coefficient
    return -1 if negative else 1, name if size.is_one else f"{_factor(size)}*{name}"


def _factor(p: Polynomial) -> str:
    written = str(p)
    return f"({written})" if len(p.terms) > 1 and "(" not in written else written
