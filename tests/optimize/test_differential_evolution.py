"""The differential-evolution family: draws, memory, archive, shrinking, against closed forms and plain numpy."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import stats

from plantfit.errors import Status
from plantfit.optimize import Checkpoint, Objective, make, minimise
from plantfit.optimize.algorithms.differential_evolution.population import (
    Archive,
    between,
    binomial,
    collapsed,
    newcomers,
    pick_other,
    positive_cauchy,
    remember,
    select,
)
from plantfit.optimize.algorithms.differential_evolution.success_history import TERMINAL, Memory
from plantfit.optimize.contract import Facts
from plantfit.optimize.loop import population_loop as loop
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.generations import chunk_of
from plantfit.optimize.loop.nested import Nested
from plantfit.testing.objectives import bowl, corner, hopeless

import jax
import jax.numpy as jnp

FAMILY = ["de", "shade", "lshade", "jso", "dish"]


def ready(name, **settings) -> Any:
    return make(name, **settings)


def numbers(seed, n):
    return np.random.default_rng(seed).random(n)


def history(r):
    return r.cost, r.evaluations, r.status, list(r.x), list(r.history_evaluations), list(r.history_cost), r.failures


# draws without rejection


@pytest.mark.parametrize("location", [-0.05, 0.0, 0.1, 0.5, 0.95])
def test_cauchy_above_zero_as_if_redrawn(location):
    draws = np.asarray(positive_cauchy(jnp.asarray(numbers(1, 40_000)), jnp.asarray(location)))
    assert np.all((draws > 0) & (draws <= 1))
    law = stats.cauchy(location, 0.1)
    for x in (0.05, 0.2, 0.5, 0.9):
        expected = (law.cdf(x) - law.cdf(0)) / (1 - law.cdf(0))
        assert np.mean(draws <= x) == pytest.approx(expected, abs=0.01)


def test_other_indices_are_distinct_and_uniform():
    rows, extra = 5, 3
    base = jnp.arange(60_000) % rows
    u = jnp.asarray(numbers(2, 120_000).reshape(2, -1))
    first = pick_other(u[0], jnp.asarray(rows), base)
    second = pick_other(u[1], jnp.asarray(rows + extra), base, first)
    triples = np.stack([base, first, second])
    assert np.all(triples.min(axis=0) >= 0)
    assert np.all((triples[0] != triples[1]) & (triples[0] != triples[2]) & (triples[1] != triples[2]))
    # each of 5 * 4 * 6 ordered triples equally often
    counts = np.unique(triples, axis=1, return_counts=True)[1]
    assert len(counts) == rows * (rows - 1) * (rows + extra - 2)
    assert stats.chisquare(counts).pvalue > 1e-3


def test_mutants_outside_go_halfway_back():
    v, base = jnp.array([[-0.3, 0.4, 1.7]]), jnp.array([[0.2, 0.9, 0.6]])
    assert np.allclose(between(v, base), [[0.1, 0.4, 0.8]])


@pytest.mark.parametrize("rate", [0.0, 0.3, 1.0])
def test_binomial_crossover_forces_one_coordinate(rate):
    n, d = 20_000, 4
    u, forced = numbers(3, n * d).reshape(n, d), np.arange(n) % d
    trial = np.asarray(
        binomial(jnp.asarray(u), jnp.asarray(forced), jnp.full(n, rate), jnp.ones((n, d)), jnp.zeros((n, d)))
    )
    assert np.all(trial[np.arange(n), forced] == 1)
    assert trial.mean() == pytest.approx((1 + (d - 1) * rate) / d, abs=0.01)


# selection, archive, memory


def test_selection_sorts_keeps_ties_and_puts_failures_last():
    members = newcomers(5, 1, 100)._replace(
        x=jnp.arange(5.0)[:, None],
        f=jnp.array([1.0, 2.0, 3.0, jnp.inf, jnp.inf]),
        live=jnp.asarray(4),
        fresh=jnp.asarray(False),
    )
    told = select(members, jnp.arange(10.0, 15.0)[:, None], jnp.array([5.0, 2.0, 0.5, jnp.inf, -9.0]))
    # 3 -> 0.5 by a better trial, 2 -> 2 by a tie, 1 stays; the row that is not live never counts
    assert list(np.asarray(told.f)) == [0.5, 1.0, 2.0, np.inf, np.inf]
    assert list(np.asarray(told.x[:4, 0])) == [12.0, 0.0, 11.0, 13.0]
    assert int(told.evaluations) == 4


@pytest.mark.parametrize(("held", "limit"), [(0, 6), (3, 6), (6, 6), (6, 2)])
def test_archive_keeps_all_until_full_then_a_random_part(held, limit):
    beaten = np.array([True, False, True, True])
    kept, add = [], jax.jit(remember)
    for seed in range(400):
        archive = Archive(jnp.arange(6.0)[:, None], jnp.asarray(held))
        new = add(
            archive,
            jnp.asarray(beaten),
            jnp.arange(10.0, 14.0)[:, None],
            jnp.asarray(numbers(seed, 10)),
            jnp.asarray(limit),
        )
        rows = list(np.asarray(new.x[: int(new.count), 0]))
        assert len(rows) == len(set(rows)) == min(held + 3, limit)
        assert set(rows) <= {*range(held), 10.0, 12.0, 13.0}
        kept += rows
    share = np.unique(kept, return_counts=True)[1] / 400
    assert len(share) == held + 3
    assert np.allclose(share, min(1.0, limit / (held + 3)), atol=0.12)


def plain_lehmer(w, s):
    return np.sum(w * s**2) / np.sum(w * s)


F, CR, GAIN = np.array([0.3, 0.6, 0.9]), np.array([0.1, 0.5, 1.0]), np.array([4.0, 1.0, 2.0])
MOVED = np.array([0.1, 0.6, 0.3])


@pytest.mark.parametrize(
    ("method", "factor", "rate"),
    [
        ("shade", plain_lehmer(GAIN, F), np.sum(GAIN * CR) / GAIN.sum()),
        ("lshade", plain_lehmer(GAIN, F), plain_lehmer(GAIN, CR)),
        ("jso", (0.3 + plain_lehmer(GAIN, F)) / 2, (0.8 + plain_lehmer(GAIN, CR)) / 2),
        ("dish", (0.5 + plain_lehmer(MOVED, F)) / 2, (0.8 + plain_lehmer(MOVED, CR)) / 2),
    ],
)
def test_memory_after_one_generation(method, factor, rate):
    """Rows 0-2 succeed, row 3 ties, row 4 loses, row 5 comes from a failure: only the first three count."""
    chosen = ready(method, population=6)
    state = chosen.init(jax.random.key(0), Facts(2, 10_000))
    x = np.linspace(0.1, 0.6, 12).reshape(6, 2)
    old = np.array([10.0, 20.0, 30.0, 40.0, 50.0, np.inf])
    state = state._replace(
        members=state.members._replace(x=jnp.asarray(x), f=jnp.asarray(old), fresh=jnp.asarray(False)),
        factor=jnp.asarray([*F, 0.7, 0.7, 0.7]),
        rate=jnp.asarray([*CR, 0.7, 0.7, 0.7]),
    )
    trial = x + np.array([*MOVED, 0.2, 0.2, 0.2])[:, None] * np.array([0.6, 0.8])
    told, _ = jax.jit(chosen.tell)(
        state, jnp.asarray(trial), jnp.asarray(old - np.array([*GAIN, 0.0, -1.0, 0.0])).at[5].set(1.0)
    )
    assert float(told.memory.factor[0]) == pytest.approx(factor)
    assert float(told.memory.rate[0]) == pytest.approx(rate)
    assert int(told.memory.slot) == 1
    # the beaten parents, not the winners
    assert {tuple(r) for r in np.asarray(told.archive.x[: int(told.archive.count)])} == {tuple(r) for r in x[:3]}
    assert float(told.members.f[0]) == 1.0


def test_terminal_rate_is_sticky():
    chosen = ready("lshade", history=2)
    memory = Memory(jnp.array([0.5, 0.5]), jnp.array([0.5, 0.5]), jnp.asarray(0))
    weights, factor = jnp.array([0.5, 0.5]), jnp.array([0.5, 0.5])
    memory = chosen.written(memory, weights, factor, jnp.zeros(2))
    assert list(np.asarray(memory.rate)) == [TERMINAL, 0.5]
    memory = chosen.written(memory._replace(slot=jnp.asarray(0)), weights, factor, jnp.ones(2))
    assert list(np.asarray(memory.rate)) == [TERMINAL, 0.5]


@pytest.mark.parametrize(("method", "written"), [("jso", [0, 1, 2, 3, 4, 0]), ("dish", [0, 1, 2, 3, 0, 1])])
def test_fixed_slot(method, written):
    chosen = ready(method)
    memory, slots = chosen._blank(), []
    for _ in written:
        slots.append(int(memory.slot))
        memory = chosen.written(memory, jnp.array([1.0]), jnp.array([0.2]), jnp.array([0.2]))
    assert slots == written
    factor, rate = chosen.recalled(memory)
    assert float(factor[-1]) == float(rate[-1]) == 0.9


def test_jso_schedule():
    jso = ready("jso")
    f, cr = jnp.array([0.2, 1.0]), jnp.array([0.1, 0.95])
    for t, least, most, pull in [
        (0.0, 0.7, 0.7, 0.7),
        (0.3, 0.6, 0.7, 0.8),
        (0.55, 0.0, 0.7, 1.2),
        (0.7, 0.0, 1.0, 1.2),
    ]:
        factor, rate = jso.limits(f, cr, jnp.asarray(t))
        assert np.allclose(factor, np.minimum(f, most))
        assert np.allclose(rate, np.maximum(cr, least))
        assert np.allclose(jso.pull(f, jnp.asarray(t)), pull * f)
    members = newcomers(40, 2, 1000)
    for method, ends in (("jso", (0.25, 0.125)), ("dish", (0.125, 0.25))):
        shares = [
            ready(method).greediness(jnp.zeros(40), members._replace(evaluations=jnp.asarray(e))) for e in (0, 1000)
        ]
        assert np.allclose(shares, ends)


def test_jso_pbest_is_another_member_in_the_first_half():
    base, top = jnp.arange(9000) % 6, jnp.full(9000, 3)
    u = jnp.asarray(numbers(4, 9000))
    early, late = (np.asarray(ready("jso").pbest(u, top, base, jnp.asarray(t))) for t in (0.4, 0.6))
    assert np.all(early != base)
    assert np.any(late == base)
    assert set(early) == set(late) == {0, 1, 2}


# shrinking populations in the loop


@pytest.mark.parametrize(
    ("method", "dimension", "budget", "rows"),
    [
        ("lshade", 10, 100_000, 180),
        ("lshade", 310, 10_000, 100),
        ("jso", 10, 100_000, round(25 * np.log(10) * np.sqrt(10))),
        ("dish", 310, 1_000_000, round(25 * np.log(310) * np.sqrt(310))),
        ("jso", 1, 1000, 18),
        ("shade", 30, 1000, 100),
    ],
)
def test_first_population(method, dimension, budget, rows):
    assert ready(method).rows(Facts(dimension, budget)) == rows


@pytest.mark.parametrize("method", ["lshade", "jso", "dish"])
@pytest.mark.parametrize(("rounding", "sizes"), [("nearest", [89, 61, 33, 5, 4]), ("down", [88, 61, 32, 4, 4])])
def test_next_population_by_hand(method, rounding, sizes):
    """N0 = 90, budget 5000: 90 - 86 t is 88.5, 61, 32.9, 4.7 and 4 (Tanabe and Fukunaga 2014, eq. 10, before
    rounding)."""
    chosen = ready(method, population=90, rounding=rounding)
    members = newcomers(90, 5, 5000)
    spent = [85, 1686, 3321, 4960, 5000]
    assert np.allclose(90 - 86 * np.array(spent) / 5000, [88.538, 61.0008, 32.8788, 4.688, 4.0])
    assert [int(chosen.size(members._replace(evaluations=jnp.asarray(e)))) for e in spent] == sizes
    # a population never grows again
    assert int(chosen.size(members._replace(evaluations=jnp.asarray(85), live=jnp.asarray(50)))) == 50


@pytest.mark.parametrize("rounding", ["down", "nearest"])
@pytest.mark.parametrize("method", ["lshade", "dish"])
@pytest.mark.thorough
def test_population_shrinks_linearly_and_the_budget_is_used(method, rounding):
    chosen, budget = ready(method, population=30, rounding=rounding), 900
    counter = Counter(bowl(3), budget)
    nested = Nested(chosen, Facts(3, budget), jax.random.key(1))
    sizes, spent = [], 0
    while spent + int(chosen.live(nested.state)) <= budget:
        exact = 30 - 26 * (spent / budget)
        wanted = max(4, min(30, int(exact) if rounding == "down" else round(exact)))
        x, f = nested.generation(counter)
        assert len(x) == len(f) == wanted
        sizes.append(len(x))
        spent += len(x)
    assert sizes[0] == 30
    assert sizes[-1] == 4
    assert nested.evaluations == counter.spent == spent > budget - 4
    assert nested.best_cost == counter.best_cost
    [r] = minimise(bowl(3), chosen, budget=budget, seed=1)
    assert r.evaluations == spent
    assert r.status is Status.budget


@pytest.mark.thorough
def test_only_live_candidates_reach_the_cost():
    """The calls of the cost, counted from inside, match the packed live candidates of all runs."""
    calls = []

    def costs(x):
        jax.debug.callback(lambda v: calls.append(len(v)), x)
        return jnp.sum((x - 0.3) ** 2, axis=1)

    results = minimise(Objective(3, costs), "lshade", runs=4, budget=2000, seed=1, settings={"population": 60})
    jax.effects_barrier()
    size = chunk_of(60)
    assert set(calls) == {size}
    spent = sum(r.evaluations for r in results)
    generations = len(calls)
    # all chunks but the last of a generation are full; unpacked, every generation would take 4 chunks
    assert spent <= sum(calls) < spent + size * generations
    assert sum(calls) < 2.5 * spent


@pytest.mark.thorough
def test_shrinking_runs_keep_their_bits_in_any_company(monkeypatch):
    method = "lshade"
    together = minimise(corner(3), method, runs=5, budget=700, seed=7)
    [alone] = minimise(corner(3), method, runs=1, first_run=2, budget=700, seed=7)
    assert history(together[2]) == history(alone)
    kept = []
    monkeypatch.setattr(loop, "SIDE_BY_SIDE", 120)
    monkeypatch.setattr(loop, "REPORT_SECONDS", 0.0)
    grouped = minimise(corner(3), method, runs=5, budget=700, seed=7, checkpoint=lambda c: kept.append(c.to_bytes()))
    resumed = minimise(
        corner(3), method, runs=5, budget=700, seed=7, resume=Checkpoint.from_bytes(kept[len(kept) // 3])
    )
    for a, b, c in zip(together, grouped, resumed, strict=True):
        assert history(a) == history(b) == history(c)


@pytest.mark.thorough
def test_failures_are_counted_once_per_evaluation():
    [r] = minimise(hopeless(2), "lshade", budget=300, seed=1)
    assert r.failures == r.evaluations
    assert r.status is Status.failed


# searches


def ellipsoid(x):
    z = 10 * (x - np.linspace(0.2, 0.85, 5))
    return jnp.sum(10.0 ** (6 * np.arange(5) / 4) * z**2, axis=1)


@pytest.mark.parametrize("method", FAMILY)
@pytest.mark.further(1)
def test_ellipsoid_in_five_dimensions(method):
    results = minimise(Objective(5, ellipsoid), method, runs=5, budget=10_000, seed=3)
    assert np.median([r.cost for r in results]) < 1e-6


@pytest.mark.parametrize("strategy", ["rand/1", "best/1", "current-to-best/1"])
def test_strategies_of_de_follow_their_formula(strategy):
    """With CR = 1 every trial is one of the mutants that some distinct r1, r2, r3 give."""
    chosen = ready("de", strategy=strategy, rate=1.0, factor=0.4, population=5)
    x = np.random.default_rng(5).uniform(0.4, 0.6, (5, 2))  # too narrow for a mutant to leave the cube
    state = chosen.init(jax.random.key(0), Facts(2, 1000))
    state = state._replace(x=jnp.asarray(x), f=jnp.arange(5.0), fresh=jnp.asarray(False))
    trials = np.asarray(jax.jit(chosen.ask)(jax.random.key(3), state)[0])
    for i in range(5):
        r = np.array([(a, b, c) for a in range(5) for b in range(5) for c in range(5) if len({i, a, b, c}) == 4])
        a, b, c = x[r].transpose(1, 0, 2)
        mutants = {
            "rand/1": a + 0.4 * (b - c),
            "best/1": x[0] + 0.4 * (a - b),
            "current-to-best/1": x[i] + 0.4 * (x[0] - x[i]) + 0.4 * (a - b),
        }[strategy]
        assert np.min(np.abs(mutants - trials[i]).max(axis=1)) < 1e-15


@pytest.mark.parametrize("method", ["de", "lshade"])
@pytest.mark.further(1)
def test_collapsed_population_begins_anew(method):
    chosen = ready(method, population=8, restarts=1)
    state = chosen.init(jax.random.key(0), Facts(2, 1000))
    x = jnp.full((8, 2), 0.25)
    tell = jax.jit(chosen.tell)
    told, info = tell(state, x, jnp.ones(8))
    members = told if method == "de" else told.members
    assert bool(members.fresh)
    assert not bool(info["stop"])
    again, _ = jax.jit(chosen.ask)(jax.random.key(1), told)
    assert np.ptp(np.asarray(again)[: int(chosen.live(told)) if method == "lshade" else 8]) > 0.3
    _, info = tell(told, x, jnp.ones(8))
    assert bool(info["stop"])
    assert not bool(collapsed(members._replace(f=jnp.ones(8), x=jnp.linspace(0, 1, 16).reshape(8, 2))))


def test_failed_members_are_no_parents():
    """Trials of a population half of which failed at one far point stay away from that point."""
    chosen = ready("jso", population=10)
    x = np.full((10, 2), 0.95)
    x[:5] = np.random.default_rng(6).uniform(0.2, 0.3, (5, 2))
    state = chosen.init(jax.random.key(0), Facts(2, 1000))
    f = jnp.where(jnp.arange(10) < 5, jnp.arange(10.0), jnp.inf)
    told, _ = jax.jit(chosen.tell)(state, jnp.asarray(x), f)
    ask = jax.jit(chosen.ask)
    for key in range(5):
        assert np.asarray(ask(jax.random.key(key), told)[0]).max() < 0.95 - 0.2


@pytest.mark.thorough
def test_distances_weigh_in_the_unit_cube():
    """Stretching the box leaves every bit of DISH as it is: it sees the cube only."""
    one, two = (
        minimise(dataclasses.replace(bowl(3), lower=low, upper=high), "dish", budget=600, seed=2)[0]
        for low, high in ((np.zeros(3), np.ones(3)), (np.full(3, -50.0), np.array([1e3, 1.0, 60.0])))
    )
    assert history(one) == history(two)
