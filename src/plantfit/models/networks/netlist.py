"""The list of parts as text: one part a line, then what is measured.

R1 resistor a b                 name, kind, nodes
C1 capacitor b 0  1..100 uF     within these bounds; `4.7 uF` would hold it
u source a 0                    the input u
measure v(b), i(R1) as current
start v(b) = 2 V                a value, or the name of a source; else what is measured, or zero
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from keyword import iskeyword

from plantfit import units
from plantfit.errors import EquationError, UnitError
from plantfit.models.networks.parts import DOMAINS, GROUND, PARTS, Domain, Part
from plantfit.models.text.suggest import suggest

# what equations use themselves (models/text), here by name so that reading parts does not load jax; then constants of
# the parts
_USED = (
    "abs acos asin atan atan2 ceil clip cos cosh coulomb deadzone delay e exp floor friction log "
    "log10 max min pi play pos quantize relu sat sign sin sinh smooth_abs smooth_deadzone smooth_sat "
    "smooth_sign sqrt step stribeck t tan tanh where gravity small_level slow_slip slow_turn "
)
RESERVED = frozenset(_USED.split())
_NUMBER = r"[-+]?(?:\d+(?:\.(?!\.)\d*)?|\.\d+)(?:[eE][-+]?\d+)?"  # "1..10" are two
_SIZE = re.compile(rf"(?P<low>{_NUMBER})(?:\s*\.\.\s*(?P<high>{_NUMBER}))?\s*(?P<unit>.*)")
_BY = re.compile(r"by\s+(?P<name>\w+)\s*(?:\[(?P<unit>[^\]]*)\])?")
_START = re.compile(r"(?P<what>\w+)\s*\(\s*(?P<of>\w+)\s*\)\s*=\s*(?P<value>\S.*)")
_MEASURE = re.compile(r"(?P<what>\w+)\s*\(\s*(?P<of>\w+)\s*\)(?:\s+as\s+(?P<name>\w+))?")


@dataclass(frozen=True)
class Word:
    """A word and its place, counted from 0."""

    text: str
    line: int
    column: int


@dataclass(frozen=True)
class Placed:
    """A part of a network: its kind and nodes; `value` or `bounds` in the unit of its kind, `by` the input of a gain
    with its unit."""

    name: str
    part: Part
    nodes: tuple[str, ...]
    line: int
    value: float | None = None
    bounds: tuple[float, float] | None = None
    by: str = ""
    by_unit: str = "%"

    def domain_at(self, place: int) -> Domain:
        second = self.part.second
        return second if second is not None and place == len(self.nodes) - 1 else self.part.domain

    @property
    def unit(self) -> str:
        """The unit of its parameter."""
        return (
            f"{self.part.unit}/({self.by_unit})"
            if self.part.given == "gain" and "/" in self.by_unit
            else (f"{self.part.unit}/{self.by_unit}" if self.part.given == "gain" else self.part.unit)
        )


@dataclass(frozen=True)
class Measured:
    """An output: `kind` "across", "through" or "integral" of the node or part `of`, whose line it stands in."""

    name: str
    kind: str
    of: str
    unit: str
    line: int


@dataclass(frozen=True)
class Netlist:
    """Parts by name, measured quantities, the domain of every node; `starts` are quantities with their value, or a
    source's name.

    `wrong` makes an error that shows the line.
    """

    source: str
    text: str
    parts: dict[str, Placed]
    measured: tuple[Measured, ...]
    domains: dict[str, Domain]
    starts: tuple[tuple[Measured, float | str], ...] = ()

    def wrong(self, message: str, line: int, word: str = "") -> EquationError:
        column = self.text.split("\n")[line].find(word)
        return _wrong(self.source, self.text, message, Word(word, line, max(column, 0)))


def read(text: str, source: str = "the network") -> Netlist:
    """The parts and measurements of a text. Raises EquationError that names line, word and what to write."""
    parts: dict[str, Placed] = {}
    domains: dict[str, Domain] = {}
    waiting: list[list[Word]] = []
    for words in _lines(text):
        if words[0].text in ("measure", "start"):
            waiting.append(words)
            continue
        placed = _placed(text, source, words, parts)
        for k, node in enumerate(placed.nodes):
            own = placed.domain_at(k)
            if node != GROUND and domains.setdefault(node, own) is not own:
                other = next(p.name for p in parts.values() if node in p.nodes)
                raise _wrong(source, text, f"node {node!r} of {placed.name} is {own.name}, but {other} made it "
                                           f"{domains[node].name}; "
                             "give it another name, or join both by a motor or a wheel", words[2 + k])  # fmt: skip
        parts[placed.name] = placed
    if not parts:
        raise EquationError(f"{source}: the list has no parts; write lines such as: R1 resistor a b.")
    both = next((p for p in parts.values() if p.name in domains), None)
    if both is not None:
        raise _wrong(
            source,
            text,
            f"{both.name!r} is the name of a part and of a node; give one of them another name",
            _at(text, both.line, both.name),
        )
    netlist = Netlist(source, text, parts, (), domains)
    measured = tuple(m for words in waiting if words[0].text == "measure" for m in _measured(netlist, words))
    if not measured:
        example = f"{next(iter(domains.values())).across.letter}({next(iter(domains))})"
        raise EquationError(f"{source}: nothing is measured; add a line as in: measure {example}.")
    names = [m.name for m in measured]
    twice = next((m for m in measured if names.count(m.name) > 1), None)
    if twice is not None:
        raise netlist.wrong(f"{twice.name!r} is measured twice; name one of them with `as`", twice.line, twice.name)
    starts = tuple(s for words in waiting if words[0].text == "start" for s in _starts(netlist, words))
    return Netlist(source, text, parts, measured, domains, starts)


def _lines(text: str) -> Iterator[list[Word]]:
    """Words of every line that has some; `#` begins a comment."""
    for number, line in enumerate(text.split("\n")):
        words = [Word(m.group(), number, m.start()) for m in re.finditer(r"[^\s,]+", line.partition("#")[0])]
        if words:
            yield words


def _wrong(source: str, text: str, message: str, word: Word) -> EquationError:
    return EquationError(f"{source}, line {word.line + 1}: {message}.", text, word.line, word.column)


def _at(text: str, line: int, word: str) -> Word:
    return Word(word, line, max(text.split("\n")[line].find(word), 0))


def _placed(text: str, source: str, words: list[Word], parts: dict[str, Placed]) -> Placed:
    name = words[0]
    _check_name(source, text, name, parts)
    if len(words) < 2:
        raise _wrong(
            source, text, f"{name.text} has no kind; write a part and its nodes, as in: {name.text} resistor a b", name
        )
    part = PARTS.get(words[1].text)
    if part is None:
        hint = suggest(words[1].text, PARTS)
        raise _wrong(
            source, text, f"there is no part {words[1].text!r}.{hint} `plantfit new --parts` lists them", words[1]
        )
    count = len(part.nodes)
    nodes = words[2 : 2 + count]
    usage = f"write: {name.text} {part.kind} {' '.join(f'<{n}>' for n in part.nodes)}"
    sized = next((k for k, w in enumerate(nodes) if re.match(r"[-+.\d]", w.text) and w.text != GROUND), None)
    if len(nodes) < count or sized is not None:
        have = len(nodes) if sized is None else sized
        raise _wrong(
            source,
            text,
            f"a {part.kind} has {_counted(count)}, and {name.text} has {have}; {usage}",
            words[-1 if sized is None else 2 + sized],
        )
    for node in nodes:
        if node.text != GROUND and not node.text.isidentifier():
            raise _wrong(
                source,
                text,
                f"{node.text!r} cannot be the name of a node; use letters, digits and _, not a digit first",
                node,
            )
    _check_ends(source, text, name, part, nodes)
    line = text.split("\n")[name.line].partition("#")[0]
    begin = nodes[-1].column + len(nodes[-1].text)
    tail = line[begin:].strip()
    value = bounds = None
    by, by_unit = (f"u_{name.text}", "%") if part.given == "gain" else ("", "%")
    place = Word(tail, name.line, begin + len(line[begin:]) - len(line[begin:].lstrip()))
    found = _BY.match(tail) if part.given == "gain" else None
    if found is not None:
        by, by_unit, tail = found["name"], (found["unit"] or "%").strip(), tail[found.end() :].strip()
        if not units.known(by_unit):
            raise _wrong(source, text, f"{by_unit!r} is not a unit; write for example: by {by} [%]", place)
        _check_name(source, text, Word(by, place.line, place.column), parts, by=True)
    placed = Placed(name.text, part, tuple(n.text for n in nodes), name.line, None, None, by, by_unit)
    if tail:
        value, bounds = _size(source, text, placed, tail, place, usage)
    return Placed(placed.name, part, placed.nodes, placed.line, value, bounds, by, by_unit)


def _counted(count: int) -> str:
    return "one node" if count == 1 else f"{count} nodes"


def _check_name(source: str, text: str, word: Word, parts: dict[str, Placed], by: bool = False) -> None:
    name = word.text
    if not name.isidentifier() or iskeyword(name) or not name.isascii():
        raise _wrong(
            source, text, f"{name!r} cannot be a name in equations; use letters, digits and _, not a digit first", word
        )
    if name in RESERVED:
        raise _wrong(source, text, f"{name!r} has a meaning of its own in equations; choose another name", word)
    if name in parts:
        what = "the input has its name; choose another after `by`" if by else "give this one another name"
        raise _wrong(source, text, f"there is a part {name} already, in line {parts[name].line + 1}; {what}", word)


def _check_ends(source: str, text: str, name: Word, part: Part, nodes: list[Word]) -> None:
    """Both ends of a port at one node, and a part that leads from node 0 to node 0."""
    ends = [n.text for n in nodes] + [GROUND] * part.grounded
    first = ends[:2] if len(part.nodes) != 2 or part.second is None else [ends[0], GROUND]
    if first[0] == first[1]:
        what = "is shorted: both its ends are" if not part.grounded else "has its only node"
        raise _wrong(source, text, f"{name.text} {what} at node {first[0]}; give it another node", nodes[0])
    if part.second is not None and ends[-1] == GROUND:
        raise _wrong(
            source,
            text,
            f"{name.text} drives node 0, which never moves; name the node of its {part.nodes[-1]}",
            nodes[-1],
        )
    if part.domain.name == "thermal" and GROUND in ends[: len(nodes)]:
        raise _wrong(source, text, f"{name.text} leads to node 0, which would be 0 degC; name the node, and give it a "
                                   f"temperature or "
                     "surroundings, as in: Tamb surroundings room", nodes[ends.index(GROUND)])  # fmt: skip


def _size(
    source: str, text: str, placed: Placed, tail: str, place: Word, usage: str
) -> tuple[float | None, tuple[float, float] | None]:
    """The value or the bounds that stand behind the nodes, in the unit of the part."""
    part, unit = placed.part, placed.unit
    if part.given == "input":
        raise _wrong(
            source, text, f"{placed.name} is an input, and its values come from the recording; delete {tail!r}", place
        )
    found = _SIZE.fullmatch(tail)
    if found is None:
        if part.given == "gain" and tail.startswith("by"):
            raise _wrong(source, text, f"{tail!r} does not name an input; write for example: by u [%]", place)
        more = (
            "there are too many nodes, or this is not a value"
            if tail.split()[0].isidentifier()
            else "this is not a value"
        )
        raise _wrong(source, text, f"{tail!r} behind the nodes of {placed.name}: {more}; {usage}, then nothing, a "
                                   f"value or bounds as in "
                     f"{_example(part, unit)}", place)  # fmt: skip
    given = found["unit"].strip()
    if not given and unit != "1":
        raise _wrong(source, text, f"{tail} has no unit; write for example: {tail} {unit}", place)
    try:
        numbers = [
            float(units.convert(float(n), given or "1", unit)) for n in (found["low"], found["high"]) if n is not None
        ]
    except UnitError as error:
        reason = str(error).rstrip(".")
        if units.known(given) and not units.compatible(given, unit):
            reason = (
                f"a {part.kind} has its {part.what.partition(',')[0].partition(' (')[0]} "
                f"in {unit}, and {given} does not fit"
            )
        raise _wrong(source, text, f"{reason}; write for example: {_example(part, unit)}", place) from None
    if not all(map(math.isfinite, numbers)) or (part.scale == "log" and min(numbers) <= 0):
        raise _wrong(
            source, text, f"{tail} cannot be used: the {part.what} of a {part.kind} must be finite and above 0", place
        )
    if len(numbers) == 1:
        return numbers[0], None
    if numbers[0] >= numbers[1]:
        raise _wrong(source, text, f"the bounds {tail} are reversed; write the lower one first", place)
    return None, (numbers[0], numbers[1])


def _example(part: Part, unit: str) -> str:
    low, high = part.bounds or (0.0, 1.0)
    return f"{math.sqrt(low * high) if low > 0 else (low + high) / 2:.1g}{'' if unit == '1' else f' {unit}'}"


def _pieces(netlist: Netlist, words: list[Word]) -> Iterator[Word]:
    """What stands between commas behind the first word of a line."""
    line = netlist.text.split("\n")[words[0].line].partition("#")[0]
    begin = words[0].column + len(words[0].text)
    for piece in re.finditer(r"[^,]+", line[begin:]):
        blank = len(piece.group()) - len(piece.group().lstrip())
        yield Word(piece.group().strip(), words[0].line, begin + piece.start() + blank)


def _measured(netlist: Netlist, words: list[Word]) -> Iterator[Measured]:
    for place in _pieces(netlist, words):
        found = _MEASURE.fullmatch(place.text)
        if found is None:
            message = f"{place.text!r} says nothing to measure; write for example: measure v(b) as y"
            raise _wrong(netlist.source, netlist.text, message, place)
        yield _quantity(netlist, found["what"], found["of"], found["name"], place)


def _starts(netlist: Netlist, words: list[Word]) -> Iterator[tuple[Measured, float | str]]:
    for place in _pieces(netlist, words):
        found = _START.fullmatch(place.text)
        if found is None:
            message = (
                f"{place.text!r} says no start; write for example: start "
                "v(b) = 2 V, or the name of a source in place of 2 V"
            )
            raise _wrong(netlist.source, netlist.text, message, place)
        quantity = _quantity(netlist, found["what"], found["of"], None, place)
        value = found["value"].strip()
        part = netlist.parts.get(value)
        if (
            part is not None
            and part.part.given in ("input", "parameter")
            and units.compatible(part.unit, quantity.unit)
        ):
            yield quantity, value
            continue
        try:
            yield quantity, units.convert(*units.quantity(value), quantity.unit)
        except UnitError as error:
            sources = [p.name for p in netlist.parts.values() if p.part.given in ("input", "parameter")]
            or_one = f", or one of {', '.join(sources)}" if sources else ""
            message = f"{str(error).rstrip('.')}; a start in {quantity.unit} is needed{or_one}"
            raise _wrong(netlist.source, netlist.text, message, place) from None


def _quantity(netlist: Netlist, what: str, of: str, name: str | None, place: Word) -> Measured:
    def wrong(message: str) -> EquationError:
        return _wrong(netlist.source, netlist.text, message, place)

    part = netlist.parts.get(of)
    domain = netlist.domains.get(of) if part is None else part.part.domain
    if domain is None:
        known = {**netlist.domains, **netlist.parts}
        raise wrong(f"there is no node or part {of!r}.{suggest(of, known)} Known are {', '.join(known)}")
    kinds = {"across": domain.across, "through": domain.through, "integral": domain.integral}
    word = what.replace("_", " ")
    kind = next((k for k, q in kinds.items() if q is not None and word in (q.letter, q.word)), None)
    offered = {k: q for k, q in kinds.items() if q is not None and not (part is None and k == "through")}
    if kind is None or kind not in offered:
        can = ", ".join(f"{q.letter}({of}) {q.word}" for q in offered.values())
        also = f"; a {domain.through.word} is that of a part" if kind == "through" else ""
        elsewhere = next((d for d in DOMAINS for q in (d.across, d.through) if q.letter == what), None)
        other = f", which is {domain.name}" if kind is None and elsewhere is not None else ""
        raise wrong(f"{what}({of}) cannot be measured at {of}{other}{also}; write one of: {can}")
    quantity = kinds[kind]
    assert quantity is not None
    if name is not None:
        _check_name(netlist.source, netlist.text, Word(name, place.line, place.column), netlist.parts)
    return Measured(name or f"{quantity.letter}_{of}", kind, of, quantity.unit, place.line)


def letters() -> str:
    """What can be measured in every domain, as text."""
    rows = []
    for d in DOMAINS:
        held = [f"{q.letter}(node) {q.word} [{q.unit}]" for q in (d.across, d.integral) if q is not None]
        rows.append(f"  {d.name:<12} {', '.join(held)}, {d.through.letter}(PART) {d.through.word} [{d.through.unit}]")
    return "\n".join(rows)
