"""A model's rate as Python on floats: a solver that asks for one value at a time waits ten times as long for a compiled program.

It is arithmetic of its own besides: neither XLA nor the native loops, which simulations run on, take part in it.
"""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.simulate.steps.vector import VectorModel
from plantfit.simulate.straight_line import straight_line

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

    The rate raises ValueError or ArithmeticError where something is not finite or math has no number. None for a model that reads
    arrays, as tables are.
    """
    text = _written(vector) if not any(np.ndim(v) for v in values) else None
    if text is None:
        return None
    p, made = [float(v) for v in values], text
    return lambda start, a, b: made(p, float(start), a.tolist(), b.tolist())


@lru_cache(maxsize=32)
def _written(vector: VectorModel) -> Callable | None:
    sizes = {"x": len(vector.states), "u": len(vector.channels), "p": len(vector.parameters)}
    names = {letter: [f"{letter}{i}" for i in range(size)] for letter, size in sizes.items()}
    try:
        lines = straight_line(vector, "rate", "math", list(names.values()))
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


__all__ = ["plain_rate"]
