"""Morris and Sobol sensitivity against closed forms and against SALib run alone."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from SALib.analyze import morris as salib_analyze
from SALib.sample import morris as salib_sample

from plantfit.errors import Interrupted, SearchError, SpaceError
from plantfit.space import Parameter, Space
from plantfit.trust import morris, sobol_indices


@dataclass(frozen=True)
class Studied:
    """A function of coordinates (d, n) in the unit cube as something with a space and costs."""

    space: Space
    function: Callable[[np.ndarray], np.ndarray | float]

    def costs(self, zs):
        return self.function(np.asarray(zs).T) * np.ones(len(zs))


def studied(function, count):
    return Studied(Space({f"x{i}": Parameter((0.0, 1.0)) for i in range(1, count + 1)}), function)


def ishigami(z):
    x = math.pi * (2 * z - 1)
    return np.sin(x[0]) + 7 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


A = np.array([0.0, 1.0, 4.5, 9.0])


def sobol_g(z):
    return np.prod((np.abs(4 * z.T - 2) + A) / (1 + A), axis=1)


def test_sobol_indices_of_ishigami():
    """First and total in closed form: T. Ishigami, T. Homma (1990); a = 7, b = 0.1."""
    found = sobol_indices(studied(ishigami, 3), samples=8192, resamples=100)
    a, b, p4, p8 = 7.0, 0.1, math.pi**4, math.pi**8
    v1, v2, v13 = 0.5 * (1 + b * p4 / 5) ** 2, a**2 / 8, 8 * b**2 * p8 / 225
    v = v1 + v2 + v13
    np.testing.assert_allclose(found.first, [v1 / v, v2 / v, 0.0], atol=0.012)
    np.testing.assert_allclose(found.total, [(v1 + v13) / v, v2 / v, v13 / v], atol=0.012)
    assert np.all(np.abs(found.first - [v1 / v, v2 / v, 0.0]) <= 2 * found.first_half_width)
    assert found.evaluations == 8192 * 5
    assert found.dropped == 0


def test_sobol_indices_of_the_g_function_by_group():
    """V_i = 1/(3 (1 + a_i)^2), V = prod(1 + V_i) - 1: A. Saltelli, I. Sobol (1995). A group's first index is that of
    its product."""
    partial = 1 / (3 * (1 + A) ** 2)
    v = np.prod(1 + partial) - 1
    alone = sobol_indices(studied(sobol_g, 4), samples=4096, resamples=100)
    np.testing.assert_allclose(alone.first, partial / v, atol=0.015)
    np.testing.assert_allclose(
        alone.total, [p * np.prod(1 + np.delete(partial, i)) / v for i, p in enumerate(partial)], atol=0.015
    )
    both = sobol_indices(
        studied(sobol_g, 4), groups={"rough": ["x1", "x3"], "calm": ["x2", "x4"]}, samples=4096, resamples=100
    )
    assert (both.groups, both.sizes) == (("rough", "calm"), (2, 2))
    rough, calm = (np.prod(1 + partial[i]) - 1 for i in ([0, 2], [1, 3]))
    np.testing.assert_allclose(both.first, [rough / v, calm / v], atol=0.015)
    np.testing.assert_allclose(both.total, [rough * (1 + calm) / v, calm * (1 + rough) / v], atol=0.015)


def test_screening_is_that_of_salib_run_alone():
    """The same points, costs one by one, SALib's own analysis: the same numbers."""
    one = (0.0, 1.0)
    space = Space({"k": Parameter(one, shape=(5,)), "tau": Parameter(one), "gain": Parameter(one)})
    problem = Studied(space, lambda z: np.sum(np.sin(3 * z[:5]), axis=0) + 5 * z[5] * z[6] ** 2)
    at = np.array([0.3, 0.5, 0.004, 0.7, 0.999, 0.2, 0.9])
    found = morris(problem, at, radius=0.01, trajectories=8, pool=30, seed=3)
    draws, resampling = np.random.default_rng(3).spawn(2)
    design = {
        "num_vars": 7,
        "names": list(problem.space.names),
        "groups": ["k"] * 5 + ["tau", "gain"],
        "bounds": [[max(v - 0.01, 0.0), min(v + 0.01, 1.0)] for v in at],
    }
    points = salib_sample.sample(design, 30, num_levels=4, optimal_trajectories=8, seed=draws)
    assert points.min() >= 0
    assert points.max() <= 1
    costs = np.array([problem.costs(row[None, :])[0] for row in points])
    alone = salib_analyze.analyze(design, points, costs, num_resamples=1000, num_levels=4, seed=resampling)
    assert found.groups == tuple(alone["names"]) == ("k", "tau", "gain")
    np.testing.assert_array_equal(found.mu_star, alone["mu_star"])
    np.testing.assert_array_equal(found.half_width, alone["mu_star_conf"])
    np.testing.assert_array_equal(found.sigma[1:], alone["sigma"][1:])
    assert found.evaluations == len(points) == 32


def test_trajectories_are_chosen_once_for_all_points(monkeypatch):
    """They do not depend on the point, and choosing takes longer than the costs."""
    asked, sample = [], salib_sample.sample
    monkeypatch.setattr(salib_sample, "sample", lambda *given, **named: asked.append(0) or sample(*given, **named))
    problem = studied(ishigami, 3)
    around = [
        morris(problem, at, radius=0.1, trajectories=4, pool=9, seed=11) for at in ([0.2, 0.3, 0.4], [0.7, 0.6, 0.5])
    ]
    assert len(asked) == 1
    assert not np.array_equal(around[0].mu_star, around[1].mu_star)
    morris(problem, [0.2, 0.3, 0.4], radius=0.1, trajectories=4, pool=9, seed=12)
    assert len(asked) == 2


def test_effects_of_a_straight_line():
    """Each elementary effect is slope times width, whatever the trajectory: mu* = |slope|, sigma and interval 0."""
    found = morris(studied(lambda z: 3 * z[0] - 0.5 * z[1] + 2, 3), np.full(3, 0.5), radius=0.1, seed=5)
    np.testing.assert_allclose(found.mu_star, [0.6, 0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.mu, [0.6, -0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose([*found.sigma, *found.half_width], 0.0, atol=1e-12)


def test_trajectories_that_failed_are_left_out_whole():
    plain = studied(lambda z: 3 * z[0] - 0.5 * z[1], 2)
    failing = studied(lambda z: np.where((z[0] > 0.6) & (z[1] > 0.6), np.inf, 3 * z[0] - 0.5 * z[1]), 2)
    found = morris(failing, radius=None, trajectories=20, pool=40)
    assert 0 < found.dropped < 19
    np.testing.assert_allclose(found.mu_star, morris(plain, radius=None, trajectories=20, pool=40).mu_star, atol=1e-12)
    with pytest.raises(SearchError, match="Only 0 of 20 trajectories"):
        morris(studied(lambda z: np.nan, 2))


def test_samples_that_failed_are_left_out_with_their_copies():
    """The corner that fails is a box of its own, so that what is left keeps x1 and x2 independent; x3 alone fails
    here."""
    plain = studied(lambda z: z[0] + 0.5 * z[1], 3)
    failing = studied(lambda z: np.where(z[2] > 0.9, np.nan, z[0] + 0.5 * z[1]), 3)
    found, whole = sobol_indices(failing, samples=2048, resamples=50), sobol_indices(plain, samples=2048, resamples=50)
    assert 0.1 < found.dropped / found.samples < 0.3
    np.testing.assert_allclose(found.first, [0.8, 0.2, 0.0], atol=0.03)
    np.testing.assert_allclose(found.total, whole.total, atol=0.03)


def test_intervals_of_mu_star_hold_what_many_trajectories_give():
    """Coverage of the bootstrap: 95 % intervals of 12 random trajectories against the mean of 2000."""
    problem = studied(sobol_g, 4)
    design = {"num_vars": 4, "names": list(problem.space.names), "bounds": [[0.0, 1.0]] * 4}
    points = salib_sample.sample(design, 2000, seed=np.random.default_rng(0))
    true = np.asarray(
        salib_analyze.analyze(design, points, problem.costs(points), num_resamples=10, seed=np.random.default_rng(1))[
            "mu_star"
        ]
    )
    inside = []
    for seed in range(25):
        found = morris(problem, radius=None, trajectories=12, pool=13, seed=seed)
        inside.append(np.abs(found.mu_star - true) <= found.half_width)
    assert 0.85 <= np.mean(inside) < 1.0


def test_coordinates_outside_of_the_groups_rest():
    seen = []

    def added(z):
        seen.append(z)
        return np.sum(z, axis=0)

    problem = Studied(Space({"k": Parameter((0, 1), shape=(3,)), "c": Parameter((0, 1))}), added)
    found = morris(problem, np.full(4, 0.3), groups={"first": ["k[0]"], "rest": ["c"]}, trajectories=4, pool=9)
    assert found.groups == ("first", "rest")
    assert np.all(np.concatenate(seen, axis=1)[1:3] == 0.3)


def test_what_does_not_fit_is_said():
    problem = studied(sobol_g, 4)
    for error, said, call in (
        (SpaceError, "names 'tau', which is no free parameter", lambda: morris(problem, groups={"g": ["tau"]})),
        (SpaceError, "'x1' is in the groups 'g' and 'h'", lambda: morris(problem, groups={"g": ["x1"], "h": ["x1"]})),
        (SpaceError, "groups is empty", lambda: morris(problem, groups={})),
        (SearchError, "radius = 0", lambda: morris(problem, radius=0.0)),
        (SearchError, "leaves the unit cube", lambda: morris(problem, np.full(4, 1.2))),
        (SearchError, "pool = 20", lambda: morris(problem, pool=20)),
        (SearchError, "levels = 5", lambda: morris(problem, levels=5)),
        (SearchError, "give 512 or 1024", lambda: sobol_indices(problem, samples=1000)),
        (SearchError, "confidence = 95", lambda: sobol_indices(problem, confidence=95)),
        (SearchError, "the cost is the same everywhere", lambda: sobol_indices(studied(lambda z: 1.0, 2), samples=64)),
        (Interrupted, "Stopped after 0 of", lambda: sobol_indices(problem, samples=64, stop=lambda: True)),
    ):
        with pytest.raises(error, match=said):
            call()


def test_progress_counts_points_and_the_seed_decides():
    problem, seen = studied(sobol_g, 4), []
    first = sobol_indices(problem, samples=128, progress=seen.append, seed=0)
    assert seen[-1].evaluations == seen[-1].budget_total == 128 * 6
    np.testing.assert_array_equal(first.total_half_width, sobol_indices(problem, samples=128, seed=0).total_half_width)
    assert np.any(first.total != sobol_indices(problem, samples=128, seed=4).total)
