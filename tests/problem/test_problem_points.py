"""Residuals at single points: with derivatives, alone, and one candidate after another."""

import numpy as np
import pytest
from problem_batched_plants import Case, points

from plantfit.problem.evaluate.points import residuals, residuals_alone, shared

CASES = {
    "one record": Case((150,)),
    "records of several lengths": Case((70, 90, 50), outputs="direct", missing=True),
    "dead times": Case((120,), delays=1, dense=True, outputs="direct"),
    "tables, two steps a sample": Case((80, 80), table=True, substeps=2),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.further(2)
def test_residuals_are_the_same_with_and_without_derivatives(name):
    problem = CASES[name].problem()
    assert shared(problem)
    for z in points(problem, 3):
        # rounding of their scales
        np.testing.assert_allclose(residuals_alone(problem, z), residuals(problem, z), rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(residuals_alone(problem, z), problem.residuals(z), rtol=1e-14, atol=1e-14)
