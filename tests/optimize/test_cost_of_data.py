"""A cost of data is compiled once for all data of a shape, and searched to the same bits as one with the data as
constants."""

import numpy as np
import pytest

from plantfit.optimize import Objective, minimise
from plantfit.optimize.contract import CostOfData

import jax.numpy as jnp

TRACED = []


def bowl(x, data):
    TRACED.append(1)
    return jnp.sum((x - data["at"]) ** 2 * data["weights"], axis=-1)


@pytest.mark.parametrize("method", ["cmaes", "shade"])
@pytest.mark.thorough
def test_other_data_compile_nothing_and_the_bits_are_those_of_constants(method):
    TRACED.clear()
    counts = []
    for at in (0.2, 0.7):
        data = {"at": jnp.asarray([at, 1.0 - at, 0.4]), "weights": jnp.asarray([1.0, 3.0, 10.0])}
        of_data = minimise(Objective(3, CostOfData(bowl, data)), method, budget=600, runs=2, seed=4)
        counts.append(len(TRACED))
        plain = minimise(Objective(3, lambda x, data=data: jnp.sum((x - data["at"]) ** 2 * data["weights"], axis=-1)),
                         method, budget=600,
                         runs=2, seed=4)  # fmt: skip
        assert min(r.cost for r in of_data) < 1e-3
        for a, b in zip(of_data, plain, strict=True):
            assert np.array_equal(a.x, b.x)
            assert a.cost == b.cost
    assert counts[0] > 0
    assert counts[1] == counts[0]
