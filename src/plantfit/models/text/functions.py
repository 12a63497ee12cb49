"""Operators and functions that equations may use: their jax code and their rule of units.

Where a derivative does not exist (sqrt and log at zero, asin at one), the value is kept and the
derivative is zero, so that a gradient is never NaN through a branch that is not taken.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.models.parts.friction import coulomb, stribeck
from plantfit.models.parts.quotient import quotient
from plantfit.models.parts.smooth import quantize, smooth_abs, smooth_deadzone, smooth_sat

# isort: split
import jax
import jax.numpy as jnp

Rule = Literal["same", "ratio", "plain", "angle", "times", "over", "power", "root", "choose", "logic", "law"]

CONSTANTS = {"pi": 3.141592653589793, "e": 2.718281828459045}
MANY = 64


@dataclass(frozen=True)
class Function:
    """`least` to `most` arguments; `rule` says what units they take and give (`models.text.dimensions`: unit_check and
    relations).

    "same": one unit for all arguments and the result; "ratio": one for all arguments, and a number; "plain": numbers;
    "angle": radians, and a number; "choose": a condition, then as "same"; "logic": anything, and a number; "law": see
    `like_result`; "times", "over", "power", "root": units are multiplied, divided, raised.

    `guarded` replaces `evaluate` inside the branches of a piecewise expression. `like_result` are the
    places of arguments of a "law" that share the unit of the result; the others share another.
    """

    evaluate: Callable[..., Any]
    least: int
    most: int
    rule: Rule
    usage: str = ""
    guarded: Callable[..., Any] | None = None
    like_result: tuple[int, ...] = ()


def _guard(inside: Any, function: Callable[[Any], Any], safe: float, outside: Any) -> Any:
    """function where `inside`, else the constant `outside`; no derivative leaks from outside."""

    def guarded(x):
        good = inside(x)
        return jnp.where(good, function(jnp.where(good, x, safe)), jax.lax.stop_gradient(outside(x)))

    return guarded


def _condition(x: Any) -> Any:
    return x if jnp.issubdtype(jnp.result_type(x), jnp.bool_) else x != 0


def divide_guarded(a: Any, b: Any) -> Any:
    """a / b with zero derivative where b = 0."""
    good = b != 0
    return jnp.where(good, quotient(a, jnp.where(good, b, 1.0)), jax.lax.stop_gradient(a / jnp.asarray(b, dtype=float)))


def power_guarded(x: Any, y: Any) -> Any:
    """x ** y with zero derivative where x <= 0 (real exponents have none there)."""
    good = x > 0
    return jnp.where(
        good, jnp.power(jnp.where(good, x, 1.0), y), jax.lax.stop_gradient(jnp.power(jnp.asarray(x, dtype=float), y))
    )


def _atan2(y: Any, x: Any) -> Any:
    good = (x != 0) | (y != 0)
    return jnp.where(good, jnp.arctan2(jnp.where(good, y, 0.0), jnp.where(good, x, 1.0)), 0.0)


def _clip(x: Any, low: Any, high: Any) -> Any:
    return jnp.minimum(jnp.maximum(x, low), high)


def _deadzone(x: Any, low: Any, high: Any) -> Any:
    return jnp.maximum(x - high, 0.0) + jnp.minimum(x - low, 0.0)


def _below_one(x: Any) -> Any:
    return jnp.abs(x) < 1


sqrt = _guard(lambda x: x > 0, jnp.sqrt, 1.0, lambda x: jnp.where(x == 0, 0.0, jnp.nan))
log = _guard(lambda x: x > 0, jnp.log, 1.0, lambda x: jnp.where(x == 0, -jnp.inf, jnp.nan))
log10 = _guard(lambda x: x > 0, jnp.log10, 1.0, lambda x: jnp.where(x == 0, -jnp.inf, jnp.nan))
asin = _guard(_below_one, jnp.arcsin, 0.0, lambda x: jnp.arcsin(jnp.asarray(x, dtype=float)))
acos = _guard(_below_one, jnp.arccos, 0.0, lambda x: jnp.arccos(jnp.asarray(x, dtype=float)))

OPERATORS: dict[str, Function] = {
    "+": Function(lambda a, b: a + b, 2, 2, "same"),
    "-": Function(lambda a, b: a - b, 2, 2, "same"),
    "*": Function(lambda a, b: a * b, 2, 2, "times"),
    "/": Function(quotient, 2, 2, "over", guarded=divide_guarded),
    "**": Function(lambda a, b: jnp.power(a, b), 2, 2, "power", guarded=power_guarded),
    "negative": Function(lambda a: -a, 1, 1, "same"),
    "<": Function(lambda a, b: a < b, 2, 2, "ratio"),
    "<=": Function(lambda a, b: a <= b, 2, 2, "ratio"),
    ">": Function(lambda a, b: a > b, 2, 2, "ratio"),
    ">=": Function(lambda a, b: a >= b, 2, 2, "ratio"),
    "==": Function(lambda a, b: a == b, 2, 2, "ratio"),
    "!=": Function(lambda a, b: a != b, 2, 2, "ratio"),
    "and": Function(lambda *a: reduce(jnp.logical_and, map(_condition, a)), 2, MANY, "logic"),
    "or": Function(lambda *a: reduce(jnp.logical_or, map(_condition, a)), 2, MANY, "logic"),
    "not": Function(lambda a: jnp.logical_not(_condition(a)), 1, 1, "logic"),
}

CALLS: dict[str, Function] = {
    "sin": Function(jnp.sin, 1, 1, "angle", "sin(x)"),
    "cos": Function(jnp.cos, 1, 1, "angle", "cos(x)"),
    "tan": Function(jnp.tan, 1, 1, "angle", "tan(x)"),
    "asin": Function(asin, 1, 1, "plain", "asin(x)"),
    "acos": Function(acos, 1, 1, "plain", "acos(x)"),
    "atan": Function(jnp.arctan, 1, 1, "plain", "atan(x)"),
    "atan2": Function(_atan2, 2, 2, "ratio", "atan2(y, x)"),
    "sinh": Function(jnp.sinh, 1, 1, "plain", "sinh(x)"),
    "cosh": Function(jnp.cosh, 1, 1, "plain", "cosh(x)"),
    "tanh": Function(jnp.tanh, 1, 1, "plain", "tanh(x)"),
    "exp": Function(jnp.exp, 1, 1, "plain", "exp(x)"),
    "log": Function(log, 1, 1, "plain", "log(x)"),
    "log10": Function(log10, 1, 1, "plain", "log10(x)"),
    "sqrt": Function(sqrt, 1, 1, "root", "sqrt(x)"),
    "abs": Function(jnp.abs, 1, 1, "same", "abs(x)"),
    "sign": Function(jnp.sign, 1, 1, "ratio", "sign(x)"),
    "min": Function(lambda *a: reduce(jnp.minimum, a), 2, MANY, "same", "min(a, b)"),
    "max": Function(lambda *a: reduce(jnp.maximum, a), 2, MANY, "same", "max(a, b)"),
    "clip": Function(_clip, 3, 3, "same", "clip(x, low, high)"),
    "floor": Function(jnp.floor, 1, 1, "same", "floor(x)"),
    "ceil": Function(jnp.ceil, 1, 1, "same", "ceil(x)"),
    "where": Function(lambda c, a, b: jnp.where(_condition(c), a, b), 3, 3, "choose", "where(condition, a, b)"),
    "smooth_sign": Function(lambda x, width: jnp.tanh(x / width), 2, 2, "ratio", "smooth_sign(x, width)"),
    "smooth_abs": Function(smooth_abs, 2, 2, "same", "smooth_abs(x, width)"),
    "smooth_sat": Function(smooth_sat, 4, 4, "same", "smooth_sat(x, low, high, width)"),
    "smooth_deadzone": Function(smooth_deadzone, 4, 4, "same", "smooth_deadzone(x, low, high, width)"),
    "quantize": Function(quantize, 2, 2, "same", "quantize(x, step)"),
    "coulomb": Function(coulomb, 3, 3, "law", "coulomb(v, Fc, width)", like_result=(1,)),
    "stribeck": Function(stribeck, 5, 5, "law", "stribeck(v, Fc, Fs, vs, width)", like_result=(1, 2)),
    "relu": Function(lambda x: jnp.maximum(x, 0.0), 1, 1, "same", "relu(x)"),
    "pos": Function(lambda x: jnp.maximum(x, 0.0), 1, 1, "same", "pos(x)"),
    "sat": Function(_clip, 3, 3, "same", "sat(x, low, high)"),
    "deadzone": Function(_deadzone, 3, 3, "same", "deadzone(x, low, high)"),
    "step": Function(lambda x: jnp.where(x >= 0, 1.0, 0.0), 1, 1, "ratio", "step(x)"),
}

# resolved to channels, forces and backlashes before anything is evaluated
SPECIAL: dict[str, Function] = {
    "delay": Function(lambda u, _: u, 2, 2, "same", "delay(x, time)"),
    "play": Function(lambda x, _: x, 2, 2, "same", "z = play(x, gap)"),
    "friction": Function(
        lambda v, sliding, breakaway=None: sliding, 2, 3, "law", "friction(v, sliding, breakaway)", like_result=(1, 2)
    ),
}

FUNCTIONS: dict[str, Function] = {**OPERATORS, **CALLS, **SPECIAL}
