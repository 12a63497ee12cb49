"""The degree of every result of a traced function in the coordinates, by abstract interpretation of its jaxpr.

A number that a rule is not known for counts as nonlinear in all that it depends on. Entries of small arrays are told
apart, so that a parameter with a shape may hold a gain beside a time constant.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.trace.equation_parts import expanded, scan_parts, while_parts
from plantfit.problem.linear.degree import CONSTANT, Degree, added, bent, chosen, multiplied, summed

import jax
from jax.extend.core import Literal

# a Degree for all entries alike, an array (dtype object) of one for each entry, or an array of numbers that are known
Value = Any
SMALL = 512  # entries that are told apart


def degrees(function: Callable, placeholders: Sequence[Any]) -> Callable[..., list[Value]]:
    """The function traced once at arguments of the right shapes; called with values in their place it gives those of
    its results.

    Arguments and results are flat lists of the leaves.
    """
    traced = jax.make_jaxpr(function)(*placeholders)
    return lambda *values: _run(traced.jaxpr, traced.consts, values)


def of(value: Value) -> Degree:
    """One degree that holds for all entries."""
    if isinstance(value, Degree):
        return value
    return CONSTANT if value.dtype != object else summed(value.flat)


def _run(jaxpr: Any, consts: Sequence[Any], values: Sequence[Value]) -> list[Value]:
    known = {v: _constant(c) for v, c in zip(jaxpr.constvars, consts, strict=True)}
    known.update(zip(jaxpr.invars, values, strict=True))

    def read(atom: Any) -> Value:
        return np.asarray(atom.val) if isinstance(atom, Literal) else known[atom]

    for equation in jaxpr.eqns:
        known.update(zip(equation.outvars, _applied(equation, [read(v) for v in equation.invars]), strict=True))
    return [read(v) for v in jaxpr.outvars]


def _constant(number: Any) -> Value:
    plain = np.size(number) <= SMALL and jax.numpy.result_type(number).kind in "biuf"
    return np.asarray(number) if plain else CONSTANT


def _applied(equation: Any, given: list[Value]) -> list[Value]:
    name, out = equation.primitive.name, equation.outvars
    if name in NESTED:
        inner = next((equation.params[k] for k in ("jaxpr", "call_jaxpr", "fun_jaxpr") if k in equation.params), None)
        if inner is not None and len(_open(inner)[0].invars) == len(given):
            return _run(*_open(inner), given)
    elif (plain := expanded(equation)) is not None:
        return _run(plain.jaxpr, plain.consts, given)
    elif name in CONTROL:
        return CONTROL[name](equation, given)
    elif _all_known(given) and name in ARITHMETIC:
        return [np.asarray(ARITHMETIC[name](equation.params, *given))]
    elif name in MOVES:
        return _moved(equation, given)
    elif name in RULES:
        return [RULES[name](equation, given)] * len(out)
    elif name in APART:
        return given
    return [bent(*map(of, given))] * len(out)


def _open(jaxpr: Any) -> tuple[Any, Sequence[Any]]:
    """A jaxpr and its constants."""
    return (jaxpr.jaxpr, jaxpr.consts) if hasattr(jaxpr, "consts") and hasattr(jaxpr, "jaxpr") else (jaxpr, ())


def _all_known(given: list[Value]) -> bool:
    return all(not isinstance(v, Degree) and v.dtype != object for v in given)


# -- arithmetic -------------------------------------------------------------------------------------


def _entrywise(combined: Callable[..., Degree]) -> Callable[[Any, list[Value]], Value]:
    """A rule for functions of entries at the same place."""

    def rule(equation: Any, given: list[Value]) -> Value:
        shape = equation.outvars[0].aval.shape
        if not shape or not any(_apart(v) for v in given):
            return combined(*map(of, given))
        return _table(combined, [np.broadcast_to(_entries(v, shape), shape) for v in given])

    return rule


def _table(combined: Callable[..., Degree], arrays: list[np.ndarray]) -> np.ndarray:
    found = np.empty(arrays[0].shape, dtype=object)
    for place in np.ndindex(found.shape):
        found[place] = combined(*(a[place] for a in arrays))
    return found


def _apart(value: Value) -> bool:
    return not isinstance(value, Degree) and value.dtype == object


def _entries(value: Value, shape: tuple[int, ...]) -> np.ndarray:
    if _apart(value):
        return value
    filled = np.empty(shape, dtype=object)
    same = of(value)
    for place in np.ndindex(filled.shape):
        filled[place] = same
    return filled


def _multiplied(equation: Any, given: list[Value]) -> Value:
    if any(not isinstance(v, Degree) and v.dtype != object and not np.any(v) for v in given):
        return CONSTANT  # what is held at zero takes its factor along
    return _entrywise(multiplied)(equation, given)


def _divided(a: Degree, b: Degree) -> Degree:
    return multiplied(a, bent(b))


def _sum(equation: Any, given: list[Value]) -> Value:
    return summed(map(of, given))


def _to_type(equation: Any, given: list[Value]) -> Value:
    kept = equation.params["new_dtype"] == np.float64
    return (_entrywise(lambda a: a) if kept else _entrywise(bent))(equation, given)


def _power(equation: Any, given: list[Value]) -> Value:
    n = equation.params["y"]
    if n == 1:
        return given[0]
    return CONSTANT if n == 0 else _entrywise(bent)(equation, given)


def _polynomial(x: Degree, *coefficients: Degree) -> Degree:
    """Of coefficients from the lowest power on, by Horner's rule."""
    value = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = added(multiplied(value, x), c)
    return value


def _dot(equation: Any, given: list[Value]) -> Value:
    return multiplied(*map(of, given))


def _scatter(equation: Any, given: list[Value]) -> Value:
    operand, index, updates = given
    return chosen(of(index), (of(operand), of(updates)))


def _update_slice(equation: Any, given: list[Value]) -> Value:
    operand, update, *index = given
    return chosen(summed(map(of, index)), (of(operand), of(update)))


RULES: dict[str, Callable[[Any, list[Value]], Value]] = {
    **dict.fromkeys(("add", "sub", "add_any"), _entrywise(added)),
    **dict.fromkeys(("neg", "copy", "copy_p", "device_put", "real"), _entrywise(lambda a: a)),
    **dict.fromkeys(("reduce_sum", "cumsum", "reduce_window_sum", "pad"), _sum),
    "mul": _multiplied,
    "div": _entrywise(_divided),
    "select_n": _entrywise(lambda by, *among: chosen(by, among)),
    "convert_element_type": _to_type,
    "integer_pow": _power,
    "dot_general": _dot,
    **dict.fromkeys(("scatter", "scatter-add", "scatter_add"), _scatter),
    "dynamic_update_slice": _update_slice,
    "polynomial": _entrywise(_polynomial),
    "iota": lambda equation, given: CONSTANT,
}
APART = ("optimization_barrier",)  # every result is the operand at its place

# numbers that indices are made of
ARITHMETIC: dict[str, Callable[..., Any]] = {
    name: lambda params, *a, f=f: f(*a)
    for name, f in {
        "add": operator.add, "sub": operator.sub, "mul": operator.mul, "neg": operator.neg, "lt": operator.lt,
        "le": operator.le,
        "gt": operator.gt, "ge": operator.ge, "eq": operator.eq, "ne": operator.ne, "min": np.minimum,
        "max": np.maximum,
        "clamp": lambda low, x, high: np.clip(x, low, high), "select_n": lambda by,
        *among: np.choose(by.astype(int), among),
    }.items()
}  # fmt: skip
ARITHMETIC["convert_element_type"] = lambda params, a: a.astype(params["new_dtype"])


# -- entries that move ------------------------------------------------------------------------------


def _broadcast(params: Any, a: np.ndarray, *_: Any) -> Any:
    spread = np.ones(len(params["shape"]), dtype=int)
    spread[list(params["broadcast_dimensions"])] = a.shape
    return np.broadcast_to(a.reshape(spread), params["shape"])


def _slice(params: Any, a: np.ndarray) -> np.ndarray:
    strides = params["strides"] or (1,) * a.ndim
    return a[tuple(slice(*s) for s in zip(params["start_indices"], params["limit_indices"], strides, strict=True))]


def _dynamic_slice(params: Any, a: np.ndarray, *start: np.ndarray) -> np.ndarray | None:
    if not _all_known(list(start)):
        return None
    first = [int(np.clip(s, 0, n - k)) for s, n, k in zip(start, a.shape, params["slice_sizes"], strict=True)]
    return a[tuple(slice(s, s + k) for s, k in zip(first, params["slice_sizes"], strict=True))]


def _split(params: Any, a: np.ndarray) -> list[np.ndarray]:
    return np.split(a, np.cumsum(params["sizes"])[:-1], axis=params["axis"])


def _gather(params: Any, a: np.ndarray, index: np.ndarray) -> np.ndarray | None:
    """Rows of a vector at known places."""
    numbers = params["dimension_numbers"]
    plain = (
        a.ndim == 1
        and numbers.collapsed_slice_dims == (0,)
        and numbers.start_index_map == (0,)
        and not numbers.offset_dims
    )
    if not plain or not _all_known([index]) or np.any(index < 0) or np.any(index >= len(a)):
        return None
    return a[index[..., 0]]


MOVES: dict[str, Callable[..., Any]] = {
    "reshape": lambda params, a: a.reshape(params["new_sizes"]),
    "squeeze": lambda params, a: a.reshape([n for i, n in enumerate(a.shape) if i not in params["dimensions"]]),
    "transpose": lambda params, a: a.transpose(params["permutation"]),
    "rev": lambda params, a: np.flip(a, params["dimensions"]),
    "concatenate": lambda params, *a: np.concatenate(a, axis=params["dimension"]),
    "stack": lambda params, *a: np.stack(a, axis=params["axis"]),
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "dynamic_slice": _dynamic_slice,
    "gather": _gather,
    "split": _split,
}
MOVED = {"dynamic_slice": 1, "gather": 1}  # operands that are no index


def _moved(equation: Any, given: list[Value]) -> list[Value]:
    """Entry by entry where arrays are small and indices known."""
    name, out, avals = equation.primitive.name, equation.outvars, [v.aval for v in equation.invars]
    operands, index = given[: MOVED.get(name, len(given))], given[MOVED.get(name, len(given)) :]
    if all(a.size <= SMALL for a in (*avals[: len(operands)], *(v.aval for v in out))):
        known = _all_known(operands)
        apart = operands if known else [_entries(v, a.shape) for v, a in zip(operands, avals, strict=False)]
        moved = MOVES[name](equation.params, *apart, *index)
        if moved is not None:
            return moved if isinstance(moved, list) else [moved]
    return [chosen(summed(map(of, index)), map(of, operands))] * len(out)


# -- nested programs --------------------------------------------------------------------------------

NESTED = (
    "pjit",
    "jit",
    "closed_call",
    "core_call",
    "remat",
    "remat2",
    "checkpoint",
    "custom_jvp_call",
    "custom_vjp_call",
)
NESTED = (*NESTED, "custom_vjp_call_jaxpr")


def _settled(step: Callable[[list[Degree]], list[Degree]], begin: list[Degree]) -> list[Degree]:
    """What is carried, after any number of steps."""
    carried = begin
    while True:
        after = [added(a, b) for a, b in zip(carried, step(carried), strict=True)]
        if after == carried:
            return carried
        carried = after


def _scan(equation: Any, given: list[Value]) -> list[Value]:
    consts, carry = scan_parts(equation)
    body, fixed = _open(equation.params["jaxpr"]), given[:consts]
    rows = [of(v) for v in given[consts + carry :]]
    # a constant that is known stays known, but rows of it are not one number
    carried = _settled(
        lambda c: list(map(of, _run(*body, [*fixed, *c, *rows])))[:carry], list(map(of, given[consts : consts + carry]))
    )
    return [*carried, *map(of, _run(*body, [*fixed, *carried, *rows])[carry:])]


def _while(equation: Any, given: list[Value]) -> list[Value]:
    of_test, of_body = while_parts(equation)
    first, fixed, begin = given[:of_test], given[of_test : of_test + of_body], given[of_test + of_body :]
    body, condition = _open(equation.params["body_jaxpr"]), _open(equation.params["cond_jaxpr"])

    def step(carried: list[Degree]) -> list[Degree]:
        going_on = of(_run(*condition, [*first, *carried])[0])
        return [chosen(going_on, [of(v)]) for v in _run(*body, [*fixed, *carried])]

    return _settled(step, list(map(of, begin)))


def _cond(equation: Any, given: list[Value]) -> list[Value]:
    found = [_run(*_open(b), given[1:]) for b in equation.params["branches"]]
    return [chosen(of(given[0]), map(of, results)) for results in zip(*found, strict=True)]


CONTROL: dict[str, Callable[[Any, list[Value]], list[Value]]] = {"scan": _scan, "while": _while, "cond": _cond}
