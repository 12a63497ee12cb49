"""From a jaxpr to the graph: equations in order, inlined calls, control flow."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.graph.arithmetic import Arithmetic
from plantfit.native.graph.nodes import BOOL, F64, I32, I64, Graph, Node, Region
from plantfit.native.graph.values import (
    Memory,
    Sparse,
    Value,
    array_of,
    constant,
    dtype_of,
    entries,
    in_memory,
    load,
    store,
    whole,
)
from plantfit.native.trace.array_rules import ARRAY_RULES
from plantfit.native.trace.equation_parts import expanded, scan_parts, while_parts
from plantfit.native.trace.scalar_rules import scalar_operation
from plantfit.native.unsupported import NativeUnsupported

# isort: split
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

_INLINE = {name: "jaxpr" for name in ("jit", "pjit", "remat", "remat2", "checkpoint")} | {
    name: "call_jaxpr" for name in ("closed_call", "core_call", "custom_jvp_call", "custom_vjp_call")
}
_COPIES = {"copy", "copy_p", "stop_gradient", "optimization_barrier", "name", "device_put", "sharding_constraint"}
# primitives that index arrays at run time
_MOVES = {"dynamic_slice", "gather", "scatter", "scatter_add", "scatter-add", "dynamic_update_slice", "scan", "while"}


def _of_float64(exponent_bits: int, mantissa_bits: int) -> bool:
    """Whether a rounding to so many bits leaves float64 as it is, as jax marks what `jax.checkpoint` keeps."""
    return exponent_bits >= 11 and mantissa_bits >= 52


class Tracer:
    """Interprets jaxprs on arrays of nodes."""

    def __init__(self, graph: Graph):
        self.m = Arithmetic(graph)
        self.graph = graph

    def closed(self, jaxpr: ClosedJaxpr, args: Sequence[Value]) -> list[Value]:
        """The results of a jaxpr as arrays."""
        return self.dense(self._inlined(jaxpr, args))

    def dense(self, values: Sequence[Any]) -> list[Value]:
        """Values with sparse arrays made dense."""
        return [self._dense(v) for v in values]

    def _inlined(self, jaxpr: ClosedJaxpr, args: Sequence[Value]) -> list[Value]:
        return self.run(jaxpr.jaxpr, [constant(self.m, c) for c in jaxpr.consts], args)

    def _dense(self, value: Any) -> Value:
        if not isinstance(value, Sparse):
            return value
        zeros = array_of(value.shape, lambda _: self.graph.const(0.0, F64))
        return value.added_to(self.m, zeros)

    def _sum(self, a: Any, b: Any) -> Any:
        """a + b, at least one of them sparse."""
        if isinstance(a, Sparse) and isinstance(b, Sparse):
            return Sparse(a.shape, a.sums + b.sums)
        return a.added_to(self.m, b) if isinstance(a, Sparse) else b.added_to(self.m, a)

    def run(self, jaxpr: Jaxpr, consts: Sequence[Value], args: Sequence[Value]) -> list[Value]:
        """The results of a jaxpr; raises NativeUnsupported for a primitive without a native form."""
        known: dict[Any, Value] = dict(zip(jaxpr.constvars, consts, strict=True)) | dict(
            zip(jaxpr.invars, args, strict=True)
        )

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
        if (plain := expanded(equation)) is not None:
            return self._inlined(plain, args)
        if name in _COPIES or (name == "reduce_precision" and _of_float64(**params)):
            return args
        if name in ("add", "add_any") and any(isinstance(a, Sparse) for a in args) and args[0].shape == args[1].shape:
            return [self._sum(*args)]
        args = self.dense(args)
        if name in ("scan", "while", "cond"):
            return getattr(self, f"_{name}")(equation, args, **params)
        if len(equation.outvars) != 1:
            raise NativeUnsupported(name)
        shapes = [v.aval.shape for v in equation.outvars]
        for v in equation.outvars:
            dtype_of(v.aval.dtype)
        structural = ARRAY_RULES.get(name)
        if structural is not None:
            return [
                structural(
                    self.m, *args, out_shape=shapes[0], out_dtype=dtype_of(equation.outvars[0].aval.dtype), **params
                )
            ]
        return [self._elementwise(name, shapes[0], args, params)]

    def _elementwise(self, name: str, shape: tuple[int, ...], args: list[Value], params: dict) -> np.ndarray:
        try:
            spread = [np.broadcast_to(entries(self.m, a), shape) for a in args]
        except ValueError:  # then it is no elementwise operation
            raise NativeUnsupported(name) from None
        return array_of(shape, lambda index: scalar_operation(self.m, name, [a[index] for a in spread], params))

    # -- control flow -------------------------------------------------------------------------------

    def _begin(self, values: Sequence[Value], moving: bool) -> list[Value]:
        """Initial values of a loop as `enter` takes them, made ahead of its region: what is loaded inside it is not
        there yet where it begins."""
        return [whole(self.m, v) if v.shape and moving else entries(self.m, v) for v in values]

    def enter(self, values: Sequence[Value], moving: bool) -> tuple[list[Value], list[Node]]:
        """Parameters of the region just opened for carried values, and the nodes of their initial values."""
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
        """The result nodes of a region."""
        out: list[Node] = []
        for value in values:
            if value.shape and moving:
                out.append(whole(self.m, value).node)
            else:
                out.extend(entries(self.m, value).reshape(-1).tolist())
        return out

    def _results(self, node: Node, values: Sequence[Value], moving: bool, nodes: Sequence[Node]) -> list[Value]:
        """The results of a loop or branch, shaped as `values`."""
        numbered = iter(enumerate(nodes))

        def get() -> Node:
            k, like = next(numbered)
            return self.graph.make("get", (node,), like.dtype, k, like.size)

        return [Memory(get(), v.shape) if v.shape and moving else array_of(v.shape, lambda _: get()) for v in values]

    def _while(self, equation: Any, args: list[Value], *, cond_jaxpr: Any, body_jaxpr: Any, **_: Any) -> list[Value]:
        of_test, of_body = while_parts(equation)
        test_consts, body_consts, init = args[:of_test], args[of_test : of_test + of_body], args[of_test + of_body :]
        moving = moves(body_jaxpr.jaxpr) or moves(cond_jaxpr.jaxpr) or _large(init)
        init = self._begin(init, moving)
        region = self.graph.open()
        inside, begin = self.enter(init, moving)
        test = self.graph.open()
        test.results = [self.closed(cond_jaxpr, [*test_consts, *inside])[0].item()]  # pyrefly: ignore[missing-attribute]
        self.graph.close()
        region.results = self.leave(self.closed(body_jaxpr, [*body_consts, *inside]), moving)
        self.graph.close()
        node = self.graph.make("while", tuple(begin), F64, (test, region))
        return self._results(node, init, moving, region.params)

    def _scan(
        self, equation: Any, args: list[Value], *, jaxpr: ClosedJaxpr, length: int, reverse: bool, **_: Any
    ) -> list[Value]:
        num_consts, num_carry = scan_parts(equation)
        consts, init, xs = args[:num_consts], args[num_consts : num_consts + num_carry], args[num_consts + num_carry :]
        rows = [v.aval for v in jaxpr.jaxpr.outvars[num_carry:]]
        if length == 0:
            raise NativeUnsupported("an inner scan of length 0")
        ys = [array_of((length, *a.shape), lambda _, a=a: self.graph.const(0, dtype_of(a.dtype))) for a in rows]
        moving = moves(jaxpr.jaxpr) or _large(init)
        xs = [in_memory(self.m, x) for x in xs]
        init = self._begin(init, moving)
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
        """Row k of an array in memory."""
        size = int(np.prod(memory.shape[1:]))
        start = self.m.mul(self.m.convert(k, I32), self.m.integer(size, I32))
        shape = memory.shape[1:]
        return array_of(
            shape, lambda index: load(self.m, memory, start, int(np.ravel_multi_index(index, shape)) if shape else 0)
        )

    def _with_row(self, memory: Memory, k: Node, row: Value) -> Memory:
        """The array with row k replaced."""
        flat = entries(self.m, row).reshape(-1)
        allowed = self.graph.const(True, BOOL)
        for i, node in enumerate(flat):
            place = self.m.add(
                self.m.mul(self.m.convert(k, I32), self.m.integer(len(flat), I32)), self.m.integer(i, I32)
            )
            memory = store(self.m, memory, place, node, allowed)
        return memory

    def _cond(self, equation: Any, args: list[Value], *, branches: Sequence[ClosedJaxpr], **_: Any) -> list[Value]:
        index, operands = args[0].item(), args[1:]  # pyrefly: ignore[missing-attribute]
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


def moves(jaxpr: Any) -> bool:
    """Whether arrays are indexed at run time anywhere in a jaxpr."""
    jaxpr = getattr(jaxpr, "jaxpr", jaxpr)
    if any(equation.primitive.name in _MOVES for equation in jaxpr.eqns):
        return True
    given = [p for equation in jaxpr.eqns for p in (*equation.params.values(), expanded(equation))]
    inner = [one for p in given for one in (p if isinstance(p, tuple | list) else (p,))]
    return any(moves(one) for one in inner if hasattr(one, "eqns") or hasattr(one, "jaxpr"))


def _large(values: Sequence[Value]) -> bool:
    """Whether values have too many entries for registers."""
    return sum(int(np.prod(v.shape)) for v in values) > 64


__all__ = ["Tracer", "moves"]
