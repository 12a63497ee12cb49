"""The rate on floats against the compiled one: library models, equations with every function, and where no number comes out."""

import sys
from pathlib import Path

import numpy as np
import pytest

import plantfit as pf
from plantfit.models.library.catalogue import make
from plantfit.simulate.check import tight
from plantfit.simulate.check.plain_rate import plain_rate
from plantfit.simulate.steps.vector import vectorise

sys.path.append(str(Path(__file__).parents[1] / "models"))
from test_model_library import ALL, values  # pyright: ignore[reportMissingImports]

MOVING = [entry for entry in ALL if not entry[0].endswith("_regression")]
EVERY = """
x' = -k*x + sin(u) + cos(x)*tanh(z) + exp(-x^2) + sqrt(abs(z) + 1) + log(2 + x^2) + atan2(x, u + 3) + asin(0.3*tanh(u))
z' = max(x, u) - min(z, 2)*sign(u) + (x if u > 0.2 and not z > 9 else -z) + abs(x)^1.7 + floor(3*u) + x/(1 + z^2) + tan(0.1*x) + k*t
y = x
"""


def own(text):
    states = [line[0] for line in text.splitlines() if line[1] == "'"]
    return pf.equations(text, states=states, outputs=["y"], parameters={"k": {"bounds": (0.1, 1.0)}})


def both(model, p, a, b, t):
    """Rates by Python and by jax at channels a + b*t."""
    vector, rng = vectorise(model), np.random.default_rng(5)
    numbers = tuple(np.asarray(p[n], dtype=float) for n in vector.parameters)
    made = plain_rate(vector, numbers)
    assert made is not None
    x = rng.uniform(0.1, 1.0, len(vector.states))
    compiled = tight._Smooth(vector, numbers)
    return np.array(made(0.0, a, b)(x, t)), np.asarray(compiled.call(np.concatenate([x, a + b * t])))


@pytest.mark.parametrize(("name", "options"), MOVING)
def test_library_models_have_the_same_rate(name, options):
    model = make(name, **options)
    count = len(vectorise(model).channels)
    p = values(model)
    if any(np.ndim(v) for v in p.values()):
        assert plain_rate(vectorise(model), [p[n] for n in vectorise(model).parameters]) is None
        return
    rng = np.random.default_rng(1)
    for _ in range(5):
        plain, compiled = both(model, p, rng.uniform(-1, 1, count), rng.uniform(-1, 1, count), rng.uniform())
        np.testing.assert_allclose(plain, compiled, rtol=1e-12, atol=1e-14)


def test_every_function_of_an_equation_is_the_same():
    model = pf.equations(EVERY, inputs=["u"], states=["x", "z"], outputs=["y"], parameters={"k": {"bounds": (0.1, 1.0)}})
    rng = np.random.default_rng(2)
    for _ in range(50):
        plain, compiled = both(model, {"k": 0.7}, rng.uniform(-2, 2, 2), rng.uniform(-2, 2, 2), rng.uniform())
        np.testing.assert_allclose(plain, compiled, rtol=1e-12, atol=1e-14)


NO_NUMBER = ["1/x", "sqrt(x)", "log(x)", "exp(900*(1 + x))", "x^0.5", "max(k/x, 1)", "1e308*(10 + x) - 1e308*(11 + x)"]


@pytest.mark.parametrize("rate", NO_NUMBER)
def test_where_no_number_comes_out_it_raises_and_the_solver_asks_jax(rate):
    vector = vectorise(own(f"x' = k*({rate})\ny = x"))
    made = plain_rate(vector, (1.0,))
    assert made is not None
    with pytest.raises((ValueError, ArithmeticError)):
        made(0.0, np.zeros(1), np.zeros(1))(np.array([0.0 if rate in ("1/x", "log(x)", "max(k/x, 1)") else -1e-3]), 0.0)


def test_a_nan_that_a_choice_would_swallow_raises():
    vector = vectorise(own("x' = max(k, x)\nz' = k\ny = x"))
    made = plain_rate(vector, (1.0,))
    assert made is not None
    with pytest.raises(ValueError, match="nan"):
        made(0.0, np.zeros(1), np.zeros(1))(np.array([np.nan, 0.0]), 0.0)
