"""Draws in a bent valley: dead time against time constant and gain on poor records. The truth has any place among
them, and the density is that of the likelihood on a grid."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares

import plantfit as pf
from plantfit.trust.intervals.kinds.likelihood_draws import walked
from plantfit.trust.intervals.linearised import residual_blocks
from plantfit.trust.intervals.plausible import plausible
from plantfit.trust.intervals.ranges import effective_samples

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks.promises import BOX, CASES, plant, record

SEEDS = range(100, 140)


def records(seeds):
    """(problem, its best point, truth) of records of the case "poor" with truths drawn from the prior; one
    compilation for all."""
    first = None
    for seed in seeds:
        rng = np.random.default_rng([seed, 2])
        truth = {n: float(np.exp(rng.uniform(*np.log(ends)))) for n, ends in BOX.items()}
        made = record(CASES["poor"], truth, rng)
        first = first or pf.Problem(plant(), {"record": made}, substeps=1)
        problem = first.with_recordings({"record": made})
        points = np.random.default_rng(0).uniform(size=(1024, 3))
        begin = points[int(np.argmin(problem.costs(points)))]
        both = [lambda z, p=problem, k=k: np.asarray(p.residuals_and_jacobian(z)[k]) for k in (0, 1)]
        z = least_squares(both[0], np.clip(begin, 1e-3, 1 - 1e-3), both[1], bounds=(0, 1), xtol=1e-6).x
        yield problem, np.clip(z, 0, 1), [truth[n] for n in problem.space.names]


def roughly_known(problem, z):
    """Rows of the findings of a record as poor as these, its ranges the box."""
    same = {"standard_error": None, "open": "both", "status": "flat", "at_bound": None}
    rows = zip(problem.space.coordinates, np.asarray(problem.space.physical(z)), strict=True)
    return [{"name": c.name, "value": v, "low": c.lower, "high": c.upper, **same} for c, v in rows]


@pytest.mark.thorough
def test_the_truth_has_any_place_among_draws_in_a_bent_valley():
    ranks = []
    for problem, z, truth in records(SEEDS):
        drawn = plausible(problem, z, roughly_known(problem, z), 128, seed=1)
        assert drawn.open == tuple(problem.space.names)
        ranks.append(np.mean(drawn.values[1:] < truth, axis=0))
    for of in np.array(ranks).T:
        assert stats.kstest(of, "uniform").pvalue > 0.01, np.sort(of)
    # draws along straight lines, one open parameter after the other, left out 1 in 6
    assert np.mean(np.abs(np.array(ranks) - 0.5) > 0.475) < 0.1


@pytest.mark.thorough
def test_draws_have_the_quantiles_of_the_likelihood_on_a_grid():
    """The cost to the power -n/2 over points that fill the box, on the scale of the search; residuals here are not
    correlated."""
    for problem, z, _ in records([121, 129]):
        drawn = plausible(problem, z, roughly_known(problem, z), 2000, seed=1).values[1:]
        np.testing.assert_array_equal(plausible(problem, z, roughly_known(problem, z), 2000, seed=1).values[1:], drawn)
        points = stats.qmc.Sobol(3, seed=0).random(2**13)
        n = effective_samples(np.asarray(problem.residuals(z)), residual_blocks(problem), 3)[0]
        weight = np.exp(-0.5 * n * np.log(np.asarray(problem.costs(points)) / float(problem.cost(z))))
        assert np.sum(weight) ** 2 / np.sum(weight**2) > 300  # enough of them count
        values = np.asarray(problem.space.physical(points))
        for i in range(3):
            order = np.argsort(values[:, i])
            share = np.cumsum(weight[order]) / np.sum(weight)
            for level in (0.05, 0.25, 0.5, 0.75, 0.95):
                end = values[order, i][np.searchsorted(share, level)]
                assert abs(np.mean(drawn[:, i] < end) - level) < 0.06


@pytest.mark.thorough
def test_walkers_draw_from_a_curved_density():
    """Rosenbrock's valley: x normal, y about x^2; the moments are known."""
    rng = np.random.default_rng(1)

    def log_density(v):
        return -0.5 * v[:, 0] ** 2 - 0.5 * ((v[:, 1] - v[:, 0] ** 2) / 0.2) ** 2

    starts = rng.uniform(-1, 1, (2000, 2))
    draws = walked(log_density, starts, 150, 20, 1)
    drawn, later = next(draws), next(draws)
    assert np.mean(np.all(later == drawn, axis=1)) < 0.1
    assert np.array_equal(next(walked(log_density, starts, 150, 20, 1)), drawn)
    assert stats.kstest(drawn[:, 0], "norm").pvalue > 0.001
    assert stats.kstest((drawn[:, 1] - drawn[:, 0] ** 2) / 0.2, "norm").pvalue > 0.001
