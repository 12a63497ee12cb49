"""Elementwise primitives of lax, as operations on nodes."""

from collections.abc import Callable
from typing import Any

import numpy as np

from plantfit.native.graph import transcendentals
from plantfit.native.graph.arithmetic import Arithmetic
from plantfit.native.graph.nodes import BOOL, F64, I32, I64, Node
from plantfit.native.graph.values import dtype_of
from plantfit.native.unsupported import NativeUnsupported

_LIBM = {
    "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "asinh", "acosh", "atanh", "cbrt", "erf", "erfc", "lgamma",
    "pow", "nextafter",
    "exp2", "log2",
}  # fmt: skip
_OWN = {
    "exp": transcendentals.exp,
    "expm1": transcendentals.expm1,
    "log": transcendentals.log,
    "log1p": transcendentals.log1p,
    "tanh": transcendentals.tanh,
    "logistic": transcendentals.logistic,
    "sin": transcendentals.sin,
    "cos": transcendentals.cos,
}


def scalar_operation(m: Arithmetic, name: str, args: list[Node], params: dict) -> Node:
    """One entry of an elementwise primitive; raises NativeUnsupported for one without a rule."""
    if name in _OWN:
        return _OWN[name](m, args[0])
    if name in _LIBM:
        if any(a.dtype != F64 for a in args):
            if name == "pow" and args[0].dtype == F64:
                args = [args[0], m.convert(args[1], F64)]
            else:
                raise NativeUnsupported(f"{name} of {args[-1].dtype}")
        return m.libm(name, *args)
    rule = SCALAR_RULES.get(name)
    if rule is None:
        raise NativeUnsupported(name)
    return rule(m, *args, **params)


def _select_n(m: Arithmetic, which: Node, first: Node, *others: Node, **_: Any) -> Node:
    cases = [first, *others]
    value = cases[-1]
    if which.dtype == BOOL:
        return m.select(which, value, first)
    for k in reversed(range(len(cases) - 1)):
        value = m.select(m.compare("le", which, m.integer(k, which.dtype)), cases[k], value)
    return value


def _clamp(m: Arithmetic, low: Node, x: Node, high: Node, **_: Any) -> Node:
    return m.minimum(high, m.maximum(low, x))


def _polynomial(m: Arithmetic, x: Node, *coefficients: Node, **_: Any) -> Node:
    """Of coefficients from the lowest power on, by Horner's rule."""
    value = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = m.add(m.mul(value, x), c)
    return value


def _round(m: Arithmetic, a: Node, *, rounding_method: Any, **_: Any) -> Node:
    return m.op("roundeven" if int(rounding_method) == 1 else "round", a)


def _shift_rule(kind: str) -> Callable:
    def rule(m: Arithmetic, a: Node, count: Node, **_: Any) -> Node:
        bits = 64 if a.dtype == I64 else 32
        if kind == "sra":  # lax: a count out of range leaves the sign bit
            return m.op("sra", a, _count_or_top(m, count, bits - 1))
        inside = m.op(
            "and",
            m.compare("ge", count, m.integer(0, count.dtype)),
            m.compare("lt", count, m.integer(bits, count.dtype)),
        )
        return m.select(
            inside, m.op(kind, a, m.select(inside, count, m.integer(0, count.dtype))), m.integer(0, a.dtype)
        )

    return rule


def _count_or_top(m: Arithmetic, count: Node, top: int) -> Node:
    inside = m.op(
        "and", m.compare("ge", count, m.integer(0, count.dtype)), m.compare("le", count, m.integer(top, count.dtype))
    )
    return m.select(inside, count, m.integer(top, count.dtype))


def _empty(m: Arithmetic, *, dtype: Any, **_: Any) -> Node:
    return m.graph.const(0, dtype_of(dtype))


SCALAR_RULES: dict[str, Callable] = {
    "empty": _empty,
    "empty2": _empty,
    "add": lambda m, a, b, **_: m.op("or", a, b) if a.dtype == BOOL else m.add(a, b),
    "add_any": lambda m, a, b, **_: m.op("or", a, b) if a.dtype == BOOL else m.add(a, b),
    "sub": lambda m, a, b, **_: m.sub(a, b),
    "mul": lambda m, a, b, **_: m.op("and", a, b) if a.dtype == BOOL else m.mul(a, b),
    "div": lambda m, a, b, **_: m.div(a, b),
    "rem": lambda m, a, b, **_: m.rem(a, b),
    "neg": lambda m, a, **_: m.neg(a) if a.dtype == F64 else m.sub(m.integer(0, a.dtype), a),
    "sign": lambda m, a, **_: m.sign(a),
    "floor": lambda m, a, **_: m.op("floor", a),
    "ceil": lambda m, a, **_: m.op("ceil", a),
    "round": _round,
    "abs": lambda m, a, **_: m.absolute(a),
    "max": lambda m, a, b, **_: m.maximum(a, b),
    "min": lambda m, a, b, **_: m.minimum(a, b),
    "integer_pow": lambda m, a, *, y, **_: m.power(a, y),
    "square": lambda m, a, **_: m.mul(a, a),
    "one_minus_square": lambda m, a, **_: m.mul(m.add(m.number(1.0), a), m.sub(m.number(1.0), a)),
    "polynomial": _polynomial,
    "sqrt": lambda m, a, **_: m.op("sqrt", a),
    "rsqrt": lambda m, a, **_: m.op("div", m.number(1.0), m.op("sqrt", a)),
    "clamp": _clamp,
    "select_n": _select_n,
    "convert_element_type": lambda m, a, *, new_dtype, **_: m.convert(a, dtype_of(new_dtype)),
    **{
        f"{name}_to": lambda m, a, b, name=name, **_: m.compare(name, _total_order(m, a), _total_order(m, b))
        for name in ("eq", "lt", "le")
    },
    "bitcast_convert_type": lambda m, a, *, new_dtype, **_: _bits(m, a, dtype_of(new_dtype)),
    "is_finite": lambda m, a, **_: m.compare("lt", m.absolute(a), m.number(np.inf)),
    "and": lambda m, a, b, **_: m.op("and", a, b),
    "or": lambda m, a, b, **_: m.op("or", a, b),
    "xor": lambda m, a, b, **_: m.op("xor", a, b),
    "not": lambda m, a, **_: m.logical_not(a),
    "shift_left": _shift_rule("shl"),
    "shift_right_logical": _shift_rule("srl"),
    "shift_right_arithmetic": _shift_rule("sra"),
    **{
        name: lambda m, a, b, name=name, **_: (
            m.compare(name, a, b) if a.dtype != BOOL or name in ("eq", "ne") else _ordered(m, name, a, b)
        )
        for name in ("eq", "ne", "lt", "le", "gt", "ge")
    },
}


def _total_order(m: Arithmetic, a: Node) -> Node:
    """Integers in the total order of floats: -NaN, -inf, ..., -0, 0, ..., inf, NaN."""
    if a.dtype != F64:
        return a
    bits = m.graph.make("bits", (a,), I64)
    flip = m.op("srl", m.op("sra", bits, m.integer(63)), m.integer(1))
    return m.op("xor", bits, flip)


def _bits(m: Arithmetic, a: Node, dtype: str) -> Node:
    if {a.dtype, dtype} != {F64, I64}:
        raise NativeUnsupported(f"the bits of {a.dtype} as {dtype}")
    return m.graph.make("float" if dtype == F64 else "bits", (a,), dtype)


def _ordered(m: Arithmetic, name: str, a: Node, b: Node) -> Node:
    return m.compare(name, m.convert(a, I32), m.convert(b, I32))
