"""Every registered method keeps the contract; broken methods are caught by the suite."""

from dataclasses import dataclass
from typing import Any

import pytest

from plantfit.optimize import methods
from plantfit.optimize.algorithms.random_search import RandomSearch
from plantfit.testing import OPTIMIZER_CHECKS
from plantfit.testing.optimizers import (
    check_bounds_and_budget,
    check_no_favoured_place,
    check_rows_of_a_generation,
    check_same_seed_same_bits,
)

import jax.numpy as jnp

# kin of cmaes, whose compilation takes seconds for each of these checks; cmaes itself passes them in every run
KIN, DEAR = ("dd_cmaes", "sep_cmaes", "ipop_cmaes"), ("check_bounds_and_budget", "check_310_dimensions")


def pairs():
    for method in (m["name"] for m in methods()):
        for check in OPTIMIZER_CHECKS:
            seldom = method in KIN and check.__name__ in DEAR
            name = f"{method}-{check.__name__}"
            yield pytest.param(method, check, id=name, marks=pytest.mark.slow if seldom else ())


@pytest.mark.parametrize(("method", "check"), list(pairs()))
@pytest.mark.further(9)
def test_conformance(method, check):
    check(method)


@dataclass(frozen=True)
class Outside(RandomSearch):
    def ask(self, key, state):
        x, state = super().ask(key, state)
        return 1.2 * x, state


@dataclass(frozen=True)
class Stuck(RandomSearch):
    def ask(self, key, state):
        return jnp.full(state.shape, 0.75), state


@dataclass(frozen=True)
class Centred(RandomSearch):
    """Knows where the optimum of the unmoved bowl lies."""

    def ask(self, key, state) -> tuple[Any, Any]:
        from plantfit.testing.objectives import centre

        x, state = super().ask(key, state)
        return centre(state.shape[1]) + 1e-6 * (x - 0.5), state


@dataclass(frozen=True)
class Cut(RandomSearch):
    """Says fewer rows than it asks for where the budget is small."""

    def init(self, key, facts):
        return jnp.zeros((self.population, facts.dimension))


@pytest.mark.parametrize(
    ("broken", "check", "words"),
    [
        (Outside(), check_bounds_and_budget, "left the cube"),
        (Cut(), check_rows_of_a_generation, "but `ask` returns points of shape"),
        (Stuck(), check_same_seed_same_bits, "the seed has no effect"),
        (Centred(), check_no_favoured_place, "depends on the place"),
    ],
    ids=["outside", "cut", "stuck", "centred"],
)
@pytest.mark.further(2)
def test_suite_catches(broken, check, words):
    with pytest.raises(AssertionError, match=words):
        check(broken)
