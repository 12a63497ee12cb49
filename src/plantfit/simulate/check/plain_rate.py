"""A model's rate as Python on floats: a solver that asks for one value at a time waits ten times as long for a compiled program.

It is arithmetic of its own besides: neither XLA nor the native loops, which simulations run on, take part in it.
"""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
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
    """`made(start, a, b)` for a model with parameters `values`: the rate (x (n,), t) with channels a + b*(t - start), (m,) each.

    The rate raises ValueError or ArithmeticError where something is not finite or math has no number. None for a model with operations
    that have no such form.
    """
    made = _written(vector)
    if made is None:
        return None
    p = [tuple(np.ravel(v).tolist()) if np.ndim(v) else float(v) for v in values]
    return lambda start, a, b: made(p, float(start), a.tolist(), b.tolist())


@lru_cache(maxsize=32)
def _written(vector: VectorModel) -> Callable | None:
    sizes = {"x": len(vector.states), "u": len(vector.channels), "p": len(vector.parameters)}
    names = {letter: [f"{letter}{i}" for i in range(size)] for letter, size in sizes.items()}
    try:
        lines = _lines(vector, names)
    except ModelError:
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
    space: dict[str, Any] = {}
    exec("import math\n" + text, space)
    return space["made"]


def _lines(vector: VectorModel, names: dict[str, list[str]]) -> Lines:
    """Assignments and results of the rate; raises ModelError for what has no expression."""
    given = placeholders(vector.model)
    closed = jax.make_jaxpr(vector.rate)(*given)
    writer = ArrayWriter(vector.model.name, "math", LANGUAGES["math"])
    inputs: list[Any] = [*names["x"], *names["u"]]
    for name, value in zip(names["p"], given[2], strict=True):
        shape = np.shape(value)
        entries = np.array([f"{name}[{k}]" for k in range(int(np.prod(shape)))], dtype=object).reshape(shape)
        inputs.append(Held(entries, name) if shape else name)
    results = writer.write(closed.jaxpr, [writer.number(c) for c in closed.consts], inputs)
    return Lines(tuple(writer.assignments), tuple(results))


__all__ = ["plain_rate"]
