"""Searches that fall behind are set aside where there are several optima, and only there."""

import itertools

import numpy as np
import pytest
from test_local_searches import batched, valley

from plantfit.optimize import minimise
from plantfit.optimize.local import rungs
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.rungs import FEW, Rungs
from plantfit.optimize.local.side_by_side import LocalSearches, Start
from plantfit.optimize.local.starts import APART, far_apart
from plantfit.optimize.loop.counter import Counter

import jax.numpy as jnp


def test_the_best_fifth_goes_on_and_what_still_falls():
    race, costs = Rungs(), np.arange(1.0, 11.0)
    passed = race.arrived(6, costs, costs)
    assert list(np.flatnonzero(passed)) == [0, 1]
    # one that fell to a tenth since the last rung goes on however high it stands
    assert race.arrived(6, np.array([20.0]), np.array([200.0]))[0]
    assert not race.arrived(6, np.array([20.0]), np.array([40.0]))[0]


def test_few_searches_say_nothing():
    race = Rungs()
    assert np.all(race.arrived(6, np.arange(1.0, FEW), np.arange(1.0, FEW)))
    assert not race.arrived(6, np.array([99.0]), np.array([99.0]))[0]


def test_a_search_that_ended_counts_at_every_rung_after_its_end():
    race = Rungs()
    for _ in range(FEW):
        race.ended(9, 1.0)
    assert race.arrived(6, np.array([3.0]), np.array([3.0]))[0]  # nothing had ended after 6 steps
    assert not race.arrived(12, np.array([3.0]), np.array([3.0]))[0]


T = jnp.linspace(0.0, 1.0, 80)


def chirp(z):
    """A chirp with unknown frequency, rate and phase: one optimum fits, in many others searches creep."""
    return jnp.sin(10.0 + 60.0 * z[0] * T + 40.0 * z[1] * T**2 + 6.0 * z[2]) - jnp.sin(
        10.0 + 37.0 * T + 13.0 * T**2 + 2.1
    )


def test_more_starts_for_the_same_budget(monkeypatch):
    def begun():
        results = minimise(batched(chirp, 3)[0], "auto", runs=3, budget=4000, seed=4)
        return sum(r.extra["starts"] + r.extra["cut_searches"] for r in results)

    many = begun()
    monkeypatch.setattr(rungs, "PASS", 1.0)
    assert many > 1.3 * begun()


def test_where_all_lead_to_one_optimum_nothing_is_set_aside():
    objective, _ = batched(lambda z: valley(jnp.stack([0.35 + 0.6 * z[0], z[1]])), 2)
    [r] = minimise(objective, "auto", budget=6000, seed=3)
    assert r.status == "converged"
    assert r.extra["optima"] == 1
    assert r.extra["cut_searches"] == 0


def two(z):
    """Two optima; the better one, at 0.9, lies at the end of a slow valley, the other is met at once."""
    a, b = 6.0 * z[0] - 2.0, 6.0 * z[1] - 1.0
    far = 1.0 / (1.0 + jnp.exp(-60.0 * (z[0] - 0.35)))
    quick = jnp.stack([2.0 * (z[0] - 0.1), 2.0 * (z[1] - 0.5), jnp.asarray(1.0)])
    slow = jnp.stack([10.0 * (b - a**2) / 8, 1.0 - a / 3.4, jnp.asarray(1e-2)])
    return far * slow + (1.0 - far) * quick


def test_all_that_fell_behind_are_led_to_their_ends_before_convergence():
    rng = np.random.default_rng(2)
    objective, _ = batched(two, 2)
    starts = itertools.chain(Start(rng.random(2)) for _ in itertools.count())
    counter = Counter(objective, 60_000)
    basins = Basins(counter.extra)
    searches = LocalSearches(counter, starts, basins, agree=3, max_steps=400, searches=8, unseen=0.05)
    status = searches.run()
    assert counter.extra["optima"] > 1
    assert status == "converged"
    assert not searches.behind
    assert basins.unseen <= 0.05


def test_a_search_that_was_cut_off_is_doubt():
    from plantfit.optimize.local.one_search import Found

    basins = Basins({})
    for cost in (1.0, 1.0, 1.0, 1.0, 1.0, 2.0):
        basins.add(Found(np.zeros(1), cost))
    before = basins.unseen
    assert before == pytest.approx(2 * 3 / (6 * 5))
    basins.add(Found(np.zeros(1), 3.0, finished=False))
    assert basins.unseen == pytest.approx(3 * 4 / (7 * 6))
    basins.reopen(3.0)
    assert basins.unseen == before


def test_starts_next_to_the_best_come_after_the_rest_of_the_box():
    rng = np.random.default_rng(0)
    near, wide = 0.5 + 0.01 * rng.standard_normal((30, 2)), rng.random((30, 2))
    points, costs = np.vstack([near, wide]), np.r_[np.linspace(0, 1, 30), np.linspace(2, 3, 30)]
    order = list(far_apart(points, costs))
    assert sorted(order) == list(range(60))
    assert order[0] == 0
    assert sum(i < 30 for i in order[:8]) == 1
    assert list(far_apart(points, np.where(np.arange(60) == 3, np.inf, costs))).count(3) == 0


@pytest.mark.parametrize(("n", "d"), [(0, 3), (1, 1), (300, 2), (400, 9)])
def test_the_order_of_starts_is_that_of_its_definition(n, d):
    rng = np.random.default_rng(n + d)
    points, costs = rng.random((n, d)), np.where(rng.random(n) < 0.1, np.inf, rng.random(n))
    chosen, left = [], [i for i in np.argsort(costs, kind="stable") if np.isfinite(costs[i])]
    for share in APART:
        alone = []
        for i in left:
            if all(np.linalg.norm(points[i] - points[j]) > share * np.sqrt(d / 6) for j in [*chosen, *alone]):
                alone.append(i)
        chosen, left = [*chosen, *alone], [i for i in left if i not in alone]
    assert list(far_apart(points, costs)) == [*chosen, *left]
