"""From a jaxpr to the graph: every primitive that has a native form."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from plantfit.native import functions, indexing
from plantfit.native.arithmetic import Arithmetic
from plantfit.native.graph import BOOL, F64, I32, I64, Graph, Node, Region
from plantfit.native.unsupported import NativeUnsupported
from plantfit.native.values import Memory, Pending, Value, array_of, constant, dtype_of, entries, in_memory, scalar

# isort: split
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

_INLINE = {name: "jaxpr" for name in ("jit", "pjit", "remat", "remat2", "checkpoint")} | {
    name: "call_jaxpr" for name in ("closed_call", "core_call", "custom_jvp_call", "custom_vjp_call")
}
_COPIES = {"copy", "copy_p", "stop_gradient", "optimization_barrier", "name", "device_put", "sharding_constraint"}
_LIBM = {"tan": "tan", "asin": "asin", "acos": "acos", "atan": "atan", "atan2": "atan2", "sinh": "sinh", "cosh": "cosh", "asinh": "asinh",
         "acosh": "acosh", "atanh": "atanh", "cbrt": "cbrt", "erf": "erf", "erfc": "erfc", "lgamma": "lgamma", "pow": "pow",
         "nextafter": "nextafter", "exp2": "exp2"}  # fmt: skip
_OWN = {"exp": functions.exp, "expm1": functions.expm1, "log": functions.log, "log1p": functions.log1p, "tanh": functions.tanh,
        "logistic": functions.logistic, "sin": functions.sin, "cos": functions.cos}  # fmt: skip
_MOVES = {"dynamic_slice", "gather", "scatter", "scatter_add", "scatter-add", "dynamic_update_slice", "scan", "while"}


class Tracer:
    """Runs jaxprs on values made of nodes."""

    def __init__(self, graph: Graph):
        self.m = Arithmetic(graph)
        self.graph = graph

    def closed(self, jaxpr: ClosedJaxpr, args: Sequence[Value]) -> list[Value]:
        """The results of a jaxpr as arrays."""
        return self.settled(self._inlined(jaxpr, args))

    def settled(self, values: Sequence[Any]) -> list[Value]:
        """Values as arrays, nothing pending."""
        return [self._settled(v) for v in values]

    def _inlined(self, jaxpr: ClosedJaxpr, args: Sequence[Value]) -> list[Value]:
        return self.run(jaxpr.jaxpr, [constant(self.m, c) for c in jaxpr.consts], args)

    def _settled(self, value: Any) -> Value:
        if not isinstance(value, Pending):
            return value
        zeros = array_of(value.shape, lambda _: self.graph.const(0.0, F64))
        return value.added_to(self.m, zeros)

    def _sum(self, a: Any, b: Any) -> Any:
        """a + b where one of them is pending."""
        if isinstance(a, Pending) and isinstance(b, Pending):
            return Pending(a.shape, a.sums + b.sums)
        return a.added_to(self.m, b) if isinstance(a, Pending) else b.added_to(self.m, a)

    def run(self, jaxpr: Jaxpr, consts: Sequence[Value], args: Sequence[Value]) -> list[Value]:
        """The results of a jaxpr; raises NativeUnsupported for a primitive without a native form."""
        known: dict[Any, Value] = dict(zip(jaxpr.constvars, consts, strict=True)) | dict(zip(jaxpr.invars, args, strict=True))

        def read(atom: Any) -> Value:
            return constant(self.m, atom.val) if isinstance(atom, Literal) else known[atom]

        for equation in jaxpr.eqns:
            known.update(zip(equation.outvars, self._one(equation, [read(v) for v in equation.invars]), strict=True))
        return [read(v) for v in jaxpr.outvars]

    def _one(self, equation: Any, args: list[Value]) -> Sequence[Value]:
        name, params = equation.primitive.name, equation.params
        if name in _INLINE:
            inner = params[_INLINE[name]]
            return self._inlined(inner, args) if isinstance(inner, ClosedJaxpr) else self.run(inner, (), args)
        if name in _COPIES:
            return args
        if name in ("add", "add_any") and any(isinstance(a, Pending) for a in args) and args[0].shape == args[1].shape:
            return [self._sum(*args)]
        args = self.settled(args)
        if name in ("scan", "while", "cond"):
            return getattr(self, f"_{name}")(args, **params)
        if len(equation.outvars) != 1:
            raise NativeUnsupported(name)
        shapes = [v.aval.shape for v in equation.outvars]
        for v in equation.outvars:
            dtype_of(v.aval.dtype)
        structural = _STRUCTURE.get(name)
        if structural is not None:
            return [structural(self.m, *args, out_shape=shapes[0], out_dtype=dtype_of(equation.outvars[0].aval.dtype), **params)]
        return [self._elementwise(name, shapes[0], args, params)]

    def _elementwise(self, name: str, shape: tuple[int, ...], args: list[Value], params: dict) -> np.ndarray:
        try:
            spread = [np.broadcast_to(entries(self.m, a), shape) for a in args]
        except ValueError:  # then it is no elementwise operation
            raise NativeUnsupported(name) from None
        return array_of(shape, lambda index: _scalar_operation(self.m, name, [a[index] for a in spread], params))

    # -- control flow -------------------------------------------------------------------------------

    def enter(self, values: Sequence[Value], moving: bool) -> tuple[list[Value], list[Node]]:
        """Parameters of the region just opened for carried values, and what they begin with."""
        inside: list[Value] = []
        begin: list[Node] = []
        for value in values:
            if value.shape and moving:
                memory = whole(self.m, value)
                inside.append(Memory(self.graph.param(memory.dtype, memory.node.size), value.shape))
                begin.append(memory.node)
            else:
                flat = entries(self.m, value)
                inside.append(array_of(value.shape, lambda index, flat=flat: self.graph.param(flat[index].dtype)))
                begin.extend(flat.reshape(-1).tolist())
        return inside, begin

    def leave(self, values: Sequence[Value], moving: bool) -> list[Node]:
        """The nodes that a region hands on."""
        out: list[Node] = []
        for value in values:
            if value.shape and moving:
                out.append(whole(self.m, value).node)
            else:
                out.extend(entries(self.m, value).reshape(-1).tolist())
        return out

    def _results(self, node: Node, values: Sequence[Value], moving: bool, nodes: Sequence[Node]) -> list[Value]:
        """Values shaped as `values` from the results of a node with regions."""
        numbered = iter(enumerate(nodes))

        def get() -> Node:
            k, like = next(numbered)
            return self.graph.make("get", (node,), like.dtype, k, like.size)

        return [Memory(get(), v.shape) if v.shape and moving else array_of(v.shape, lambda _: get()) for v in values]

    def _while(self, args: list[Value], *, cond_jaxpr: Any, body_jaxpr: Any, cond_nconsts: int, body_nconsts: int, **_: Any) -> list[Value]:
        test_consts, body_consts = args[:cond_nconsts], args[cond_nconsts : cond_nconsts + body_nconsts]
        init = args[cond_nconsts + body_nconsts :]
        moving = moves(body_jaxpr.jaxpr) or moves(cond_jaxpr.jaxpr) or _large(init)
        if moving:
            init = [whole(self.m, v) if v.shape else v for v in init]
        region = self.graph.open()
        inside, begin = self.enter(init, moving)
        test = self.graph.open()
        test.results = [self.closed(cond_jaxpr, [*test_consts, *inside])[0].item()]  # type: ignore[union-attr]
        self.graph.close()
        region.results = self.leave(self.closed(body_jaxpr, [*body_consts, *inside]), moving)
        self.graph.close()
        node = self.graph.make("while", tuple(begin), F64, (test, region))
        return self._results(node, init, moving, region.params)

    def _scan(
        self, args: list[Value], *, jaxpr: ClosedJaxpr, length: int, reverse: bool, num_consts: int, num_carry: int, **_: Any
    ) -> list[Value]:
        consts, init, xs = args[:num_consts], args[num_consts : num_consts + num_carry], args[num_consts + num_carry :]
        rows = [v.aval for v in jaxpr.jaxpr.outvars[num_carry:]]
        if length == 0:
            raise NativeUnsupported("an inner scan of length 0")
        ys = [array_of((length, *a.shape), lambda _, a=a: self.graph.const(0, dtype_of(a.dtype))) for a in rows]
        moving = moves(jaxpr.jaxpr) or _large(init)
        xs = [in_memory(self.m, x) for x in xs]
        init = [whole(self.m, v) if v.shape and moving else v for v in init]
        begin_ys = [whole(self.m, y) for y in ys]
        region = self.graph.open()
        count = self.graph.param(I64)
        inside, begin = self.enter(init, moving)
        inside_ys, more = self.enter(begin_ys, True)
        places = [y for y in inside_ys if isinstance(y, Memory)]
        k = self.m.sub(self.m.integer(length - 1), count) if reverse else count
        rows_in = [self._row(x, k) for x in xs]
        out = self.closed(jaxpr, [*consts, *inside, *rows_in])
        written = [self._with_row(y, k, row) for y, row in zip(places, out[num_carry:], strict=True)]
        region.results = [*self.leave(out[:num_carry], moving), *self.leave(written, True)]
        self.graph.close()
        node = self.graph.make("loop", (self.m.integer(length), *begin, *more), F64, (region,))
        carried = self._results(node, init, moving, region.params[1 : 1 + len(begin)])
        tail = region.params[1 + len(begin) :]
        gets = [self.graph.make("get", (node,), p.dtype, len(begin) + i, p.size) for i, p in enumerate(tail)]
        return [*carried, *(Memory(g, y.shape) for g, y in zip(gets, ys, strict=True))]

    def _row(self, memory: Memory, k: Node) -> np.ndarray:
        size = int(np.prod(memory.shape[1:]))
        start = self.m.mul(self.m.convert(k, I32), self.m.integer(size, I32))
        shape = memory.shape[1:]
        return array_of(shape, lambda index: indexing.load(self.m, memory, start, int(np.ravel_multi_index(index, shape)) if shape else 0))

    def _with_row(self, memory: Memory, k: Node, row: Value) -> Memory:
        flat = entries(self.m, row).reshape(-1)
        allowed = self.graph.const(True, BOOL)
        for i, node in enumerate(flat):
            place = self.m.add(self.m.mul(self.m.convert(k, I32), self.m.integer(len(flat), I32)), self.m.integer(i, I32))
            memory = indexing.store(self.m, memory, place, node, allowed)
        return memory

    def _cond(self, args: list[Value], *, branches: Sequence[ClosedJaxpr], **_: Any) -> list[Value]:
        index, operands = args[0].item(), args[1:]  # type: ignore[union-attr]
        if index.op == "const":
            return self.closed(branches[max(0, min(len(branches) - 1, int(index.data)))], operands)
        moving = any(moves(b.jaxpr) for b in branches)
        avals = [v.aval for v in branches[0].jaxpr.outvars]
        for a in avals:
            dtype_of(a.dtype)
        regions: list[Region] = []
        values: list[Value] = []
        for branch in branches:
            regions.append(self.graph.open())
            values = self.closed(branch, operands)
            regions[-1].results = self.leave(values, moving)
            self.graph.close()
        node = self.graph.make("cond", (index,), F64, tuple(regions))
        return self._results(node, values, moving, regions[-1].results)


def whole(m: Arithmetic, value: Value) -> Memory:
    """The array in memory, alone there from its first entry to its last."""
    memory = in_memory(m, value)
    if memory.offset or memory.node.size != int(np.prod(memory.shape)) or memory.node.op == "constant":
        flat = entries(m, memory).reshape(-1)
        return Memory(m.graph.make("pack", tuple(flat), memory.dtype, None, size=len(flat)), memory.shape)
    return memory


def moves(jaxpr: Any) -> bool:
    """Whether arrays are indexed at run time anywhere in a jaxpr."""
    jaxpr = getattr(jaxpr, "jaxpr", jaxpr)
    if any(equation.primitive.name in _MOVES for equation in jaxpr.eqns):
        return True
    given = [p for equation in jaxpr.eqns for p in equation.params.values()]
    inner = [one for p in given for one in (p if isinstance(p, tuple | list) else (p,))]
    return any(moves(one) for one in inner if hasattr(one, "eqns") or hasattr(one, "jaxpr"))


def _large(values: Sequence[Value]) -> bool:
    return sum(int(np.prod(v.shape)) for v in values) > 64


# -- scalar operations ----------------------------------------------------------------------------------


def _scalar_operation(m: Arithmetic, name: str, args: list[Node], params: dict) -> Node:
    if name in _OWN:
        return _OWN[name](m, args[0])
    if name in _LIBM:
        if any(a.dtype != F64 for a in args):
            if name == "pow" and args[0].dtype == F64:
                args = [args[0], m.convert(args[1], F64)]
            else:
                raise NativeUnsupported(f"{name} of {args[-1].dtype}")
        return m.libm(_LIBM[name], *args)
    rule = _SCALAR.get(name)
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


def _round(m: Arithmetic, a: Node, *, rounding_method: Any, **_: Any) -> Node:
    return m.op("roundeven" if int(rounding_method) == 1 else "round", a)


def _shift_rule(kind: str) -> Callable:
    def rule(m: Arithmetic, a: Node, count: Node, **_: Any) -> Node:
        bits = 64 if a.dtype == I64 else 32
        if kind == "sra":  # lax: a count out of range leaves only signs
            return m.op("sra", a, _select_top(m, count, bits - 1))
        inside = m.op("and", m.compare("ge", count, m.integer(0, count.dtype)), m.compare("lt", count, m.integer(bits, count.dtype)))
        return m.select(inside, m.op(kind, a, m.select(inside, count, m.integer(0, count.dtype))), m.integer(0, a.dtype))

    return rule


def _select_top(m: Arithmetic, count: Node, top: int) -> Node:
    inside = m.op("and", m.compare("ge", count, m.integer(0, count.dtype)), m.compare("le", count, m.integer(top, count.dtype)))
    return m.select(inside, count, m.integer(top, count.dtype))


_SCALAR: dict[str, Callable] = {
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
    "sqrt": lambda m, a, **_: m.op("sqrt", a),
    "rsqrt": lambda m, a, **_: m.op("div", m.number(1.0), m.op("sqrt", a)),
    "clamp": _clamp,
    "select_n": _select_n,
    "convert_element_type": lambda m, a, *, new_dtype, **_: m.convert(a, dtype_of(new_dtype)),
    **{
        f"{name}_to": lambda m, a, b, name=name, **_: m.compare(name, _total_order(m, a), _total_order(m, b)) for name in ("eq", "lt", "le")
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
        name: lambda m, a, b, name=name, **_: m.compare(name, a, b) if a.dtype != BOOL or name in ("eq", "ne") else _ordered(m, name, a, b)
        for name in ("eq", "ne", "lt", "le", "gt", "ge")
    },
}


def _total_order(m: Arithmetic, a: Node) -> Node:
    """Whole numbers in the total order of floats: -NaN, -inf, ..., -0, 0, ..., inf, NaN."""
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


# -- shapes ---------------------------------------------------------------------------------------------


def _broadcast_in_dim(m: Arithmetic, a: Value, *, out_shape: tuple[int, ...], broadcast_dimensions: Sequence[int], **_: Any) -> np.ndarray:
    a = entries(m, a)
    shape = [1] * len(out_shape)
    for axis, place in enumerate(broadcast_dimensions):
        shape[place] = a.shape[axis]
    return np.broadcast_to(a.reshape(shape), out_shape)


def _reshape(m: Arithmetic, a: Value, *, out_shape: tuple[int, ...], **_: Any) -> Value:
    return Memory(a.node, out_shape, a.offset) if isinstance(a, Memory) else a.reshape(out_shape)


def _slice(m: Arithmetic, a: Value, *, start_indices: Sequence[int], limit_indices: Sequence[int], strides: Any, **_: Any) -> np.ndarray:
    steps = strides or (1,) * len(start_indices)
    return entries(m, a)[tuple(slice(i, j, k) for i, j, k in zip(start_indices, limit_indices, steps, strict=True))]


def _iota(m: Arithmetic, *, out_shape: tuple[int, ...], out_dtype: str, dimension: int, **_: Any) -> np.ndarray:
    return array_of(out_shape, lambda index: m.graph.const(index[dimension], out_dtype))


def _reduction(join: Callable) -> Callable:
    def rule(m: Arithmetic, a: Value, *, axes: Sequence[int], out_shape: tuple[int, ...], out_dtype: str, **_: Any) -> np.ndarray:
        a = entries(m, a)
        rest = [i for i in range(a.ndim) if i not in axes]
        flat = np.transpose(a, (*rest, *axes)).reshape(*out_shape, -1)

        def one(index: tuple[int, ...]) -> Node:
            row = list(flat[index])
            if not row:
                raise NativeUnsupported("a reduction of nothing")
            while len(row) > 1:  # by pairs: short chains
                row = [join(m, *row[i : i + 2]) if i + 1 < len(row) else row[i] for i in range(0, len(row), 2)]
            return row[0]

        return array_of(out_shape, one)

    return rule


def _arg_extreme(kind: str) -> Callable:
    def rule(m: Arithmetic, a: Value, *, axes: Sequence[int], out_shape: tuple[int, ...], out_dtype: str, **_: Any) -> np.ndarray:
        rows = np.moveaxis(entries(m, a), axes[0], -1)

        def one(index: tuple[int, ...]) -> Node:
            best, place = rows[index][0], m.integer(0, out_dtype)
            for k, node in enumerate(rows[index][1:], 1):
                better = m.compare(kind, node, best)
                if node.dtype == F64:  # the first NaN wins
                    nan = m.op("and", m.compare("ne", node, node), m.compare("eq", best, best))
                    better = m.op("or", better, nan)
                best, place = m.select(better, node, best), m.select(better, m.integer(k, out_dtype), place)
            return place

        return array_of(out_shape, one)

    return rule


def _cumulative(join: Callable) -> Callable:
    def rule(m: Arithmetic, a: Value, *, axis: int, reverse: bool, **_: Any) -> np.ndarray:
        rows = np.moveaxis(entries(m, a), axis, 0)
        out = np.empty(rows.shape, dtype=object)
        order = range(len(rows))
        for k in reversed(order) if reverse else order:
            before = k + 1 if reverse else k - 1
            first = not 0 <= before < len(rows)
            for index in np.ndindex(*rows.shape[1:]):
                out[(k, *index)] = rows[(k, *index)] if first else join(m, out[(before, *index)], rows[(k, *index)])
        return np.moveaxis(out, 0, axis)

    return rule


def _dot_general(m: Arithmetic, a: Value, b: Value, *, dimension_numbers: Any, out_shape: tuple[int, ...], **_: Any) -> np.ndarray:
    (ca, cb), (ba, bb) = dimension_numbers
    a, b = entries(m, a), entries(m, b)
    fa = [i for i in range(a.ndim) if i not in (*ca, *ba)]
    fb = [i for i in range(b.ndim) if i not in (*cb, *bb)]
    a, b = np.transpose(a, (*ba, *fa, *ca)), np.transpose(b, (*bb, *fb, *cb))
    batch, left, inner = len(ba), len(fa), a.shape[len(ba) + len(fa) :]

    def one(index: tuple[int, ...]) -> Node:
        row, column = a[index[: batch + left]], b[(*index[:batch], *index[batch + left :])]
        terms = [m.mul(row[k], column[k]) for k in np.ndindex(*inner)]
        total = terms[0]
        for term in terms[1:]:
            total = m.add(total, term)
        return total

    return array_of(out_shape, one)


def _concatenate(m: Arithmetic, *parts: Value, dimension: int, **_: Any) -> np.ndarray:
    return np.concatenate([entries(m, p) for p in parts], axis=dimension)


def _stack(m: Arithmetic, *parts: Value, axis: int, **_: Any) -> np.ndarray:
    return np.stack([entries(m, p) for p in parts], axis=axis)


def _pad(m: Arithmetic, a: Value, fill: np.ndarray, *, padding_config: Any, out_shape: tuple[int, ...], **_: Any) -> np.ndarray:
    a, node = entries(m, a), fill.item()
    out = array_of(out_shape, lambda _: node)
    for index in np.ndindex(*a.shape):
        place = tuple(low + i * (inner + 1) for i, (low, _, inner) in zip(index, padding_config, strict=True))
        if all(0 <= p < n for p, n in zip(place, out_shape, strict=True)):
            out[place] = a[index]
    return out


def _with(rule: Callable, **fixed: Any) -> Callable:
    return lambda m, *args, **params: rule(m, *args, **{**params, **fixed})


_ADD, _MAX, _MIN = _SCALAR["add"], _SCALAR["max"], _SCALAR["min"]
_STRUCTURE: dict[str, Callable] = {
    "reshape": _reshape,
    "squeeze": _reshape,
    "expand_dims": _reshape,
    "broadcast_in_dim": _broadcast_in_dim,
    "transpose": lambda m, a, *, permutation, **_: np.transpose(entries(m, a), permutation),
    "rev": lambda m, a, *, dimensions, **_: np.flip(entries(m, a), dimensions),
    "slice": _slice,
    "pad": _pad,
    "concatenate": _concatenate,
    "stack": _stack,
    "iota": _iota,
    "reduce_sum": _reduction(_ADD),
    "reduce_prod": _reduction(_SCALAR["mul"]),
    "reduce_max": _reduction(_MAX),
    "reduce_min": _reduction(_MIN),
    "reduce_and": _reduction(_SCALAR["and"]),
    "reduce_or": _reduction(_SCALAR["or"]),
    "argmin": _arg_extreme("lt"),
    "argmax": _arg_extreme("gt"),
    "cumsum": _cumulative(_ADD),
    "cumprod": _cumulative(_SCALAR["mul"]),
    "cummax": _cumulative(_MAX),
    "cummin": _cumulative(_MIN),
    "dot_general": _dot_general,
    "dynamic_slice": indexing.dynamic_slice,
    "dynamic_update_slice": indexing.dynamic_update_slice,
    "gather": indexing.gather,
    "scatter": _with(indexing.scatter, how="set"),
    "scatter_add": _with(indexing.scatter, how="add"),
    "scatter-add": _with(indexing.scatter, how="add"),
}

__all__ = ["Tracer", "moves", "scalar", "whole"]
