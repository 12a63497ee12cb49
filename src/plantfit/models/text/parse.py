"""Raw statements to expression trees: a whitelist over Python's own grammar, nothing is ever executed."""

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import EquationError
from plantfit.models.parts.tables import Table
from plantfit.models.text.expression import Node
from plantfit.models.text.functions import CALLS, CONSTANTS, FUNCTIONS, SPECIAL
from plantfit.models.text.scan import Place, RawStatement, Source, refuse_quotes, scan, split
from plantfit.models.text.suggest import suggest
from plantfit.models.text.when_text import CROSSINGS, is_when, split_when

MAX_DEPTH = 150
Tables = Mapping[str, Table]

_BINARY: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_REFUSED_BINARY: dict[type[ast.operator], str] = {
    ast.FloorDiv: "//", ast.Mod: "%", ast.MatMult: "@", ast.LShift: "<<", ast.RShift: ">>", ast.BitOr: "|",
    ast.BitAnd: "&",
}  # fmt: skip
_COMPARE: dict[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
_REFUSED: dict[type[ast.expr], tuple[str, str]] = {
    ast.Attribute: ("A dot after a name", "."),
    ast.Subscript: ("An index in brackets", "["),
    ast.Tuple: ("A comma outside of a function", ","),
    ast.Lambda: ("lambda", ""),
    ast.List: ("A list", ""),
    ast.Dict: ("A pair of braces", ""),
    ast.Set: ("A pair of braces", ""),
    ast.ListComp: ("A comprehension", ""),
    ast.SetComp: ("A comprehension", ""),
    ast.DictComp: ("A comprehension", ""),
    ast.GeneratorExp: ("A comprehension", ""),
    ast.NamedExpr: ("An assignment inside an expression", ""),
    ast.Starred: ("A star before an argument", ""),
}
_FOLD: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.divide,
    "**": np.power,
    "negative": operator.neg,
}


@dataclass(frozen=True)
class Statement:
    """`target = right`, or `target' = right` when `derivative`; `place` is that of the target."""

    target: str
    derivative: bool
    place: Place
    right: Node


@dataclass(frozen=True)
class When:
    """`when kind(condition): resets`; `place` is that of the kind, `words` the condition as it was written."""

    kind: str
    place: Place
    words: str
    condition: Node
    resets: tuple[Statement, ...]


def parse(text: str, tables: Tables) -> tuple[list[Statement], list[When]]:
    """Read equations and events, one a line or separated by ';', that may call `tables`.

    Raises EquationError with line and column.
    """
    statements, events = [], []
    for source in scan(text):
        if is_when(source):
            raw = split_when(source, text)
            condition = _Reader(raw.condition, text, tables).read()
            resets = tuple(_statement(reset, text, tables) for reset in raw.resets)
            events.append(When(raw.kind, raw.place, raw.condition.text, condition, resets))
        else:
            statements.append(_statement(split(source, text), text, tables))
    return statements, events


def _statement(raw: RawStatement, text: str, tables: Tables) -> Statement:
    return Statement(raw.target, raw.derivative, raw.place, _Reader(raw.right, text, tables).read())


def parse_expression(text: str, tables: Tables) -> Node:
    """Read one expression, as in the initial value of a state. Raises EquationError with line and column."""
    sources = scan(text)
    if len(sources) != 1:
        raise EquationError(f"One expression is needed here, but {text!r} has {len(sources)}; write one.", text)
    refuse_quotes(sources[0], text)
    return _Reader(sources[0], text, tables).read()


def _at_a_time(name: str, node: ast.Call) -> str:
    """What to write for a signal at a time, y(t) or y(t - L); "" for another call."""
    match node.args:
        case [ast.Name(id="t")]:
            return f" A signal stands without its time; write {name}."
        case [ast.BinOp(left=ast.Name(id="t"), op=ast.Sub(), right=ago)]:
            return f" For what the signal was some time ago write delay({name}, {ast.unparse(ago)})."
    return ""


class _Reader:
    """One expression: its characters as Python reads them (^ as **), and their places."""

    def __init__(self, source: Source, text: str, tables: Tables):
        self.text = text
        self.tables = tables
        self.source = _with_python_power(source)
        self.line = self.source.text
        # ast counts columns in bytes of UTF-8
        self.character_of_byte = [k for k, c in enumerate(self.line) for _ in c.encode()] + [len(self.line)]

    def read(self) -> Node:
        tree = self._python_tree()
        self._check_depth(tree)
        return self._node(tree)

    def _python_tree(self) -> ast.expr:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.line, mode="eval").body
        except SyntaxError as error:
            raise self._syntax(error) from None
        except (RecursionError, MemoryError, ValueError):
            raise self._too_deep(self.source.place(0)) from None

    def _syntax(self, error: SyntaxError) -> EquationError:
        if "digits" in error.msg:
            return self._fail(
                "A number here has too many digits; write it with an exponent, as in 1.5e300.", self.source.place(0)
            )
        offset = error.offset or 0  # 0, or a second line, when the text ended too early
        k = len(self.line) if offset == 0 or (error.lineno or 1) > 1 else min(offset - 1, len(self.line))
        if k == len(self.line):
            return self._fail(
                "The expression ends too early; write what is missing, or delete the last operator.",
                self.source.place(k),
            )
        here, before = self.line[k], self.line[:k].rstrip()[-1:]
        if error.msg.startswith("invalid character"):
            message = f"The character {here!r} cannot be read in equations; delete it, and write powers as x^2."
        elif (
            "forgot a comma" in error.msg
            or "decimal literal" in error.msg
            or (re.match(r"[\w(]", here) and re.match(r"[\w)]", before))
        ):
            message = (
                "An operator is missing here; write * to multiply, or a comma between the arguments of a function."
            )
        else:
            message = (
                f"The expression cannot be read here ({error.msg}); correct this place, or what is just before it."
            )
        return self._fail(message, self.source.place(k))

    def _check_depth(self, tree: ast.expr) -> None:
        waiting = [(tree, 1)]
        while waiting:
            node, depth = waiting.pop()
            if depth > MAX_DEPTH:
                raise self._too_deep(self._start(node))
            waiting.extend((child, depth + 1) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))

    def _too_deep(self, place: Place) -> EquationError:
        message = f"The expression nests more than {MAX_DEPTH} operations; split it with intermediate names."
        return EquationError(message, self.text, *place)

    def _fail(self, message: str, place: Place) -> EquationError:
        return EquationError(message, self.text, *place)

    def _start(self, node: ast.expr) -> Place:
        return self.source.place(self.character_of_byte[node.col_offset])

    def _between(self, left: ast.expr, symbol: str) -> Place:
        """Place of the first `symbol` after the end of `left`; only spaces and parentheses stand between."""
        end = self.character_of_byte[left.end_col_offset or 0]
        return self.source.place(max(self.line.find(symbol, end), 0))

    def _node(self, node: ast.expr) -> Node:
        match node:
            case ast.Constant():
                return self._number(node)
            case ast.Name():
                return self._name(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BinOp():
                return self._binary(node)
            case ast.BoolOp():
                symbol = "and" if isinstance(node.op, ast.And) else "or"
                args = tuple(self._node(v) for v in node.values)
                self._check_count(symbol, len(args), self._start(node))
                return Node(symbol, self._between(node.values[0], symbol), self._start(node), args)
            case ast.Compare():
                return self._compare(node)
            case ast.IfExp():
                args = (self._node(node.test), self._node(node.body), self._node(node.orelse))
                return Node("where", self._between(node.body, "if"), self._start(node), args)
            case ast.Call():
                return self._call(node)
        raise self._refuse(node)

    def _refuse(self, node: ast.expr) -> EquationError:
        what, symbol = _REFUSED.get(type(node), ("This", ""))
        decimal = re.search(r"\d,\d", self.line) if isinstance(node, ast.Tuple) else None
        if decimal is not None:
            return self._fail(
                "A comma cannot stand here; write decimals with a point, as in 2.5.",
                self.source.place(decimal.start() + 1),
            )
        match node:
            case ast.Attribute() | ast.Subscript():
                inner = node.value
            case ast.Tuple(elts=[first, *_]):
                inner = first
            case _:
                inner = None
        place = self._between(inner, symbol) if inner is not None else self._start(node)
        return self._fail(
            f"{what} is not allowed in equations; use numbers, names, + - * / ^, comparisons, if-else and functions.",
            place,
        )

    def _number(self, node: ast.Constant) -> Node:
        place = self._start(node)
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise self._fail(f"{node.value!r} is not allowed in equations; write a real number in its place.", place)
        try:
            value = float(node.value)
        except OverflowError:
            value = math.inf
        return self._finite(Node("number", place, place, number=value))

    def _finite(self, node: Node) -> Node:
        if not math.isfinite(node.number):
            raise self._fail("This number is not finite in double precision; write a smaller one.", node.place)
        return node

    def _name(self, node: ast.Name) -> Node:
        place = self._start(node)
        if node.id in CONSTANTS:
            return Node("number", place, place, number=CONSTANTS[node.id])
        return Node("name", place, place, name=node.id)

    def _unary(self, node: ast.UnaryOp) -> Node:
        start, arg = self._start(node), self._node(node.operand)
        if isinstance(node.op, ast.UAdd):
            return arg
        if isinstance(node.op, ast.Invert):
            raise self._fail("The operator ~ is not allowed in equations; write 'not'.", start)
        return self._folded(Node("not" if isinstance(node.op, ast.Not) else "negative", start, start, (arg,)))

    def _binary(self, node: ast.BinOp) -> Node:
        kind = type(node.op)
        if kind in _REFUSED_BINARY:
            symbol = _REFUSED_BINARY[kind]
            raise self._fail(
                f"The operator {symbol} is not allowed in equations; use + - * / ^.", self._between(node.left, symbol)
            )
        symbol = _BINARY[kind]
        place = self._between(node.left, symbol)
        left, right = self._node(node.left), self._node(node.right)
        if symbol == "/" and right.op == "number" and right.number == 0:
            raise self._fail("This divides by 0; write a divisor that is not 0.", place)
        return self._folded(Node(symbol, place, self._start(node), (left, right)))

    def _folded(self, node: Node) -> Node:
        """Arithmetic of numbers becomes one number; in float64, so that 9^9^9 ends as an error and not as a long
        wait."""
        if node.op not in _FOLD or any(a.op != "number" for a in node.args):
            return node
        with np.errstate(all="ignore"):
            value = float(_FOLD[node.op](*(np.float64(a.number) for a in node.args)))
        return self._finite(Node("number", node.place, node.start, number=value))

    def _compare(self, node: ast.Compare) -> Node:
        values = [node.left, *node.comparators]
        pairs = []
        for left, kind, right in zip(values, node.ops, values[1:], strict=False):
            symbol = _COMPARE.get(type(kind))
            if symbol is None:
                raise self._fail(
                    "'in' and 'is' are not allowed in equations; compare with < <= > >= == !=.", self._start(node)
                )
            pairs.append(
                Node(symbol, self._between(left, symbol), self._start(left), (self._node(left), self._node(right)))
            )
        if len(pairs) == 1:
            return pairs[0]
        self._check_count("and", len(pairs), self._start(node))
        return Node("and", pairs[1].place, self._start(node), tuple(pairs))

    def _call(self, node: ast.Call) -> Node:
        place = self._start(node)
        if not isinstance(node.func, ast.Name):
            if type(node.func) in _REFUSED:
                raise self._refuse(node.func)
            raise self._fail("Only a function's name can stand before these parentheses; write * to multiply.", place)
        name = node.func.id
        if name in self.tables:
            return self._table(node, self.tables[name], place)
        known = {*CALLS, *self.tables, *SPECIAL}
        if name in CROSSINGS:
            raise self._fail(f"{name}() is allowed only after 'when'; write when {name}(x): v = -c*v.", place)
        if name not in known:
            some = ", ".join(
                n for n in ("sin", "exp", "sqrt", "tanh", "min", "where", "delay", "friction") if n in known
            )
            hint = (
                _at_a_time(name, node)
                or suggest(name, known)
                or f" There are {some} and {len(known) - 8} more (docs/models.md); a table must be declared."
            )
            raise self._fail(f"The function {name!r} is not known.{hint}", place)
        if node.keywords:
            raise self._fail(f"Arguments are given without names here; write {FUNCTIONS[name].usage}.", place)
        self._check_count(name, len(node.args), place)
        return Node(name, place, place, tuple(self._node(a) for a in node.args))

    def _table(self, node: ast.Call, table: Table, place: Place) -> Node:
        usage = f"{table.name}({', '.join(table.over)})"
        if node.keywords:
            raise self._fail(f"Arguments are given without names here; write {usage}.", place)
        if len(node.args) != len(table.over):
            raise self._fail(
                f"The table {table.name!r} takes {len(table.over)} arguments, not {len(node.args)}; write {usage}.",
                place,
            )
        return Node("table", place, place, tuple(self._node(a) for a in node.args), name=table.name, table=table)

    def _check_count(self, name: str, count: int, place: Place) -> None:
        function = FUNCTIONS[name]
        if not function.least <= count <= function.most:
            expected = (
                f"{function.least}" if function.least == function.most else f"{function.least} to {function.most}"
            )
            usage = f"; write {function.usage}" if function.usage else "; split the expression"
            raise self._fail(f"{name!r} takes {expected} arguments, not {count}{usage}.", place)


def _with_python_power(source: Source) -> Source:
    result = Source()
    for character, place in zip(source.characters, source.places, strict=True):
        for c in "**" if character == "^" else character:
            result.add(c, place)
    return result
