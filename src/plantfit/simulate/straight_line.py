"""A model's equations as straight lines of another language: one assignment for each operation of their jaxpr."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.simulate.steps.vector import VectorModel

import jax
from jax.extend import core

COMMON = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0}*{1}", "div": "{0}/{1}", "neg": "-{0}", "add_any": "{0} + {1}",
    "square": "{0}*{0}",
    "one_minus_square": "(1.0 + {0})*(1.0 - {0})",
    "copy": "{0}", "copy_p": "{0}", "stop_gradient": "{0}", "convert_element_type": "{0}", "lt": "{0} < {1}",
    "le": "{0} <= {1}",
    "gt": "{0} > {1}", "ge": "{0} >= {1}", "eq": "{0} == {1}", "ne": "{0} != {1}", "broadcast_in_dim": "{0}",
    "reshape": "{0}", "squeeze": "{0}",
}  # fmt: skip
_NAMED = ("exp", "log", "sin", "cos", "tan", "tanh", "sinh", "cosh", "sqrt", "expm1", "log1p")
_INVERSE = {
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "atan2": "arctan2",
    "asinh": "arcsinh",
    "acosh": "arccosh",
    "atanh": "arctanh",
}
PYTHON = COMMON | {n: f"np.{n}({{0}})" for n in _NAMED} | {n: f"np.{v}({{0}})" for n, v in _INVERSE.items()} | {
    "atan2": "np.arctan2({0}, {1})", "abs": "abs({0})", "sign": "np.sign({0})", "pow": "{0}**{1}",
    "integer_pow": "{0}**{y}",
    "max": "max({0}, {1})", "min": "min({0}, {1})", "select_n": "({2} if {0} else {1})", "and": "({0} and {1})",
    "or": "({0} or {1})",
    "not": "(not {0})", "logistic": "1/(1 + np.exp(-{0}))", "floor": "np.floor({0})", "ceil": "np.ceil({0})",
    "cbrt": "np.cbrt({0})",
    "rsqrt": "1/np.sqrt({0})", "exp2": "2.0**{0}", "log2": "np.log2({0})",
}  # fmt: skip
C = COMMON | {n: f"{n}({{0}})" for n in (*_NAMED, *_INVERSE)} | {
    "atan2": "atan2({0}, {1})", "abs": "fabs({0})", "sign": "(double)(({0} > 0.0) - ({0} < 0.0))",
    "pow": "pow({0}, {1})",
    "integer_pow": "pow({0}, {y})", "max": "fmax({0}, {1})", "min": "fmin({0}, {1})", "select_n": "({0} ? {2} : {1})",
    "and": "({0} && {1})",
    "or": "({0} || {1})", "not": "(!{0})", "logistic": "1.0/(1.0 + exp(-{0}))", "floor": "floor({0})",
    "ceil": "ceil({0})",
    "cbrt": "cbrt({0})", "rsqrt": "1.0/sqrt({0})", "exp2": "exp2({0})", "log2": "log2({0})",
}  # fmt: skip
CASADI = COMMON | {n: f"ca.{n}({{0}})" for n in (*_NAMED, *_INVERSE)} | {
    "atan2": "ca.atan2({0}, {1})", "abs": "ca.fabs({0})", "sign": "ca.sign({0})", "pow": "{0}**{1}",
    "integer_pow": "{0}**{y}",
    "max": "ca.fmax({0}, {1})", "min": "ca.fmin({0}, {1})", "select_n": "ca.if_else({0}, {2}, {1})",
    "and": "ca.logic_and({0}, {1})",
    "or": "ca.logic_or({0}, {1})", "not": "ca.logic_not({0})", "logistic": "1/(1 + ca.exp(-{0}))",
    "floor": "ca.floor({0})",
    "ceil": "ca.ceil({0})", "rsqrt": "1/ca.sqrt({0})", "exp2": "2.0**{0}", "log2": "ca.log({0})/ca.log(2.0)",
}  # fmt: skip
# of the module math, on floats: it raises where numpy gives inf or nan, and a choice keeps a nan as jax does
MATH = COMMON | {n: f"math.{n}({{0}})" for n in (*_NAMED, *_INVERSE)} | {
    "atan2": "math.atan2({0}, {1})", "abs": "abs({0})", "sign": "(({0} > 0.0) - ({0} < 0.0) if {0} == {0} else {0})",
    "pow": "math.pow({0}, {1})", "integer_pow": "{0}**{y}", "max": "({0} if {0} >= {1} or {0} != {0} else {1})",
    "min": "({0} if {0} <= {1} or {0} != {0} else {1})", "select_n": "({2} if {0} else {1})", "and": "({0} and {1})",
    "or": "({0} or {1})",
    "not": "(not {0})", "logistic": "1.0/(1.0 + math.exp(-{0}))", "floor": "float(math.floor({0}))",
    "ceil": "float(math.ceil({0}))",
    "cbrt": "math.cbrt({0})", "rsqrt": "1.0/math.sqrt({0})", "exp2": "math.exp2({0})", "log2": "math.log2({0})",
}  # fmt: skip
TRUNCATED = {
    "python": "np.trunc({0})",
    "math": "float(math.trunc({0}))",
    "c": "trunc({0})",
    "casadi": "ca.sign({0})*ca.floor(ca.fabs({0}))",
}
LANGUAGES = {"python": PYTHON, "math": MATH, "c": C, "casadi": CASADI}
NOT_FINITE = {
    "python": {"nan": "np.nan", "inf": "np.inf", "-inf": "(-np.inf)"},
    "math": {"nan": "math.nan", "inf": "math.inf", "-inf": "(-math.inf)"},
    "c": {"nan": "NAN", "inf": "INFINITY", "-inf": "(-INFINITY)"},  # of math.h
    "casadi": {"nan": "np.nan", "inf": "np.inf", "-inf": "(-np.inf)"},
}  # fmt: skip


@dataclass(frozen=True)
class Lines:
    """Assignments (name, expression) in order, and an expression for each result."""

    assignments: tuple[tuple[str, str], ...]
    results: tuple[str, ...]

    def text(self, indent: str, form: str = "{} = {}") -> str:
        """The assignments, one a line."""
        return "".join(f"{indent}{form.format(*pair)}\n" for pair in self.assignments)


def straight_line(vector: VectorModel, what: str, language: str, names: Sequence[Sequence[str]]) -> Lines:
    """The rates or outputs (`what` "rate" or "output") of a model in a language of `LANGUAGES`.

    `names` are expressions for states, channels and parameters. Raises ModelError for what has no expression there,
    such as tables.
    """
    function: Callable = getattr(vector, what)
    given = tuple(tuple(1.0 for _ in part) for part in names)
    try:
        closed = jax.make_jaxpr(function)(*given)
    except (TypeError, IndexError, ValueError) as error:
        raise ModelError(
            _refusal(vector.model.name, language, f"parameters that are arrays ({type(error).__name__})")
        ) from None
    flat = [name for part in names for name in part]
    writer = Writer(vector.model.name, language, LANGUAGES[language])
    results = writer.write(closed.jaxpr, [writer.number(c) for c in closed.consts], flat)
    return Lines(tuple(writer.assignments), tuple(results))


def _refusal(model: str, language: str, why: str) -> str:
    return f"Model {model!r} has {why}, which are not written as {language} yet; export --to csv or control instead."


class Writer:
    """Writes a jaxpr of numbers: an assignment for each operation, `number` for constants, ModelError for what has
    no expression."""

    def __init__(self, model: str, language: str, words: dict[str, str]):
        self.model, self.language, self.words = model, language, words
        self.assignments: list[tuple[str, str]] = []

    def number(self, value: Any) -> Any:
        array = np.asarray(value)
        if array.size != 1:
            raise self.refused("tables or arrays")
        if array.dtype == bool:
            return str(array.item()) if self.language in ("python", "math") else "1" if array.item() else "0"
        text = repr(float(array.item()))
        return NOT_FINITE[self.language].get(text) or (f"({text})" if text.startswith("-") else text)

    def write(self, jaxpr: Any, constants: Sequence[Any], inputs: Sequence[Any]) -> list[Any]:
        """The results of a jaxpr, its constants and inputs given as expressions."""
        known = dict(zip((*jaxpr.constvars, *jaxpr.invars), (*constants, *inputs), strict=True))

        def read(atom: Any) -> Any:
            return self.number(atom.val) if isinstance(atom, core.Literal) else known[atom]

        for equation in jaxpr.eqns:
            values, name = [read(v) for v in equation.invars], equation.primitive.name
            inner = equation.params.get("jaxpr") or equation.params.get("call_jaxpr")
            if inner is not None and name not in ("scan", "while", "cond"):
                closed = hasattr(inner, "consts")
                results = self.write(
                    inner.jaxpr if closed else inner, [self.number(c) for c in inner.consts] if closed else [], values
                )
            else:
                results = self.operation(equation, name, values)
            known.update(zip(equation.outvars, results, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def operation(self, equation: Any, name: str, values: Sequence[Any]) -> list[Any]:
        """The results of one operation."""
        return [self.assigned(self.expression(equation, name, values))]

    def expression(self, equation: Any, name: str, values: Sequence[str]) -> str:
        """An operation on numbers."""
        if any(v.aval.size != 1 for v in (*equation.invars, *equation.outvars)):
            raise self.refused(f"operations on arrays or tables ({name})")
        return self.of_numbers(equation, name, values)

    def of_numbers(self, equation: Any, name: str, values: Sequence[str]) -> str:
        """An operation as it is on every entry."""
        if name not in self.words:
            raise self.refused(f"operations on arrays or tables ({name})")
        if name == "convert_element_type":
            return self.converted(values[0], equation.invars[0].aval.dtype, equation.params["new_dtype"])
        if name == "select_n" and len(values) != 3:
            raise self.refused("choices of more than two")
        return self.words[name].format(*values, y=equation.params.get("y"))

    def refused(self, why: str) -> ModelError:
        return ModelError(_refusal(self.model, self.language, why))

    def converted(self, value: str, own: Any, wished: Any) -> str:
        """A value in another type: truths of numpy add up as truths unless made numbers, and whole numbers lose
        their places."""
        if np.issubdtype(own, np.bool_) and self.language in ("python", "math"):
            return f"float({value})"
        if np.issubdtype(own, np.floating) and not np.issubdtype(wished, np.floating):
            return f"({value} != 0.0)" if np.issubdtype(wished, np.bool_) else TRUNCATED[self.language].format(value)
        return value

    def assigned(self, expression: str) -> str:
        name = f"v{len(self.assignments)}"
        self.assignments.append((name, expression))
        return name
