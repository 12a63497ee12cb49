"""What stands in equations of a jaxpr that jax writes differently from version to version, told by what all versions
have."""

from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401

import jax
from jax.extend.core import ClosedJaxpr


class ScanParts(NamedTuple):
    """The operands of a scan: first those that all steps share, then what is carried; rows are the rest. Results:
    carried, then rows."""

    consts: int
    carry: int


class WhileParts(NamedTuple):
    """The operands of a while loop: those that its test alone reads, those that its body alone reads; what is
    carried is the rest."""

    of_test: int
    of_body: int


def scan_parts(equation: Any) -> ScanParts:
    """How many operands are what; rows, and they alone, have one axis more outside of the body than inside.

    jax 0.10 has parameters num_consts and num_carry for it, jax 0.12 trees of operands and of results.
    """
    body = equation.params["jaxpr"].jaxpr
    rows = sum(_axes(outside) > _axes(inside) for outside, inside in zip(equation.invars, body.invars, strict=True))
    carry = sum(_axes(outside) == _axes(inside) for outside, inside in zip(equation.outvars, body.outvars, strict=True))
    return ScanParts(len(equation.invars) - rows - carry, carry)


def while_parts(equation: Any) -> WhileParts:
    """How many operands are what: all results are carried, and what is carried comes last in the test and in the
    body."""
    carry = len(equation.outvars)
    test, body = (equation.params[name].jaxpr for name in ("cond_jaxpr", "body_jaxpr"))
    return WhileParts(len(test.invars) - carry, len(body.invars) - carry)


def expanded(equation: Any) -> ClosedJaxpr | None:
    """The program that an equation stands for whose primitive has no other meaning; None for others.

    jax 0.12 writes searchsorted so, and with it interp: one equation, made into plain ones only when it is compiled.
    """
    if equation.primitive.name != "call_hi_primitive":
        return None
    plain = getattr(equation.primitive, "to_lojax", None)
    if plain is None:
        return None
    return jax.make_jaxpr(lambda *given: plain(*given, **equation.params))(*(v.aval for v in equation.invars))


def _axes(atom: Any) -> int:
    return len(atom.aval.shape)
