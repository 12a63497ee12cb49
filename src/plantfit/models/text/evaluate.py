"""Expression trees to jax functions of named values."""

from collections.abc import Callable, Mapping
from typing import Any

from plantfit.models.text.expression import Node
from plantfit.models.text.functions import FUNCTIONS

# isort: split
import jax
import jax.numpy as jnp

Evaluate = Callable[[Mapping[str, Any]], Any]

_LARGEST_INTEGER_POWER = 64


def evaluator(node: Node, *, in_branch: bool = False) -> Evaluate:
    """A function from named values to the value of the expression.

    Inside a branch of a piecewise expression, division and powers are guarded: the branch that is
    not taken is computed as well, and its infinite derivative would make the whole gradient NaN.
    """
    if node.op == "number":
        return lambda _, number=node.number: number
    if node.op == "name":
        return lambda values, name=node.name: values[name]
    if node.op == "**" and (power := _integer_power(node, in_branch)) is not None:
        return power
    below_branch = in_branch or node.op == "where"
    args = tuple(evaluator(a, in_branch=below_branch) for a in node.args)
    if node.table is not None:
        return lambda values, table=node.table: table(values[table.name], *[a(values) for a in args])
    function = FUNCTIONS[node.op]
    apply = (function.guarded if in_branch else None) or function.evaluate
    return lambda values: apply(*[a(values) for a in args])


def _integer_power(node: Node, in_branch: bool) -> Evaluate | None:
    """x ** 2 by multiplication, exact and differentiable for every x; None when the exponent is not such a number."""
    base, exponent = node.args
    if exponent.op != "number" or exponent.number % 1 or abs(exponent.number) > _LARGEST_INTEGER_POWER:
        return None
    if in_branch and exponent.number < 0:
        return None
    value, n = evaluator(base, in_branch=in_branch), int(exponent.number)
    return lambda values: jax.lax.integer_pow(jnp.asarray(value(values), dtype=float), n)
