"""Few generations are compiled apart from the cost: the same bits, and what is compiled for one cost serves others."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from plantfit.errors import SearchError
from plantfit.optimize import Facts, minimise
from plantfit.optimize.loop import apart, population_loop
from plantfit.optimize.loop.generations import parts_of
from plantfit.optimize.registry import REGISTRY, make
from plantfit.testing.objectives import bowl, corner

import jax
import jax.numpy as jnp

PLAIN = ("run", "x", "cost", "evaluations", "status", "history_evaluations", "history_cost", "failures")
OFTEN = ("cmaes", "jso", "pso")
POPULATIONS = [n for n in REGISTRY if hasattr(make(n), "ask")]


def population(name: str) -> Any:
    return make(name)


def same(a, b):
    return all(np.array_equal(getattr(p, n), getattr(q, n)) for p, q in zip(a, b, strict=True) for n in PLAIN)


def both(monkeypatch, *args, **kwargs):
    """A search of few generations, and the same in blocks."""
    found = []
    for few in (True, False):
        monkeypatch.setattr(population_loop, "worth_it", lambda *_, few=few: few)
        found.append(minimise(*args, **kwargs))
    return found


@pytest.mark.parametrize("method", [pytest.param(n, marks=() if n in OFTEN else pytest.mark.slow) for n in POPULATIONS])
@pytest.mark.thorough
def test_bits_are_those_of_blocks(monkeypatch, method):
    # runs that end one after another, so that some of a generation no longer count
    assert same(*both(monkeypatch, corner(3), method, runs=3, budget=900, seed=5, stagnation=200))


def test_asking_and_telling_serve_another_cost_of_as_many_coordinates():
    method, made = population("pso"), []
    for goal in (bowl(3), corner(3), bowl(4)):
        steps, _ = parts_of(goal, method, Facts(goal.dimension, 600, goal.lower, goal.upper, goal.start))
        made.append(apart._asking_and_telling(steps, goal.dimension, None))
    assert made[0] is made[1]
    assert made[2] is not made[1]
    minimise(bowl(3), "pso", budget=600, seed=1)
    before = [part._cache_size() for part in made[0]]
    minimise(corner(3), "pso", budget=600, seed=1)
    assert [part._cache_size() for part in made[0]] == before


@pytest.mark.parametrize(("first", "then"), [(True, False), (False, True)])
def test_a_search_goes_on_either_way(monkeypatch, first, then):
    kept = []
    monkeypatch.setattr(population_loop, "worth_it", lambda *_: first)
    monkeypatch.setattr(population_loop, "REPORT_SECONDS", 0.0)
    whole = minimise(bowl(3), "pso", runs=2, budget=600, seed=4, checkpoint=kept.append)
    monkeypatch.setattr(population_loop, "worth_it", lambda *_: then)
    assert same(whole, minimise(bowl(3), "pso", runs=2, budget=600, seed=4, resume=kept[len(kept) // 2]))


@pytest.mark.parametrize(
    ("dimension", "budget", "width", "groups", "apart_is"),
    [
        (4, 8000, 2, 1, True),
        (4, 8001 + 8, 2, 1, False),
        (4, 8000, 3, 1, False),
        (4, 4000, 2, 3, False),
        (310, 210, 2, 1, False),
    ],
)
def test_many_generations_many_evaluations_and_large_states_take_blocks(dimension, budget, width, groups, apart_is):
    facts = Facts(dimension, budget, None, None, None)
    assert apart.worth_it(population("cmaes"), facts, width, groups) is apart_is


def test_compiling_first_simulates_nothing():
    calls = []

    def costs(x):
        jax.debug.callback(lambda c: calls.append(c), x[0, 0], ordered=True)
        return jnp.sum((x - 0.3) ** 2, axis=1)

    goal = replace(bowl(3), costs=costs)
    rows = population("pso").rows(Facts(3, 60, goal.lower, goal.upper, goal.start))
    assert rows <= 16  # one evaluation a generation
    [found] = minimise(goal, "pso", budget=60, seed=1)
    jax.effects_barrier()
    assert len(calls) * rows == found.evaluations > 0


def test_a_cost_that_gives_another_number_of_costs_is_told():

    with pytest.raises(SearchError, match="one cost for each"):
        minimise(replace(bowl(3), costs=lambda x: x), "pso", budget=300, seed=1)
