"""Scalar arithmetic on nodes with the semantics of lax and constant folding."""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from plantfit.native.graph.nodes import BOOL, F64, I32, I64, INTEGERS, NUMPY, U32, Graph, Node
from plantfit.native.unsupported import NativeUnsupported

_COMPARE: dict[str, Callable] = {
    "eq": operator.eq, "ne": operator.ne, "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge,
}  # fmt: skip
_FOLD: dict[str, Callable] = {
    **_COMPARE, "add": operator.add, "sub": operator.sub, "mul": operator.mul, "neg": operator.neg,
    "and": operator.and_, "or": operator.or_, "xor": operator.xor,
}  # fmt: skip


class Arithmetic:
    """Operations that return nodes of one graph."""

    def __init__(self, graph: Graph):
        self.graph = graph

    # -- building blocks ----------------------------------------------------------------------------

    def number(self, value: float) -> Node:
        return self.graph.number(value)

    def integer(self, value: int, dtype: str = I64) -> Node:
        return self.graph.const(value, dtype)

    def op(self, name: str, *args: Node, dtype: str | None = None, data: Any = None) -> Node:
        """A node, folded when all arguments are constants."""
        dtype = dtype or (BOOL if name in _COMPARE else args[0].dtype)
        if name in _FOLD and all(a.op == "const" for a in args):
            with np.errstate(all="ignore"):
                return self.graph.const(_FOLD[name](*(a.data for a in args)), dtype)
        return self.graph.make(name, args, dtype, data)

    def add(self, a: Node, b: Node) -> Node:
        if _is(a, 0) and a.dtype != BOOL:  # a sum with 0 may keep the sign of -0
            return b
        if _is(b, 0) and b.dtype != BOOL:
            return a
        if b.op == "neg":
            return self.sub(a, b.args[0])
        return self.sub(b, a.args[0]) if a.op == "neg" else self.op("add", a, b)

    def sub(self, a: Node, b: Node) -> Node:
        if _is(b, 0) and not (b.dtype == F64 and math.copysign(1.0, b.data) < 0):  # x - (+0) is x
            return a
        return self.op("add", a, b.args[0]) if b.op == "neg" else self.op("sub", a, b)

    def mul(self, a: Node, b: Node) -> Node:
        if _is(a, 1):
            return b
        if _is(b, 1):
            return a
        if a.dtype == F64 and _is(a, -1):
            return self.neg(b)
        if b.dtype == F64 and _is(b, -1):
            return self.neg(a)
        if b.op == "neg":
            a, b = b, a
        if a.op == "neg":
            return self.op("mul", a.args[0], self.neg(b)) if b.op == "const" else self.neg(self.mul(a.args[0], b))
        return self.op("mul", a, b)

    def neg(self, a: Node) -> Node:
        return a.args[0] if a.op == "neg" else self.op("neg", a)

    def div(self, a: Node, b: Node) -> Node:
        if _is(b, 1):
            return a
        if a.dtype == F64:
            return self.op("div", a, b)
        if b.op == "const" and b.data not in (0, -1):
            return self.op("div", a, b)
        # division by zero, and of the least number by -1, would stop the process; lax gives -1 and the least number
        zero, one, minus = (self.integer(i, a.dtype) for i in (0, 1, -1 if a.dtype != U32 else 0xFFFFFFFF))
        none = self.compare("eq", b, zero)
        back = self.compare("eq", b, minus) if a.dtype != U32 else none
        safe = self.op("div", a, self.select(self.op("or", none, back), one, b))
        if a.dtype != U32:
            safe = self.select(back, self.sub(zero, a), safe)
        return self.select(none, minus, safe)

    def rem(self, a: Node, b: Node) -> Node:
        if a.dtype == F64:
            return self.libm("fmod", a, b)
        zero, one = self.integer(0, a.dtype), self.integer(1, a.dtype)
        none = self.compare("eq", b, zero)
        bad = none if a.dtype == U32 else self.op("or", none, self.compare("eq", b, self.integer(-1, a.dtype)))
        whole = self.op("rem", a, self.select(bad, one, b))
        return self.select(none, a, whole)

    def fma(self, a: Node, b: Node, c: Node) -> Node:
        return self.graph.make("fma", (a, b, c), F64, (False, False))

    def compare(self, kind: str, a: Node, b: Node) -> Node:
        return self.op(kind, a, b, dtype=BOOL)

    def select(self, condition: Node, yes: Node, no: Node) -> Node:
        if condition.op == "const":
            return yes if condition.data else no
        return yes if yes is no else self.op("select", condition, yes, no, dtype=yes.dtype)

    def logical_not(self, a: Node) -> Node:
        ones = (
            self.graph.const(True, BOOL)
            if a.dtype == BOOL
            else self.integer(-1 if a.dtype != U32 else 0xFFFFFFFF, a.dtype)
        )
        return self.op("xor", a, ones)

    # -- semantics of lax ---------------------------------------------------------------------------

    def extreme(self, kind: str, a: Node, b: Node) -> Node:
        """max ("gt") or min ("lt"); NaN when either is."""
        if a.dtype == BOOL:
            return self.op("or" if kind == "gt" else "and", a, b)
        if a.op == "const" and a.data == a.data:
            return self.select(self.compare(kind, a, b), a, b)
        if b.op == "const" and b.data == b.data:
            return self.select(self.compare(kind, b, a), b, a)
        best = self.select(self.compare(kind, a, b), a, b)
        return best if a.dtype != F64 else self.select(self.compare("ne", a, a), a, best)

    def maximum(self, a: Node, b: Node) -> Node:
        return self.extreme("gt", a, b)

    def minimum(self, a: Node, b: Node) -> Node:
        return self.extreme("lt", a, b)

    def absolute(self, a: Node) -> Node:
        if a.dtype == F64:
            return self.op("abs", a)
        return a if a.dtype in (U32, BOOL) else self.maximum(a, self.sub(self.integer(0, a.dtype), a))

    def sign(self, a: Node) -> Node:
        zero, one = self.graph.const(0, a.dtype), self.graph.const(1, a.dtype)
        if a.dtype == U32:
            return self.select(self.compare("gt", a, zero), one, zero)
        signed = self.select(self.compare("lt", a, zero), self.graph.const(-1, a.dtype), a)  # keeps NaN and -0
        return self.select(self.compare("gt", a, zero), one, signed)

    def power(self, a: Node, exponent: int) -> Node:
        """a to a whole power by repeated squaring."""
        if exponent < 0:
            inverse = self.op("div", self.number(1.0), a)
            return (
                self.power(inverse, -exponent)
                if exponent > -4
                else self.op("div", self.number(1.0), self.power(a, -exponent))
            )
        result, square = self.graph.const(1, a.dtype), a
        while exponent:
            if exponent & 1:
                result = self.mul(result, square)
            exponent >>= 1
            if exponent:
                square = self.mul(square, square)
        return result

    def convert(self, a: Node, dtype: str) -> Node:
        if a.dtype == dtype:
            return a
        if a.op == "const" and not (a.dtype == F64 and dtype != BOOL and not abs(a.data) < 2**31):
            return self.graph.const(a.data.astype(NUMPY[dtype]), dtype)
        if dtype == BOOL:
            return self.compare("ne", a, self.graph.const(0, a.dtype))
        if a.dtype == F64 and dtype in (I32, I64):
            low, high = span(a)
            inside = low >= -(2**31) and high < 2**31
            return self.graph.make("to_int", (a,), dtype, inside)
        if a.dtype == F64:
            raise NativeUnsupported("float64 to uint32")
        return self.graph.make("convert", (a,), dtype)

    def libm(self, name: str, *args: Node) -> Node:
        """A function of the C library."""
        return self.graph.make("libm", args, F64, name)


def _is(node: Node, value: float) -> bool:
    return node.op == "const" and bool(node.data == value)


def span(node: Node, deep: int = 8) -> tuple[float, float]:
    """Interval analysis: bounds of the value of a node (unless it is NaN), from arguments down to `deep` levels."""
    nothing = (-math.inf, math.inf)
    if node.op == "const":
        return (float(node.data), float(node.data)) if node.data == node.data else nothing
    if deep == 0:
        return nothing
    inner = [span(a, deep - 1) for a in node.args if a.size is None]
    if node.op == "select":
        return _span_of_select(node, inner)
    if node.op == "floor":
        return tuple(math.floor(v) if math.isfinite(v) else v for v in inner[0])  # pyrefly: ignore[bad-return]
    if node.op == "to_int":
        (low, high), reach = inner[0], 2.0 ** (31 if node.dtype == I32 else 63)
        return min(max(low, -reach), 0.0), max(min(high, reach), 0.0)  # NaN gives 0
    if node.op == "convert":
        a, b = (0.0, 1.0) if node.args[0].dtype == BOOL else inner[0]
        return (a, b) if node.dtype in (I64, F64) or -(2**31) <= a <= b < 2**31 else nothing
    if node.op in ("add", "sub") and node.dtype in INTEGERS:
        return _span_of_sum(node, inner)
    return nothing


def _span_of_sum(node: Node, inner: list[tuple[float, float]]) -> tuple[float, float]:
    (a, b), (c, d) = inner
    low, high = (a + c, b + d) if node.op == "add" else (a - d, b - c)
    return (low, high) if -(2**31) <= low <= high < 2**31 else (-math.inf, math.inf)


def _span_of_select(node: Node, inner: list[tuple[float, float]]) -> tuple[float, float]:
    condition, yes, no = node.args
    (a, b), (c, d) = inner[1:]
    if condition.op in ("gt", "lt") and set(map(id, condition.args)) == {id(yes), id(no)} and yes is not no:
        larger = (condition.op == "gt") == (condition.args[0] is yes)
        return (max(a, c), max(b, d)) if larger else (min(a, c), min(b, d))
    return min(a, c), max(b, d)
