"""What operands of loops are, and what equations stand for, in a jaxpr as the jax of this process writes it."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.native.trace.equation_parts import expanded, scan_parts, while_parts

# isort: split
import jax
import jax.numpy as jnp
from jax.extend.core import jaxpr_as_fun


def equation_of(name, function, *arguments):
    """The first equation of a primitive, inside inlined programs too."""

    def found(jaxpr):
        for equation in jaxpr.eqns:
            if equation.primitive.name == name:
                return equation
            inner = equation.params.get("jaxpr")
            if inner is not None and (one := found(inner.jaxpr)) is not None:
                return one
        return None

    return found(jax.make_jaxpr(function)(*arguments).jaxpr)


@pytest.mark.parametrize("consts", [0, 1, 3])
@pytest.mark.parametrize("carry", [0, 1, 2])
@pytest.mark.parametrize("rows", [0, 1, 2])
def test_operands_of_a_scan_are_counted(consts, carry, rows):
    """A matrix of as many rows as there are steps is a constant or carried in some of them: only what changes its
    shape is a row."""
    shared, begin = [jnp.ones((5, k + 1)) for k in range(consts)], [jnp.ones((5, 2)) for _ in range(carry)]
    read = [jnp.ones((5, 3)) for _ in range(rows)]

    def run(shared, begin, read):
        def body(c, x):
            more = sum((s.sum() for s in (*shared, *x)), jnp.zeros(()))
            return [a * 0.5 + more for a in c], [more, *c]

        return jax.lax.scan(body, begin, read, length=5)

    assert scan_parts(equation_of("scan", run, shared, begin, read)) == (consts, carry)


@pytest.mark.parametrize(("of_test", "of_body"), [(0, 0), (1, 0), (0, 2), (2, 1)])
def test_operands_of_a_while_loop_are_counted(of_test, of_body):
    limits, steps = [jnp.ones(()) for _ in range(of_test)], [jnp.ones(()) for _ in range(of_body)]

    def run(limits, steps, x, y):
        return jax.lax.while_loop(lambda s: s[0] < sum(limits, s[1]), lambda s: (sum(steps, s[0]), s[1]), (x, y))

    assert while_parts(equation_of("while", run, limits, steps, 1.0, 2.0)) == (of_test, of_body)


def test_what_stands_for_a_program_is_expanded():
    nodes, at = jnp.asarray([0.0, 1.0, 3.0, 7.0]), jnp.asarray([-1.0, 0.0, 2.0, 3.0, 9.0])
    jaxpr = jax.make_jaxpr(lambda a: jnp.searchsorted(nodes, a, side="right"))(at)
    met, left = [], [jaxpr.jaxpr]
    while left:
        for equation in left.pop().eqns:
            plain = expanded(equation)
            inner = plain if plain is not None else equation.params.get("jaxpr")
            if inner is None:
                met.append(equation.primitive.name)
            else:
                left.append(inner.jaxpr)
            if plain is not None:
                there = jaxpr_as_fun(plain)(nodes, at)[0]
                np.testing.assert_array_equal(there, np.searchsorted(nodes, at, side="right"))
    assert met
    assert "call_hi_primitive" not in met
