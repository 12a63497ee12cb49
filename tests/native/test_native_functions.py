"""Every function of equations has native code, its derivatives too: one without it would leave whole models to slow
lax.scan, unsaid."""

import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.text.functions import FUNCTIONS
from plantfit.native.compile.processor import available
from plantfit.native.scan import supported

# isort: split
import jax
import jax.numpy as jnp


def native(function, arguments) -> bool:
    """Whether a loop over value and derivatives of a function of so many numbers is native."""

    def body(carry, x):
        value = lambda a: jnp.asarray(function(*a), dtype=float)  # noqa: E731
        moved = jax.jvp(value, (x,), (tuple(jnp.ones_like(a) for a in x),))
        back = jax.vjp(value, x)[1](jnp.ones(()))[0]
        return carry + sum(moved) + sum(back), None

    return supported(body, jnp.zeros(()), tuple(jnp.linspace(0.1 + k, 0.9 + k, 5) for k in range(arguments)))


@pytest.mark.skipif(not available(), reason="native loops are off here: no llvmlite, or PLANTFIT_NATIVE=0")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_and_its_derivatives_are_native(name):
    own = FUNCTIONS[name]
    assert native(own.evaluate, own.least)
    assert own.guarded is None or native(own.guarded, own.least)


@pytest.mark.skipif(not available(), reason="native loops are off here: no llvmlite, or PLANTFIT_NATIVE=0")
def test_a_function_without_native_code_is_seen():
    assert not native(jax.scipy.special.i0, 1)
