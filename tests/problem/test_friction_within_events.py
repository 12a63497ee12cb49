"""Gradients where dry friction, events and a long dead time meet, for which jax has no reverse mode."""

import numpy as np
import polars as pl
import pytest

from plantfit.spec.reading import load

STUDY = """name = "stick"
[recording.a]
file = "a.csv"
[model]
equations = '''
x' = v
v' = delay(F, L) - friction(v, Fc) - k*x
when falling(x + 0.3): v = -cr*v
y = x
'''
inputs = { F = "1" }
states = ["x", "v"]
outputs = { y = "1" }
check_units = false
[parameters]
Fc = { bounds = [0.01, 1.0] }
L = { bounds = [0.0, 1.5] }
k = { bounds = [0.1, 2.0] }
cr = { bounds = [0.0, 1.0] }
"""


@pytest.mark.slow
def test_gradients_are_those_of_the_cost(tmp_path):
    """`plantfit run` with L-BFGS-B ended in "Transpose rule for 'stop_gradient' not implemented"."""
    t = 0.1 * np.arange(40)
    pl.DataFrame({"t [s]": t, "F [1]": np.sin(t), "y [1]": np.cos(t)}).write_csv(tmp_path / "a.csv")
    (tmp_path / "stick.toml").write_text(STUDY)
    problem = load(tmp_path / "stick.toml").problem
    z = np.array([[0.45, 0.45, 0.45, 0.45], [0.2, 0.7, 0.6, 0.3]])
    values, gradients = problem.values_and_gradients(z)
    np.testing.assert_allclose(values, problem.costs(z), rtol=1e-12)
    h = 1e-6 * np.eye(4)
    for point, gradient in zip(z, gradients, strict=True):
        differences = (np.asarray(problem.costs(point + h)) - np.asarray(problem.costs(point - h))) / 2e-6
        np.testing.assert_allclose(gradient, differences, rtol=1e-5, atol=1e-8)
