"""A model's functions as Python on floats: a solver that asks for one value at a time waits ten times as long for a
compiled program.

It is arithmetic of its own besides: neither XLA nor the native loops, which simulations run on, take part in it.
"""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.simulate.check.array_lines import ArrayWriter, Held
from plantfit.simulate.steps.vector import VectorModel, placeholders
from plantfit.simulate.straight_line import LANGUAGES, Lines

import jax

Rate = Callable[[np.ndarray, float], list[float]]

_TEXT = """
def made(p, start, a, b):
{given}
    def rate(x, t):
{states}        since = t - start
{lines}        found = [{results}]
        if not math.isfinite(total := {total}):
            raise ValueError(f"the states and their rates add up to {{total}}")
        return found

    return rate
"""


def plain_rate(vector: VectorModel, values: Sequence[Any]) -> Callable[[float, np.ndarray, np.ndarray], Rate] | None:
    """`made(start, a, b)` for a model with parameters `values`: the rate (x (n,), t) with channels a + b*(t - start),
    (m,) each.

    The rate raises ValueError or ArithmeticError where something is not finite or math has no number. None for a model
    with operations that have no such form.
    """
    made = _written(vector)
    if made is None:
        return None
    p = floats(values)
    return lambda start, a, b: made(p, float(start), a.tolist(), b.tolist())


@lru_cache(maxsize=32)
def _written(vector: VectorModel) -> Callable | None:
    sizes = {"x": len(vector.states), "u": len(vector.channels), "p": len(vector.parameters)}
    names = {letter: [f"{letter}{i}" for i in range(size)] for letter, size in sizes.items()}
    lines = _lines(vector.model.name, vector.rate, placeholders(vector.model), list(names.values()))
    if lines is None:
        return None
    used = set(re.findall(r"\b[up]\d+\b", lines.text("") + " ".join(lines.results)))
    given = [f"    {n} = p[{i}]" for i, n in enumerate(names["p"]) if n in used]
    channels = [(i, n) for i, n in enumerate(names["u"]) if n in used]
    given += [f"    a{i}, b{i} = a[{i}], b[{i}]" for i, _ in channels]
    states = f"        {', '.join(names['x'])}, = x.tolist()\n"
    text = _TEXT.format(
        given="\n".join(given),
        states=states,
        lines="".join(f"        {n} = a{i} + b{i}*since\n" for i, n in channels) + lines.text("        "),
        results=", ".join(lines.results),
        total=" + ".join([*names["x"], *(f"found[{i}]" for i in range(sizes["x"]))]),
    )
    return _defined(text, "made")


_FUNCTION = """
def called({groups}):
{given}{lines}    found = [{results}]
    if not math.isfinite(total := sum(map(sum, found))):
        raise ValueError(f"the results add up to {{total}}")
    return found
"""


def on_floats(
    model: str, function: Callable[..., Any], given: Sequence[Sequence[Any]]
) -> Callable[..., list[list[float]]] | None:
    """`function` of tuples of numbers, shaped as those of `given`, with a tuple of tuples as result: lists in, a list
    of lists out.

    It raises as `plain_rate` does. None for a function with operations that have no such form.
    """
    names = [[f"{letter}{i}" for i in range(len(part))] for letter, part in zip("abcdefgh", given, strict=False)]
    lines = _lines(model, function, given, names)
    if lines is None:
        return None
    groups = [f"group{k}" for k in range(len(given))]
    sizes = [len(part) for part in jax.eval_shape(function, *given)]
    ends = np.cumsum([0, *sizes])
    text = _FUNCTION.format(
        groups=", ".join(groups),
        given="".join(f"    {', '.join(own)}, = {group}\n" for own, group in zip(names, groups, strict=True) if own),
        lines=lines.text("    "),
        results=", ".join(f"[{', '.join(lines.results[first:last])}]" for first, last in pairwise(ends)),
    )
    return _defined(text, "called")


def floats(values: Sequence[Any]) -> list[Any]:
    """Parameters as these functions take them: an array is one flat tuple."""
    return [tuple(np.ravel(v).tolist()) if np.ndim(v) else float(v) for v in values]


def _defined(text: str, name: str) -> Callable:
    space: dict[str, Any] = {}
    exec("import math\n" + text, space)
    return space[name]


def _lines(
    model: str, function: Callable[..., Any], given: Sequence[Sequence[Any]], names: Sequence[Sequence[str]]
) -> Lines | None:
    """Assignments and results of a function of tuples; None where something has no expression."""
    closed = jax.make_jaxpr(function)(*map(tuple, given))
    writer, inputs = ArrayWriter(model, "math", LANGUAGES["math"]), []
    for name, value in zip((n for part in names for n in part), (v for part in given for v in part), strict=True):
        shape = np.shape(value)
        entries = np.array([f"{name}[{k}]" for k in range(int(np.prod(shape)))], dtype=object).reshape(shape)
        inputs.append(Held(entries, name) if shape else name)
    try:
        results = writer.write(closed.jaxpr, [writer.number(c) for c in closed.consts], inputs)
    except ModelError:
        return None
    return Lines(tuple(writer.assignments), tuple(results))


__all__ = ["floats", "on_floats", "plain_rate"]
