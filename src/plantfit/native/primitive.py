"""The jax primitive behind `native_scan`: abstract evaluation, batching, lowering to an FFI call.

Operands have the axes of the enclosing `vmap`s in front, outermost first, without those that they do not vary over;
`present` holds a flag per operand and axis.
"""

import ctypes
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.compile.compilation import address_of, kept_address, key_of
from plantfit.native.compile.processor import host
from plantfit.native.emit.kernel import Program, Shape, count_nodes, make_kernel
from plantfit.native.layout import Layout, choose_layout
from plantfit.native.unsupported import NativeUnsupported

# isort: split
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir


@dataclass(frozen=True, eq=False)
class Loop:
    """A traced loop: its program, the jaxpr of its body, and the shapes of its results."""

    program: Program
    jaxpr: Any
    results: tuple[tuple[tuple[int, ...], np.dtype], ...]  # of the carry, then of a row of ys
    constants: int
    carry: int
    steps: int
    reverse: bool
    ragged: bool  # whether a last operand tells how many of the steps are used
    vectors: int  # of a block, at most

    def out_shapes(self) -> list[tuple[tuple[int, ...], np.dtype]]:
        """Of one lane: carry leaves, then ys with their leading axis of steps."""
        return [(s if i < self.carry else (self.steps, *s), d) for i, (s, d) in enumerate(self.results)]


Flags = tuple[bool, ...]

loop_p = Primitive("native_scan")
loop_p.multiple_results = True


@loop_p.def_abstract_eval
def _abstract(*operands: Any, loop: Loop, batch: tuple[int, ...], present: tuple[Flags, ...]) -> list[Any]:
    return [ShapedArray((*batch, *shape), dtype) for shape, dtype in loop.out_shapes()]


def _run(*operands: Any, loop: Loop, batch: tuple[int, ...], present: tuple[Flags, ...]) -> list[Any]:
    """Arrange the operands in the layout, call the kernel, restore the results."""
    here = host()
    kinds = _core_kinds(loop)
    ends, place = (operands[-1], present[-1]) if loop.ragged else (None, ())
    operands, present = operands[: len(kinds)], present[: len(kinds)]
    program = loop.program

    def nodes(layout: Layout) -> tuple[int, int]:
        return count_nodes(program, [layout.over_lanes(p) for p in present])

    layout = choose_layout(
        batch, present, [r for _, r in kinds], here.width, loop.vectors, nodes, place, len(program.ys)
    )
    varies = tuple((layout.over_groups(p), layout.over_lanes(p)) for p in present)
    shape = Shape(here.width, layout.vectors, layout.narrow, loop.reverse, loop.ragged, varies)
    name = _registered(program, shape)
    sizes = jnp.asarray(np.array([loop.steps, layout.groups, layout.lanes]))
    if ends is not None:
        ends = jnp.clip(layout.arrange(ends, place, False).reshape(-1), 0, loop.steps)
        sizes = jnp.concatenate([sizes, jnp.broadcast_to(ends, (layout.groups,))])
    arranged = [layout.arrange(a, p, rows) for a, p, (_, rows) in zip(operands, present, kinds, strict=True)]
    outs = loop.out_shapes()
    rows_out = [i >= loop.carry for i in range(len(outs))]
    called = jax.ffi.ffi_call(name, [layout.buffer(s, d, rows) for (s, d), rows in zip(outs, rows_out, strict=True)])
    raw = called(sizes, *arranged)
    return [layout.restore(a, len(s), rows) for a, (s, _), rows in zip(raw, outs, rows_out, strict=True)]


def _run_or_scan(*operands: Any, **params: Any) -> list[Any]:
    """Native code, or lax.scan when arrays that vary over this batch exceed the stack."""
    try:
        return _run(*operands, **params)
    except NativeUnsupported:
        return _scan(*operands, **params)


def _scan(*operands: Any, loop: Loop, batch: tuple[int, ...], present: tuple[Flags, ...]) -> list[Any]:
    """The same loop as lax.scan."""

    def one(*given: Any) -> list[Any]:
        consts, carry = given[: loop.constants], given[loop.constants : loop.constants + loop.carry]
        function = jaxpr_as_fun(ClosedJaxpr(loop.jaxpr, consts))

        def body(c: Any, x: Any) -> tuple[list[Any], list[Any]]:
            out = function(*c, *x)
            return out[: loop.carry], out[loop.carry :]

        rows, used = (
            list(given[loop.constants + loop.carry : len(given) - loop.ragged]),
            given[-1] if loop.ragged else None,
        )
        after, ys = scan_used(body, list(carry), rows, loop.steps, loop.reverse, used)
        return [*after, *ys]

    run: Any = one
    for axis in reversed(range(len(batch))):
        run = jax.vmap(run, in_axes=tuple(0 if p[axis] else None for p in present), axis_size=batch[axis])
    return run(*operands)


def scan_used(body: Callable, carry: Any, rows: Any, steps: int | None, reverse: bool, used: Any) -> tuple[Any, Any]:
    """jax.lax.scan in which steps from `used` on, unless it is None, leave the carry as it is."""
    if used is None:
        return jax.lax.scan(body, carry, rows, length=steps, reverse=reverse)

    def held(c: Any, x: Any) -> tuple[Any, Any]:
        k, row = x
        after, y = body(c, row)
        return jax.tree.map(lambda new, old: jnp.where(k < used, new, old), after, c), y

    steps = jax.tree.leaves(rows)[0].shape[0] if steps is None else steps
    return jax.lax.scan(held, carry, (jnp.arange(steps), rows), reverse=reverse)


def _core_kinds(loop: Loop) -> list[tuple[int, bool]]:
    """(entries, whether there is a row per step) of every operand."""
    program = loop.program
    return [(n, False) for _, n in (*program.constants, *program.carry)] + [(n, True) for _, n in program.rows]


def _registered(program: Program, shape: Shape) -> str:
    """The FFI target of a kernel, compiled and registered when it is new."""
    kernel = make_kernel(program, shape)
    key = key_of(kernel.text)
    name = f"{PREFIX}{key}"
    with _LOCK:
        if name not in _REGISTERED:
            jax.ffi.register_ffi_target(name, capsule(address_of(kernel.text, key, kernel.libm)), platform="cpu")
            _REGISTERED[name] = kernel.libm
    return name


def libm_of(name: str) -> tuple[str, ...]:
    """The functions of the C library that the kernel of an FFI target calls. Raises KeyError for a target that is
    not registered."""
    return _REGISTERED[name]


def register_kept(name: str, libm: tuple[str, ...]) -> bool:
    """Register the FFI target of a kernel from its object code on disk; whether it could be."""
    with _LOCK:
        if name not in _REGISTERED:
            address = kept_address(name.removeprefix(PREFIX), libm)
            if address is None:
                return False
            jax.ffi.register_ffi_target(name, capsule(address), platform="cpu")
            _REGISTERED[name] = libm
    return True


PREFIX = "plantfit_native_"
_LOCK = threading.Lock()
_REGISTERED: dict[str, tuple[str, ...]] = {}  # FFI targets of this process, and what each calls of the C library


def capsule(address: int) -> Any:
    """A function pointer as `register_ffi_target` takes it."""
    make = ctypes.pythonapi.PyCapsule_New
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    return make(address, b"xla._CUSTOM_CALL_TARGET", None)


def _batched(
    operands: Sequence[Any], dims: Sequence[Any], *, loop: Loop, batch: tuple[int, ...], present: tuple[Flags, ...]
) -> Any:
    """The batching rule: a new axis in front of the others."""
    size = next(a.shape[d] for a, d in zip(operands, dims, strict=True) if d is not None)
    moved = [a if d is None else jnp.moveaxis(a, d, 0) for a, d in zip(operands, dims, strict=True)]
    flags = tuple((d is not None, *p) for d, p in zip(dims, present, strict=True))
    out = loop_p.bind(*moved, loop=loop, batch=(size, *batch), present=flags)
    return out, [0] * len(out)


def _no_derivative(*_: Any, **__: Any) -> Any:
    raise NativeUnsupported("derivatives through native_scan; give the surrounding function a custom rule")


batching.primitive_batchers[loop_p] = _batched
ad.primitive_jvps[loop_p] = _no_derivative
mlir.register_lowering(loop_p, mlir.lower_fun(_scan, multiple_results=True))
mlir.register_lowering(loop_p, mlir.lower_fun(_run_or_scan, multiple_results=True), platform="cpu")


@loop_p.def_impl
def _apply(*operands: Any, **params: Any) -> list[Any]:
    return jax.jit(lambda *a: loop_p.bind(*a, **params))(*operands)


__all__ = ["Loop", "loop_p", "scan_used"]
