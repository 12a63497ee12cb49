"""What enters what in a model's equations, read from its traced program."""

import plantfit.runtime  # noqa: F401
from plantfit.simulate.vector import VectorModel

import jax
import jax.numpy as jnp
from jax.extend.core import Var


def is_linear(vector: VectorModel) -> bool:
    """Whether x' = A x + B u + c with A, B, c made of parameters only (time counts as an input).

    Then no state and no input enters the Jacobians. Decided from the traced program, for all values of the
    parameters at once: terms that vanish only for some values (a friction of 0) still count.
    """
    n, m = len(vector.states), len(vector.channels)

    def jacobians(x, u, p):
        return jax.jacfwd(lambda x, u: vector.rate(x, u, p), argnums=(0, 1))(x, u)

    return not any(_used(jax.make_jaxpr(jacobians)(*_placeholders(vector)).jaxpr)[: n + m])


def output_reads_input(vector: VectorModel) -> bool:
    """Whether any output depends on an input directly."""
    n, m = len(vector.states), len(vector.channels)
    traced = jax.make_jaxpr(vector.output)(*_placeholders(vector)).jaxpr
    return any(_used(traced)[n : n + m])


def _placeholders(vector: VectorModel):
    return (1.0,) * len(vector.states), (1.0,) * len(vector.channels), tuple(jnp.ones(d.shape) for d in vector.model.parameters)


def _used(jaxpr) -> list[bool]:
    """Which inputs of a traced program its outputs depend on; looks into calls, takes the rest of control flow as a whole."""
    wanted = {v for v in jaxpr.outvars if isinstance(v, Var)}
    for equation in reversed(jaxpr.eqns):
        if not any(v in wanted for v in equation.outvars):
            continue
        inner = equation.params.get("jaxpr") or equation.params.get("call_jaxpr")
        inner = getattr(inner, "jaxpr", inner)
        whole = inner is None or len(inner.invars) != len(equation.invars) or equation.primitive.name in ("scan", "while", "cond")
        used = [True] * len(equation.invars) if whole else _used(inner)
        wanted |= {v for v, u in zip(equation.invars, used, strict=True) if u and isinstance(v, Var)}
    return [v in wanted for v in jaxpr.invars]
