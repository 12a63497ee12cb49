"""Which arguments of a function each of its results depends on, read from its traced program."""

from collections.abc import Callable
from typing import Any

import plantfit.runtime  # noqa: F401

import jax
from jax.extend.core import Var

CONTROL_FLOW = ("scan", "while", "cond")  # taken as a whole: every result by every argument


def dependencies(function: Callable, *arguments: Any) -> list[set[int]]:
    """For every leaf of the result the positions of the leaves of the arguments that it depends on.

    Holds for all values at once: a term that vanishes only for some values still counts.
    """
    jaxpr = jax.make_jaxpr(function)(*arguments).jaxpr
    return _followed(jaxpr, [{i} for i in range(len(jaxpr.invars))])


def _followed(jaxpr: Any, given: list[set[int]]) -> list[set[int]]:
    sources = dict(zip(jaxpr.invars, given, strict=True))

    def read(atom: Any) -> set[int]:
        return sources.get(atom, set()) if isinstance(atom, Var) else set()

    for equation in jaxpr.eqns:
        inner = equation.params.get("jaxpr") or equation.params.get("call_jaxpr")
        inner = getattr(inner, "jaxpr", inner)
        entering = [read(v) for v in equation.invars]
        if inner is None or len(inner.invars) != len(entering) or equation.primitive.name in CONTROL_FLOW:
            found = [set().union(*entering)] * len(equation.outvars)
        else:
            found = _followed(inner, entering)
        sources.update(zip(equation.outvars, found, strict=True))
    return [read(v) for v in jaxpr.outvars]
