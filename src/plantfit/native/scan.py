"""`native_scan`: jax.lax.scan over numbers and small arrays as SIMD code over the batch."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.folders import said_once
from plantfit.native.compile.compilation import find_libm
from plantfit.native.compile.interface import refusal
from plantfit.native.compile.processor import available, host
from plantfit.native.emit.kernel import Program, Shape, make_kernel
from plantfit.native.graph.nodes import Graph, Node
from plantfit.native.graph.values import LARGEST, Memory, Value, array_of, dtype_of
from plantfit.native.passes.passes import run_passes
from plantfit.native.primitive import Loop, loop_p, scan_used
from plantfit.native.trace.jaxpr import Tracer, moves
from plantfit.native.unsupported import NativeUnsupported, StackExceeded

# isort: split
import jax
import jax.numpy as jnp


def native_scan(
    body: Callable[[Any, Any], tuple[Any, Any]],
    carry: Any,
    xs: Any,
    *,
    length: int | None = None,
    keep: bool = False,
    reverse: bool = False,
    fallback: bool = False,
    used: Any = None,
) -> tuple[Any, Any]:
    """`jax.lax.scan(body, carry, xs)` as one native loop; `(carry, ys)`, with ys None unless `keep`.

    `carry` is a pytree of numbers and small arrays, `xs` one whose leaves have a leading axis of K steps (or None, with
    `length`). `body(carry, x) -> (carry, y)` may close over anything. Under `jax.vmap`, nested too, lanes of the
    processor's vectors run over the batch; a lane gives the same bits whatever the size of the batch. float64, bool,
    int32, int64 and uint32.

    Steps from `used` on, a whole number, are left out; their ys hold anything. It may differ between lanes of outer
    `vmap`s, which are then worked off one after the other.

    Products that feed sums become fused multiply-adds and divisions by one number share its reciprocal, so results
    agree with lax.scan to rounding. There are no derivatives: use it inside custom rules.

    Raises NativeUnsupported when the body uses something without a native form or llvmlite is missing; with `fallback`
    it then runs as lax.scan.
    """
    carry, xs = jax.tree.map(jnp.asarray, carry), jax.tree.map(jnp.asarray, xs)
    try:
        if not available():
            raise NativeUnsupported("native code without llvmlite")
        if (reason := refusal()) is not None:
            said_once(reason)
            raise NativeUnsupported("native code with this jaxlib")
        return _bound(body, carry, xs, length, keep, reverse, used)
    except NativeUnsupported:
        if not fallback:
            raise
        plain = body if keep else lambda c, x: (body(c, x)[0], None)
        return scan_used(plain, carry, xs, length, reverse, used)


def supported(body: Callable, carry: Any, xs: Any, *, length: int | None = None, keep: bool = False) -> bool:
    """Whether `native_scan` can run this loop natively here; arguments may be shapes (jax.ShapeDtypeStruct)."""
    scan = partial(native_scan, body, length=length, keep=keep)
    try:
        jax.eval_shape(scan, carry, xs)
    except NativeUnsupported:
        return False
    return True


def _bound(
    body: Callable, carry: Any, xs: Any, length: int | None, keep: bool, reverse: bool, used: Any
) -> tuple[Any, Any]:
    leaves, tree = jax.tree.flatten(carry)
    rows, rows_tree = jax.tree.flatten(xs)
    steps = _length(rows, length)
    shapes = jax.tree.unflatten(rows_tree, [jax.ShapeDtypeStruct(r.shape[1:], r.dtype) for r in rows])
    closed, (out_carry, out_y) = jax.make_jaxpr(lambda c, x: _checked(body(c, x), keep), return_shape=True)(
        carry, shapes
    )
    after, after_tree = jax.tree.flatten(out_carry)
    if after_tree != tree or [(a.shape, a.dtype) for a in after] != [(a.shape, a.dtype) for a in leaves]:
        raise TypeError(
            f"The body of native_scan turned a carry of {jax.tree.map(_brief, carry)} into "
            f"{jax.tree.map(_brief, out_carry)}."
        )
    _, y_tree = jax.tree.flatten(out_y)
    consts = [jnp.asarray(c) for c in closed.consts]
    loop = _loop(closed.jaxpr, consts, leaves, rows, steps, reverse, used is not None)
    operands = [*consts, *leaves, *rows, *([] if used is None else [jnp.asarray(used, dtype=jnp.int64)])]
    out = loop_p.bind(*operands, loop=loop, batch=(), present=((),) * len(operands))
    return jax.tree.unflatten(tree, out[: len(leaves)]), jax.tree.unflatten(y_tree, out[len(leaves) :])


def _brief(a: Any) -> str:
    return f"{a.dtype}{list(a.shape)}"


def _checked(result: tuple[Any, Any], keep: bool) -> tuple[Any, Any]:
    carry, y = result
    return jax.tree.map(jnp.asarray, carry), jax.tree.map(jnp.asarray, y) if keep else None


def _length(rows: Sequence[Any], length: int | None) -> int:
    lengths = {r.shape[0] for r in rows} | ({length} if length is not None else set())
    if len(lengths) != 1:
        raise ValueError(
            f"native_scan got steps of lengths {sorted(lengths)}; "
            "give leaves of xs with one leading length, or `length`."
        )
    return lengths.pop()


def _loop(
    jaxpr: Any,
    consts: Sequence[Any],
    leaves: Sequence[Any],
    rows: Sequence[Any],
    steps: int,
    reverse: bool,
    ragged: bool,
) -> Loop:
    """Trace the body and run the passes; raises NativeUnsupported."""
    graph = Graph()
    tracer = Tracer(graph)
    moving = moves(jaxpr) or sum(a.size for a in leaves) > 64
    given = [_loaded(graph, "cload", i, c.shape, dtype_of(c.dtype)) for i, c in enumerate(consts)]
    region = graph.open()
    carried = [_carried(graph, a.shape, dtype_of(a.dtype), moving) for a in leaves]
    row = [_loaded(graph, "xload", i, r.shape[1:], dtype_of(r.dtype)) for i, r in enumerate(rows)]
    out = tracer.dense(tracer.run(jaxpr, given, [*carried, *row]))
    count = len(leaves)
    region.results = [*tracer.leave(out[:count], moving), *tracer.leave(out[count:], False)]
    graph.close()
    run_passes([graph.prologue, region], contract=host().fused)
    avals = [v.aval for v in jaxpr.outvars[count:]]
    program = Program(
        graph.prologue,
        region,
        _kinds(consts, 0),
        _kinds(leaves, 0),
        _kinds(rows, 1),
        tuple(bool(a.shape) and moving for a in leaves),
        _kinds(avals, 0),
    )
    vectors = _most_vectors(program)
    shapes = tuple((tuple(a.shape), np.dtype(a.dtype)) for a in (*leaves, *avals))
    return Loop(program, jaxpr, shapes, len(consts), count, steps, reverse, ragged, vectors)


def _most_vectors(program: Program) -> int:
    """Of the largest block whose arrays fit into the stack. Blocks are emitted here, so that NativeUnsupported is
    raised while tracing and not while lowering."""
    here = host()
    varies = [size <= LARGEST for _, size in program.constants] + [True] * (len(program.carry) + len(program.rows))
    for vectors in range(here.vectors, 0, -1):
        try:
            find_libm(
                make_kernel(
                    program, Shape(here.width, vectors, False, False, False, tuple((v, v) for v in varies))
                ).libm
            )
        except StackExceeded:
            if vectors == 1:
                raise
        else:
            return vectors
    raise NativeUnsupported("a processor without vectors")


def _kinds(values: Sequence[Any], skip: int) -> tuple[tuple[str, int], ...]:
    """(type, entries) of every leaf without its first `skip` axes."""
    return tuple((dtype_of(v.dtype), int(np.prod(v.shape[skip:]))) for v in values)


def _loaded(graph: Graph, op: str, leaf: int, shape: tuple[int, ...], dtype: str) -> Value:
    """An input as nodes that load its entries, a large constant as memory."""
    size = int(np.prod(shape))
    if op == "cload" and size > LARGEST:
        return Memory(graph.make("constant", (), dtype, leaf, size=size), shape)

    def entry(index: tuple[int, ...]) -> Node:
        return graph.make(op, (), dtype, (leaf, int(np.ravel_multi_index(index, shape)) if shape else 0))

    return array_of(shape, entry)


def _carried(graph: Graph, shape: tuple[int, ...], dtype: str, moving: bool) -> Value:
    """A leaf of the carry as parameters of the body; in memory when arrays are indexed at run time (`moving`)."""
    if shape and moving:
        return Memory(graph.param(dtype, int(np.prod(shape))), shape)
    return array_of(shape, lambda _: graph.param(dtype))
