"""The equations of a network: the law of every part, and the balance of what flows at every node.

Unknown are the quantity across at every node and the one through every part; known are states, inputs and parameters
that are sources. Every equation is linear in unknowns and knowns, with polynomials of the parameters as coefficients,
but for the curves of valves and dry friction, which give the quantity through them by that across them. (Sparse tableau
of C. W. Ho, A. E. Ruehli, P. A. Brennan, The modified nodal approach to network analysis, IEEE Trans. Circuits Syst.
22, 1975, 504-509, with stores of both kinds as sources.)
"""

from dataclasses import dataclass, field
from typing import Any

from plantfit.models.networks.netlist import Netlist, Placed
from plantfit.models.networks.parts import GROUND
from plantfit.models.networks.polynomials import ONE, Polynomial

Terms = dict[str, Polynomial]


@dataclass(frozen=True)
class Equation:
    """The sum of `terms` is zero. `parts` it is of; `gives` the flow that a law gives, `curve` the text that gives
    it of `across`."""

    terms: Terms
    parts: tuple[str, ...]
    gives: str = ""
    curve: str = ""
    across: str = ""


@dataclass(frozen=True)
class State:
    """`rate` is its derivative times `divisor` (1 without)."""

    name: str
    unit: str
    sentence: str
    rate: Terms
    divisor: str = ""
    start: tuple[float, float] | None = None


@dataclass
class Tableau:
    """All equations; `unknowns`, `inputs`, `parameters` and `constants` by name, with what they are."""

    equations: list[Equation] = field(default_factory=list)
    unknowns: dict[str, str] = field(default_factory=dict)
    states: dict[str, State] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)


def across_at(netlist: Netlist, node: str) -> str:
    return f"{netlist.domains[node].across.letter}_{node}"


def across_of(placed: Placed) -> str:
    return f"{placed.part.domain.across.letter}_{placed.name}"


def through(placed: Placed, second: bool = False) -> str:
    domain = placed.part.second if second and placed.part.second is not None else placed.part.domain
    return f"{domain.through.letter}_{placed.name}" + (
        "_out" if second and placed.part.second is placed.part.domain else ""
    )


def tableau(netlist: Netlist) -> Tableau:
    """The equations of a network."""
    made = Tableau()
    balances: dict[str, Terms] = {node: {} for node in netlist.domains}
    for node, domain in netlist.domains.items():
        made.unknowns[across_at(netlist, node)] = f"{domain.across.word} at {node}"
    for placed in netlist.parts.values():
        _add(netlist, made, balances, placed)
    for node, terms in balances.items():
        made.equations.append(Equation(terms, tuple(p.name for p in netlist.parts.values() if node in p.nodes)))
    for m in netlist.measured:
        placed = netlist.parts.get(m.of)
        if m.kind == "integral" and placed is None:
            name = f"{netlist.domains[m.of].integral.letter}_{m.of}"  # pyrefly: ignore[missing-attribute]
            made.states.setdefault(
                name, State(name, m.unit, f"{_word(netlist, m.of)} of {m.of}", {across_at(netlist, m.of): ONE})
            )
        elif m.kind != "through" and placed is not None:
            _name_across(netlist, made, placed)
            if m.kind == "integral":
                domain = placed.part.domain
                name = f"{domain.integral.letter}_{placed.name}"  # pyrefly: ignore[missing-attribute]
                sentence = f"{domain.integral.word} between the ends of {placed.name}"  # pyrefly: ignore[missing-attribute]
                made.states.setdefault(name, State(name, m.unit, sentence, {across_of(placed): ONE}))
    return made


def _word(netlist: Netlist, node: str) -> str:
    integral = netlist.domains[node].integral
    return integral.word if integral is not None else ""


def _difference(netlist: Netlist, placed: Placed) -> Terms:
    """The quantity across the first port."""
    ends = _ends(placed)
    terms: Terms = {}
    for sign, node in ((1, ends[0]), (-1, ends[1])):
        if node != GROUND:
            terms[across_at(netlist, node)] = Polynomial.number(sign)
    return terms


def _ends(placed: Placed) -> tuple[str, str]:
    """Nodes of the first port."""
    part = placed.part
    single = part.grounded or (part.second is not None and len(part.nodes) == 2)
    return (placed.nodes[0], GROUND) if single else (placed.nodes[0], placed.nodes[1])


def _name_across(netlist: Netlist, made: Tableau, placed: Placed) -> str:
    """The quantity across a part under a name of its own."""
    name = across_of(placed)
    if name not in made.unknowns and name not in made.states and name not in made.inputs:
        made.unknowns[name] = f"{placed.part.domain.across.word} across {placed.name}"
        made.equations.append(Equation({name: -ONE, **_difference(netlist, placed)}, (placed.name,)))
    return name


def _add(netlist: Netlist, made: Tableau, balances: dict[str, Terms], placed: Placed) -> None:
    """The law of a part, and what it takes from its nodes."""
    part, name = placed.part, placed.name
    flow, difference, symbol = through(placed), _difference(netlist, placed), Polynomial.symbol(name)
    made.constants |= part.constants
    if part.unit and part.given != "input":
        made.parameters[name] = _parameter(placed)
    made.unknowns[flow] = f"{part.domain.through.word} through {name}"
    # a source gives at its first node, or from node 0; a part between two nodes takes at the first and gives at the
    # second
    gives = part.law == "sets across" or (part.law == "sets through" and part.grounded)
    for sign, node in zip((1, -1), _ends(placed), strict=True):
        if node != GROUND:
            balances[node][flow] = balances[node].get(flow, Polynomial()) + Polynomial.number(-sign if gives else sign)
    law = part.law
    if law == "resists":
        made.equations.append(Equation({flow: -symbol, **difference}, (name,), gives=flow))
    elif law == "conducts":
        made.equations.append(
            Equation({flow: -ONE, **{v: c * symbol for v, c in difference.items()}}, (name,), gives=flow)
        )
    elif law == "stores across":
        state = across_of(placed)
        made.states[state] = State(
            state, part.domain.across.unit, f"{part.domain.across.word} of {name}", {flow: ONE}, name, part.domain.start
        )
        made.equations.append(Equation({state: -ONE, **difference}, (name,)))
    elif law == "stores through":
        del made.unknowns[flow]
        made.states[flow] = State(
            flow, part.domain.through.unit, f"{part.domain.through.word} through {name}", difference, name
        )
    elif law == "is elastic":
        integral = part.domain.integral
        assert integral is not None
        state = f"{integral.letter}_{name}"
        made.states[state] = State(state, integral.unit, f"how far {name} is shortened", difference)
        made.equations.append(Equation({flow: -ONE, state: symbol}, (name,), gives=flow))
    elif law == "curve":
        across = _name_across(netlist, made, placed)
        made.equations.append(
            Equation({flow: -ONE}, (name,), gives=flow, curve=part.curve.format(p=name, x="{x}"), across=across)
        )
    elif law == "transforms":
        _transform(netlist, made, balances, placed, symbol)
    else:
        _source(made, placed, flow, difference, symbol)


def _transform(netlist: Netlist, made: Tableau, balances: dict[str, Terms], placed: Placed, symbol: Polynomial) -> None:
    """lead * across 1 = follow * across 2, and the power that one port takes the other gives."""
    lead, follow = (symbol, ONE) if placed.part.lead else (ONE, symbol)
    second, out = placed.nodes[-1], through(placed, second=True)
    assert placed.part.second is not None
    made.unknowns[out] = f"{placed.part.second.through.word} that {placed.name} gives {second}"
    terms = {v: c * lead for v, c in _difference(netlist, placed).items()}
    terms[across_at(netlist, second)] = terms.get(across_at(netlist, second), Polynomial()) - follow
    made.equations.append(Equation(terms, (placed.name,)))
    made.equations.append(Equation({through(placed): follow, out: -lead}, (placed.name,)))
    balances[second][out] = balances[second].get(out, Polynomial()) - ONE


def _source(made: Tableau, placed: Placed, flow: str, difference: Terms, symbol: Polynomial) -> None:
    part, name = placed.part, placed.name
    if part.given == "input":
        made.inputs[name] = part.unit
    elif part.given == "gain":
        made.inputs[placed.by] = placed.by_unit
    source = {placed.by: symbol} if part.given == "gain" else {name: ONE}
    if part.law == "sets across":
        made.equations.append(Equation({**{v: -c for v, c in source.items()}, **difference}, (name,)))
    else:
        made.equations.append(Equation({flow: -ONE, **source}, (name,), gives=flow))


def _parameter(placed: Placed) -> dict[str, Any]:
    part = placed.part
    entry: dict[str, Any] = {
        "unit": placed.unit,
        "sentence": f"{part.what}{',' if ' of ' in part.what else ' of'} {placed.name}",
    }
    if placed.value is not None:
        return {**entry, "value": placed.value}
    return {**entry, "bounds": placed.bounds or part.bounds, "scale": part.scale}
