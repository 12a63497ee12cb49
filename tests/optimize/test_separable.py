"""Blocks of residuals with coordinates of their own."""

import dataclasses

import numpy as np
import pytest

from plantfit.optimize import minimise
from plantfit.optimize.contract import Objective
from plantfit.optimize.local.separable import FINE, LONG, Block, separable_least_squares
from plantfit.optimize.loop.counter import Counter


def blocks_of(targets, wave):
    """Per block two residuals: a curved valley, and waves that make local minima."""

    def blocks(x, wanted):
        found = []
        for k, target in enumerate(targets):
            a, b = x[2 * k : 2 * k + 2]
            r = np.array(
                [3.0 * (a - target[0]), b - target[1] + (a - target[0]) ** 2, wave * np.sin(12.0 * (b - target[1]))]
            )
            j = np.array(
                [[3.0, 0.0], [2.0 * (a - target[0]), 1.0], [0.0, 12.0 * wave * np.cos(12.0 * (b - target[1]))]]
            )
            found.append((r, j))
        return found

    return blocks


def objective(targets, wave=0.0):
    blocks = blocks_of(targets, wave)
    groups = tuple(np.array([2 * k, 2 * k + 1]) for k in range(len(targets)))

    def costs(x):
        raise AssertionError("costs are not needed")

    return Objective(
        2 * len(targets),
        costs,
        residuals_and_jacobian=lambda x: (np.zeros(1), np.zeros((1, 2 * len(targets)))),
        separable=groups,
        blocks=blocks,
        jacobian_charge=1.0,
    )


TARGETS = [(0.2, 0.7), (0.9, 0.1), (0.5, 0.5), (0.05, 0.95)]


@pytest.mark.parametrize("seed", range(5))
def test_all_blocks_reach_their_optimum_among_local_minima(seed):
    counter = Counter(objective(TARGETS, wave=0.3), 4000)
    start = np.random.default_rng(seed).random(8)
    assert separable_least_squares(counter, start, agree=4, max_steps=2000) == "converged"
    np.testing.assert_allclose(counter.best_x, np.ravel(TARGETS), atol=1e-5)
    assert counter.best_cost < 1e-9
    assert counter.extra["basin_hits"] >= 3


def test_an_optimum_outside_of_the_box_ends_on_its_bounds():
    counter = Counter(objective([(1.4, 0.5), (-0.3, 0.5)]), 500)
    assert separable_least_squares(counter, np.full(4, 0.4), agree=1, max_steps=200) == "converged"
    x, cost = counter.best_x, counter.best_cost
    # at a = 1: min over b of (b - 0.5 + 0.16)^2 is at 0.34; at a = 0: 0.5 - 0.09 = 0.41
    np.testing.assert_allclose(x, [1.0, 0.34, 0.0, 0.41], atol=1e-6)
    assert cost == pytest.approx(9 * (0.4**2 + 0.3**2), rel=1e-6)


def test_the_budget_holds_and_the_best_of_all_blocks_together_is_kept():
    counter = Counter(objective(TARGETS, wave=0.3), 25)
    assert separable_least_squares(counter, np.full(8, 0.3), agree=4, max_steps=2000) == "budget"
    assert counter.spent <= 25
    blocks = counter.objective.blocks
    assert blocks is not None
    together = sum(r @ r for r, _ in blocks(counter.best_x, np.ones(len(TARGETS), bool)))
    assert counter.best_cost == pytest.approx(together, rel=1e-12)
    assert np.all((counter.best_x >= 0) & (counter.best_x <= 1))


def test_a_block_that_fails_at_its_start_begins_elsewhere():
    whole = objective(TARGETS[:2])
    plain = blocks_of(TARGETS[:2], 0.0)

    def sometimes(x, wanted):
        found = plain(x, wanted)
        return [(np.full(3, np.nan), j) if x[0] > 0.8 and k == 0 else (r, j) for k, (r, j) in enumerate(found)]

    broken = dataclasses.replace(whole, blocks=sometimes)
    counter = Counter(broken, 2000)
    separable_least_squares(counter, np.array([0.95, 0.5, 0.5, 0.5]), agree=2, max_steps=500)
    np.testing.assert_allclose(counter.best_x, np.ravel(TARGETS[:2]), atol=1e-5)
    assert counter.best_cost < 1e-9


def test_the_same_seed_gives_the_same_bits():
    runs = [minimise(objective(TARGETS, wave=0.3), "least_squares", runs=2, budget=400, seed=3) for _ in range(2)]
    for a, b in zip(*runs, strict=True):
        assert a.cost == b.cost
        np.testing.assert_array_equal(a.x, b.x)


def test_blocks_at_their_end_are_not_computed_again_and_no_bit_changes():
    whole, plain = objective(TARGETS, wave=0.3), blocks_of(TARGETS, 0.3)
    asked = []

    def few(x, wanted):
        asked.append(np.array(wanted))
        return [
            pair if w else (np.full(3, np.nan), np.full((3, 2), np.nan))
            for pair, w in zip(plain(x, wanted), wanted, strict=True)
        ]

    def searched(made):
        counter = Counter(made, 600)
        status = separable_least_squares(counter, np.random.default_rng(3).random(8), agree=2, max_steps=500)
        return status, counter.best_x.tobytes(), counter.best_cost, counter.spent, counter.history

    assert searched(whole) == searched(dataclasses.replace(whole, blocks=few))
    assert np.all(asked[-1])  # the answer of all blocks together is computed as a whole
    assert not np.all(asked)


def test_a_search_that_crawls_gives_way_but_its_answer_counts():
    """10 of 10 random starts of the steam chamber need this (tests/cases/test_steam_demo.py, slow)."""
    rng = np.random.default_rng(0)
    block = Block(np.arange(2), np.array([0.3, 0.4]), np.array([2.0, 0.0]), np.eye(2), length=LONG)
    assert block.crawls
    block.next(rng, agree=2)
    assert block.fresh
    assert block.patience == 2 * LONG  # the next one may take longer
    assert block.answer[0] == 4.0
    np.testing.assert_array_equal(block.answer[1], [0.3, 0.4])
    block.begin(block.x, np.array([1.0, 0.0]), np.eye(2))
    assert not block.crawls
    block.done = True  # came to its end
    block.next(rng, agree=2)
    assert block.patience == LONG
    assert [c for c, _ in block.found] == [4.0, 1.0]
    assert block.ended == [1.0]  # one that gave way is no evidence
    last = Block(np.arange(2), np.array([0.3, 0.4]), np.array([2.0, 0.0]), np.eye(2), tolerance=FINE, length=10 * LONG)
    assert not last.crawls  # the best answer is led to its last digits
