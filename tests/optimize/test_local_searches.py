"""Least squares from many starts side by side: the same answers as one after another, with what it charges."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy import optimize

import plantfit.runtime  # noqa: F401
from plantfit.optimize import minimise
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.one_search import Found
from plantfit.optimize.local.side_by_side import LocalSearches, Start, one_after_another
from plantfit.optimize.loop.counter import ALONE, Counter
from plantfit.optimize.loop.counter import TOGETHER as CALLED
from plantfit.testing.objectives import from_residuals

import jax
import jax.numpy as jnp

TOGETHER = {"side_by_side": 8}


def batched(residuals, dimension):
    """An objective that also evaluates several points at once; `calls` lists how many it was given."""
    objective = from_residuals(residuals, dimension)
    both = jax.jit(jax.vmap(lambda x: (residuals(x), jax.jacfwd(residuals)(x))))
    calls = []

    def batch(x):
        calls.append(len(x))
        return both(x)

    return dataclasses.replace(objective, batch_rows=batch), calls


def decays(z):
    t = jnp.linspace(0.0, 3.0, 60)
    return 2 * z[0] * jnp.exp(-(10 ** (2 * z[1] - 1)) * t) - 0.9 * jnp.exp(-0.7 * t) + 0.01 * jnp.sin(9 * t)


def test_same_answer_as_scipy():
    objective, calls = batched(decays, 2)
    [together] = minimise(objective, "least_squares", budget=4000, seed=1, settings=TOGETHER)
    [alone] = minimise(objective, "least_squares", budget=4000, seed=1, settings={"side_by_side": 1})
    assert together.status == alone.status == "converged"
    np.testing.assert_allclose(together.x, alone.x, atol=1e-7)
    assert together.cost == pytest.approx(alone.cost, rel=1e-12)
    assert set(calls) == {CALLED}


def test_every_start_finds_the_bounds_of_a_linear_problem():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(60, 20)), 4 * rng.normal(size=60)
    reference = optimize.lsq_linear(a, b, bounds=(0, 1), method="bvls", tol=1e-14)
    on_bound = reference.active_mask != 0
    assert np.sum(on_bound) >= 5
    objective, _ = batched(lambda z: a @ z - b, 20)
    [r] = minimise(objective, "least_squares", budget=6000, seed=1, settings={"side_by_side": 16, "agree": 1_000_000})
    assert r.extra["starts"] > 40
    assert r.extra["basin_hits"] == r.extra["starts"]
    assert np.array_equal(r.x[on_bound], reference.x[on_bound])
    np.testing.assert_allclose(r.x, reference.x, atol=1e-7)


def test_charges_are_those_of_the_points():
    objective, _ = batched(decays, 2)
    budget = 33 * objective.jacobian_charge + 1
    [r] = minimise(objective, "least_squares", budget=int(budget), seed=1, settings={**TOGETHER, "agree": 1_000_000})
    assert r.status == "budget"
    assert r.evaluations == 33 * objective.jacobian_charge


def test_a_long_search_of_one_point_after_another_is_not_filled_up():
    objective, calls = batched(decays, 2)
    counter, zs = Counter(objective, np.inf), np.random.default_rng(3).uniform(size=(ALONE + 2, 2))
    alone = [counter.rows(z[None], 8) for z in zs]
    both = counter.rows(zs[:2], 8)
    counter.rows(zs[:1], 8)
    assert calls == [CALLED] * ALONE + [1, 1] + [CALLED, CALLED]
    counter.rows(zs[:6], 8)
    assert calls[-2:] == [CALLED, CALLED]
    assert counter.spent == (ALONE + 11) * objective.jacobian_charge
    assert both.r.shape == (2, 60)
    for k in (0, ALONE + 1):
        np.testing.assert_allclose(alone[k].r[0], decays(zs[k]), rtol=1e-12)
        np.testing.assert_allclose(alone[k].jacobian[0], jax.jacfwd(decays)(zs[k]), rtol=1e-12)


def test_starts_that_cannot_be_simulated_are_skipped():
    objective, _ = batched(lambda z: jnp.where(z[0] < 0.5, jnp.nan, 1.0) * jnp.stack([z[0] - 0.7, z[1] - 0.2]), 2)
    [r] = minimise(objective, "least_squares", budget=3000, seed=1, settings={**TOGETHER, "agree": 10})
    assert r.cost < 1e-24
    assert r.extra["skipped_starts"] > 0
    assert r.extra["basin_hits"] >= 10


def test_robust_losses_go_one_after_another():
    objective, calls = batched(decays, 2)
    [r] = minimise(
        objective, "least_squares", budget=2000, seed=1, settings={**TOGETHER, "loss": "huber", "f_scale": 0.01}
    )
    assert not calls
    assert np.isfinite(r.cost)


# -- a search ends where it says
#  ----------------------------------------------------------------------------------------------------


def valley(z):
    """A curved valley that takes many steps to follow to (0.9, 0.89), cost 1e-6; flat where z0 is below 0.3."""
    a, b = 4.0 * z[0] - 2.0, 4.0 * z[1] - 1.0
    inside = jax.nn.sigmoid(80.0 * (z[0] - 0.3))
    return jnp.stack(
        [inside * (10.0 * (b - a**2) + 1e-3) + (1 - inside), inside * (1.6 - a) + (1 - inside), 1e-3 + 0.0 * a]
    )


def test_searches_on_a_plateau_that_end_first_do_not_end_the_good_one():
    """The user's own start needs many steps; many others sit on a plateau and end at once, all at the same cost."""
    objective, _ = batched(valley, 2)
    plateau = [Start(np.array([0.02 + 0.01 * k, 0.2 + 0.05 * k])) for k in range(30)]
    starts = itertools.chain([Start(np.array([0.35, 0.95]), asked=True)], itertools.cycle(plateau))
    counter = Counter(objective, 2_000)
    basins = Basins(counter.extra)
    LocalSearches(counter, starts, basins, agree=3, max_steps=200).run()
    np.testing.assert_allclose(counter.best_x, [0.9, 0.89], atol=1e-3)
    # the plateau was reached often, the answer once
    assert counter.extra["basin_hits"] == 1
    assert counter.extra["starts"] > 7


def rosenbrock(z):
    """The curved valley of Rosenbrock 1960; bottom at (0.75, 0.75), cost 1."""
    a, b = 4.0 * z[0] - 2.0, 4.0 * z[1] - 2.0
    return jnp.stack([10.0 * (b - a**2), 1.0 - a, jnp.sqrt(3.0) + 0.0 * a])


def test_a_search_cut_off_by_its_steps_is_no_end_and_goes_on():
    objective, _ = batched(rosenbrock, 2)
    settings = {"side_by_side": 8, "max_steps": 3, "agree": 3}
    [r] = minimise(objective, "least_squares", budget=4000, seed=1, settings=settings)
    assert r.status == "converged"
    np.testing.assert_allclose(r.x, [0.75, 0.75], atol=1e-8)
    # every one that counts was led to its end, whatever its limit of steps
    np.testing.assert_allclose(r.extra["local_costs"], 1.0, rtol=1e-9)


def test_a_budget_that_ends_midway_is_not_called_converged():
    objective, _ = batched(rosenbrock, 2)
    for budget in (20, 40, 60):
        [r] = minimise(objective, "least_squares", budget=budget, seed=1, settings={"side_by_side": 4})
        assert r.status == "budget"
        assert r.extra["basin_hits"] == 0 or r.cost == pytest.approx(1.0, rel=1e-6)
        assert r.extra["starts"] + r.extra["cut_searches"] >= 1


@pytest.mark.parametrize("together", [True, False])
def test_a_start_of_the_user_is_searched_to_its_end(together):
    """With one step a search, others are cut off; the user's start is not."""
    objective, _ = batched(rosenbrock, 2)
    start = np.array([[0.2, 0.9]])
    objective = dataclasses.replace(objective, start=start, batch_rows=objective.batch_rows if together else None)
    [r] = minimise(objective, "least_squares", budget=900, seed=3, settings={"max_steps": 1, "agree": 1})
    assert r.status == "converged"
    np.testing.assert_allclose(r.x, [0.75, 0.75], atol=1e-6)


def test_hits_are_counted_against_the_answer_also_when_that_was_cut_off():
    basins = Basins(extra := {})
    for cost in (2.0, 2.0, 2.0 + 1e-9, 3.0):
        basins.add(Found(np.zeros(1), cost))
    assert (extra["basin_hits"], extra["optima"], extra["starts"]) == (3, 2, 4)
    basins.add(Found(np.zeros(1), 1.5, finished=False))
    assert (extra["basin_hits"], extra["cut_searches"], extra["starts"]) == (0, 1, 4)
    assert basins.enough(3)  # of those that ended; the one that was cut off goes on before this is the answer
    basins.reopen(1.5)
    basins.add(Found(np.zeros(1), 1.0))
    assert (extra["basin_hits"], extra["cut_searches"], extra["optima"]) == (1, 0, 3)
    basins.add(Found(np.zeros(1), 1.0), independent=False)
    assert extra["basin_hits"] == 1
    basins.add(Found(np.zeros(1), np.inf, started=False))
    assert (extra["starts"], extra["skipped_starts"]) == (6, 1)


def test_one_search_after_another_goes_on_with_the_best_that_was_cut_off():
    """A search gives half of the way to 1 with every 10 steps; plateaus at 2 end at once."""
    asked = []

    def search(x, steps):
        asked.append((float(x[0]), steps))
        if x[0] < 0.5:
            return Found(x, 2.0)
        left = (x[0] - 0.5) * 0.5 ** (steps / 10)
        done = left < 1e-3
        return Found(np.array([0.5 + (0.0 if done else left)]), 1.0 if done else 1.0 + left, finished=bool(done))

    starts = iter([Start(np.array([v])) for v in (0.9, 0.1, 0.2, 0.3, 0.8, 0.7, *[0.6] * 40)])
    basins = Basins(extra := {})
    counter = Counter(batched(rosenbrock, 2)[0], 100)
    status = one_after_another(counter, starts, search, basins, agree=3, max_steps=10)
    assert status == "converged"
    assert extra["basin_hits"] >= 3
    assert basins.best == basins.best_ended == 1.0


def test_share_of_the_box_that_is_not_seen_yet():
    """Boender and Rinnooy Kan 1987: 2 optima after 5 searches leave 2 x 3 / (5 x 4); one optimum needs no more than
    agreement."""
    basins = Basins({})
    for cost in (1.0, 1.0, 1.0, 4.0, 4.0):
        basins.add(Found(np.zeros(1), cost))
    assert basins.unseen == pytest.approx(0.3)
    assert basins.enough(3)
    assert not basins.enough(3, unseen=0.02)
    for _ in range(13):
        basins.add(Found(np.zeros(1), 1.0))
    assert basins.enough(3, unseen=0.02)


def many_waves(shift):
    """Ten minima, the deepest near x = 7; a local search from a random point finds it in about one of ten."""

    def residuals(z):
        x = (z[0] + shift) * 10
        return jnp.stack([0.5 * jnp.sin(jnp.pi * x), 0.05 * (x - 7.1), 0.3 * (z[1] - 0.4)])

    return residuals


@pytest.mark.parametrize("shift", [0.0, 0.13, 0.31])
def test_auto_finds_the_deepest_of_ten_minima(shift):
    objective, _ = batched(many_waves(shift), 2)
    x = np.linspace(6.5, 7.5, 1_000_001)
    lowest = np.min((0.5 * np.sin(np.pi * x)) ** 2 + (0.05 * (x - 7.1)) ** 2) / 3
    for r in minimise(objective, "auto", runs=5, budget=3000, seed=2):
        assert r.cost == pytest.approx(lowest, rel=1e-6)
        assert r.extra["optima"] > 3
        assert r.extra["basin_hits"] >= 1


def test_one_search_is_one_search():
    """`agree` 1 from a start ends where that start leads, and looks nowhere else."""
    objective, calls = batched(many_waves(0.0), 2)
    objective = dataclasses.replace(objective, start=np.array([[0.22, 0.5]]))
    [r] = minimise(objective, "least_squares", budget=3000, seed=1, settings={"agree": 1})
    assert r.status == "converged"
    assert r.x[0] == pytest.approx(0.2, abs=0.02)
    assert r.extra["starts"] == 1
    assert r.evaluations == objective.jacobian_charge * len(calls)


@pytest.mark.parametrize("second", [0.3, 0.9])
def test_a_second_sample_leaves_budget_for_its_searches(second):
    """Many optima: the sample is drawn, and searches go on until the budget holds no more steps."""
    objective, calls = batched(many_waves(0.0), 2)
    for budget in (700, 1000, 2000):
        calls.clear()
        [r] = minimise(objective, "auto", budget=budget, seed=3, settings={"second": second, "unseen": 1e-6})
        assert r.evaluations > budget - objective.jacobian_charge
        assert sum(calls) * objective.jacobian_charge >= 0.4 * budget
