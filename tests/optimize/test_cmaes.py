"""The CMA-ES family: rates against other formulas and libraries, one update against plain numpy, warm starts,
restarts."""

import math

import numpy as np
import pytest
from cmaes import CMA

from plantfit.optimize import Objective, minimise
from plantfit.optimize.algorithms.cma_es.bipop import BipopCmaEs, small_run
from plantfit.optimize.algorithms.cma_es.bound_penalty import mirrored
from plantfit.optimize.algorithms.cma_es.cmaes import CmaEs
from plantfit.optimize.algorithms.cma_es.dd_cmaes import DecodingCmaEs
from plantfit.optimize.algorithms.cma_es.ipop import IpopCmaEs
from plantfit.optimize.algorithms.cma_es.learning_rates import decoding_rates, full_rates, separable_rates, weights
from plantfit.optimize.algorithms.cma_es.restarts import Restarts
from plantfit.optimize.algorithms.cma_es.separable_cmaes import SeparableCmaEs
from plantfit.optimize.contract import Facts
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.nested import Nested

import jax
import jax.numpy as jnp

FAMILY = [CmaEs, SeparableCmaEs, DecodingCmaEs]


@pytest.mark.parametrize("n", [1, 2, 10, 310])
def test_weights_and_rates(n):
    rows = 4 + int(3 * np.log(n))
    s = weights(rows, n)
    assert np.isclose(s.parents.sum(), 1.0)
    assert np.isclose(s.mu_eff, 1 / np.sum(s.parents**2))
    for r in (full_rates(rows, n), separable_rates(rows, n), decoding_rates(rows, n, n)):
        assert np.allclose(r.w[r.w > 0], s.parents[s.parents > 0])
        assert r.w[r.w < 0].sum() < 0
        assert 0 < r.c_1 + r.c_mu <= 1
    r = full_rates(rows, n)
    # positive definite even if all negative weights fall on one axis
    assert 1 - r.c_1 - r.c_mu * r.w.sum() + n * r.c_mu * r.w[r.w < 0].sum() >= -1e-12


@pytest.mark.parametrize("n", [3, 10, 40])
def test_rates_agree_with_the_cmaes_package(n):
    other = CMA(mean=np.zeros(n), sigma=1.0)
    r, s = full_rates(other.population_size, n), weights(other.population_size, n)
    assert np.isclose(s.mu_eff, other._mu_eff)
    assert np.isclose(s.c_sigma, other._c_sigma)
    assert np.isclose(s.d_sigma, other._d_sigma)
    assert np.isclose(r.c_1, other._c1)
    assert np.isclose(r.c_c, other._cc)


def _one_generation(method, n, seed=3):
    state = method.init(jax.random.key(seed), Facts(n, 1000, start=np.full((1, n), 0.5)))
    x, asked = method.ask(jax.random.key(seed + 1), state)
    f = np.asarray(jnp.sum((x - 0.4) ** 2 * jnp.arange(1, n + 1), axis=1))
    told, _ = method.tell(asked, x, jnp.asarray(f))
    return np.asarray(x), f, told


@pytest.mark.thorough
def test_one_update_of_the_full_matrix():
    n, sigma = 4, 0.05
    x, f, told = _one_generation(CmaEs(sigma=sigma), n)
    r, s = full_rates(len(f), n), weights(len(f), n)
    y = (x[np.argsort(f)] - 0.5) / sigma
    step = s.parents @ y
    path_sigma = math.sqrt(s.c_sigma * (2 - s.c_sigma) * s.mu_eff) * step
    length = np.linalg.norm(path_sigma)
    h = float(length / math.sqrt(1 - (1 - s.c_sigma) ** 2) < (1.4 + 2 / (n + 1)) * s.chi)
    path = h * math.sqrt(r.c_c * (2 - r.c_c) * s.mu_eff) * step
    cov = (1 + r.c_1 * (1 - h) * r.c_c * (2 - r.c_c) - r.c_1 - r.c_mu * r.w.sum()) * np.eye(n) + r.c_1 * np.outer(
        path, path
    )
    for w, v in zip(r.w, y, strict=True):
        cov += r.c_mu * (w if w >= 0 else w * n / (v @ v)) * np.outer(v, v)
    assert np.allclose(told.mean, 0.5 + sigma * step, atol=1e-14)
    assert np.allclose(told.cov, cov, atol=1e-12)
    assert np.isclose(told.sigma, sigma * math.exp(s.c_sigma / s.d_sigma * (length / s.chi - 1)))


def test_one_update_of_the_scales():
    n, sigma = 4, 0.05
    x, f, told = _one_generation(DecodingCmaEs(sigma=sigma), n)
    r, s = decoding_rates(len(f), n, n), weights(len(f), n)
    z = (x[np.argsort(f)] - 0.5) / sigma
    step = s.parents @ z
    length = math.sqrt(s.c_sigma * (2 - s.c_sigma) * s.mu_eff) * np.linalg.norm(step)
    h = float(length / math.sqrt(1 - (1 - s.c_sigma) ** 2) < (1.4 + 2 / (n + 1)) * s.chi)
    fresh = r.c_c * (2 - r.c_c)
    change = r.c_1 * h * fresh * (s.mu_eff * step**2 - 1)
    for w, v in zip(r.w, z, strict=True):
        change += r.c_mu * (w if w >= 0 else w * n / (v @ v)) * (v**2 - 1)
    assert np.allclose(told.shape.scales, np.exp(change / 2), atol=1e-12)


@pytest.mark.thorough
def test_decoding_keeps_its_matrix_through_a_refresh():
    method = DecodingCmaEs()
    _, _, told = _one_generation(method, 5)
    shape = told.shape
    before = np.asarray(shape.scales)[:, None] * (np.eye(5) + np.asarray(shape.pending)) * np.asarray(shape.scales)
    after = method.refresh(told)
    assert np.allclose(after.cov, before, atol=1e-12)
    assert np.allclose(np.diag(after.shape.correlations), 1.0)
    assert np.allclose(after.shape.root @ after.shape.inverse, np.eye(5), atol=1e-10)


@pytest.mark.parametrize("kind", FAMILY)
@pytest.mark.thorough
def test_failed_candidates_have_no_weight(kind):
    method = kind(sigma=0.1)
    state = method.init(jax.random.key(0), Facts(3, 1000))
    x, asked = method.ask(jax.random.key(1), state)
    f = jnp.arange(len(x), dtype=float).at[2:].set(jnp.inf)
    told, _ = method.tell(asked, x, f)
    w = weights(len(x), 3).parents[:2]
    raw = np.asarray(asked.raw)
    assert np.allclose(told.mean, (w / w.sum()) @ raw[:2], atol=1e-12)
    dead, info = method.tell(asked, x, jnp.full(len(x), jnp.inf))
    assert np.all(np.isfinite(dead.mean))
    assert int(dead.restarts) == 1
    assert not bool(info["stop"])


@pytest.mark.parametrize("kind", FAMILY)
def test_search_begins_at_the_warm_start(kind):
    n = 6
    start = np.linspace(0.2, 0.7, n)[None]
    state = kind(sigma=0.01).init(jax.random.key(0), Facts(n, 1000, start=start))
    assert np.array_equal(state.mean, start[0])
    assert float(state.sigma) == 0.01
    x, _ = kind(sigma=0.01).ask(jax.random.key(1), state)
    assert 0.001 < np.std(np.asarray(x) - start) < 0.02


def test_mean_moves_to_the_best_of_several_starts():
    n, method = 4, CmaEs(sigma=0.02)
    starts = np.array([[0.2] * n, [0.8] * n])
    state = method.init(jax.random.key(0), Facts(n, 1000, start=starts))
    x, asked = method.ask(jax.random.key(1), state)
    x = x.at[:2].set(starts)
    told, _ = method.tell(asked, x, jnp.sum((x - 0.81) ** 2, axis=1))
    assert np.allclose(told.mean, starts[1])
    assert float(told.sigma) == 0.02
    assert np.allclose(told.cov, np.eye(n))


@pytest.mark.parametrize("kind", FAMILY)
@pytest.mark.parametrize("bounds", ["penalty", "mirror"])
def test_own_candidates_that_were_rounded_otherwise_are_not_foreign(kind, bounds):
    """XLA may make a candidate and the point that it is held against in two loops, of which one has fused products: in
    five dimensions both differed in their last bit, and a first generation moved the mean to its best candidate."""
    method = kind(sigma=0.3, bounds=bounds)
    state = method.init(jax.random.key(0), Facts(5, 1000))
    x, asked = method.ask(jax.random.key(1), state)
    f = jnp.sum((x - 0.3) ** 2, axis=1)
    own, _ = method.tell(asked, x, f)
    for rounded in (jnp.nextafter(x, 2.0), jnp.nextafter(x, -1.0)):
        told, _ = method.tell(asked, rounded, f)
        assert all(jax.tree.leaves(jax.tree.map(lambda a, b: np.array_equal(a, b, equal_nan=True), told, own)))
    moved, _ = method.tell(asked, x.at[0].add(1e-6), f.at[0].set(-1.0))
    assert np.allclose(moved.mean, x[0] + 1e-6, atol=1e-12)


@pytest.mark.parametrize("name", ["cmaes", "dd_cmaes", "bipop_cmaes"])
@pytest.mark.thorough
def test_warm_start_stays_in_its_valley(name):
    def two_valleys(x):
        # the narrow one, far from most of the cube, is the shallower
        return jnp.minimum(jnp.sum((x - 0.9) ** 2, axis=1) + 0.1, jnp.sum((x - 0.2) ** 2, axis=1))

    objective = Objective(5, two_valleys, start=np.full((1, 5), 0.88))
    [r] = minimise(objective, name, budget=400, seed=2, settings={"sigma": 0.01})
    assert np.allclose(r.x, 0.9, atol=1e-2)


def test_mirror_folds_into_the_cube():
    assert np.allclose(
        mirrored(jnp.array([-0.25, 0.3, 1.2, 2.1, -1.5, 0.0, 1.0])), [0.25, 0.3, 0.8, 0.1, 0.5, 0.0, 1.0]
    )


def test_every_second_search_folds_back_at_the_bounds():
    """Far outside in one coordinate: the first search pays for the distance, its restart folds it back, the next one
    pays again."""
    n = 3
    for bounds, folds in (("auto", [False, True, False, True]), ("penalty", [False] * 4), ("mirror", [True] * 4)):
        method = CmaEs(bounds=bounds, sigma=0.01)
        state = method.init(jax.random.key(0), Facts(n, 1000, start=np.full((1, n), 0.5)))
        state = state._replace(mean=jnp.array([1.3, 0.5, -0.2]), penalty=state.penalty._replace(gamma=jnp.full(n, 1e3)))
        for restarts, folded in enumerate(folds):
            x, asked = method.ask(jax.random.key(1), state._replace(restarts=jnp.asarray(restarts)))
            raw = np.asarray(asked.raw)
            assert np.all(raw[:, 0] > 1.2)
            assert np.allclose(x, np.asarray(mirrored(jnp.asarray(raw))) if folded else np.clip(raw, 0, 1))
            # costs that prefer what lies inside in the middle coordinate only
            f = np.asarray((x[:, 1] - 0.4) ** 2)
            told, _ = method.tell(asked, x, jnp.asarray(f))
            paid = 0.0 if folded else np.mean(1e3 * (raw - np.clip(raw, 0, 1)) ** 2, axis=1)  # C is the identity
            best = raw[np.argsort(f + paid)]
            assert np.allclose(told.mean, weights(len(f), n).parents @ best, atol=1e-12)


def test_numbered_searches_of_ipop_alternate():
    """Runs of Restarts are searches of their own; each carries its number, so that the second folds back too."""
    folds = []
    objective = Objective(2, lambda x: jnp.sum((x - 0.3) ** 2, axis=1))
    counter = Counter(objective, 10**5)
    runs = Restarts(jax.random.key(0), objective, counter, None)
    asked, plain = [], Nested.generation

    def generation(self, counter):
        asked.append((int(self.state.restarts), bool(self.method._folds(self.state))))
        return plain(self, counter)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Nested, "generation", generation)
        for _ in range(3):
            runs.run(6, most=60)
            folds.append(asked[-1])
    assert folds == [(0, False), (1, True), (2, False)]


def test_small_runs_lie_between_the_first_population_and_half_the_large_one():
    for u in np.linspace(0, 1, 21):
        rows, shrink = small_run(10, 160, u, u)
        exact = 10 * 8 ** (u * u)
        assert exact / 2**0.26 - 1 <= rows <= exact * 2**0.26
        assert np.isclose(shrink, 10 ** (-2 * u))


def test_ipop_doubles_and_bipop_shares_its_budget(monkeypatch):
    sizes = []

    def run(self, population, shrink=1.0, most=math.inf):
        sizes.append((population, shrink, most))
        self.runs += 1
        return int(min(100 * population, most))

    monkeypatch.setattr(Restarts, "run", run)
    objective = Objective(10, lambda x: jnp.sum(x, axis=1))
    IpopCmaEs(restarts=3).run(jax.random.key(0), objective, 10**6, Counter(objective, 10**6))
    assert [s[0] for s in sizes] == [10, 20, 40, 80]
    sizes.clear()
    BipopCmaEs(restarts=4).run(jax.random.key(0), objective, 10**6, Counter(objective, 10**6))
    large = [s for s in sizes[1:] if s[2] == math.inf]
    small = [s for s in sizes[1:] if s[2] < math.inf]
    assert [s[0] for s in large] == [20, 40, 80, 160]
    spent = sum(min(100 * rows, most) for rows, _, most in small)
    assert sum(100 * rows for rows, *_ in large[:-1]) < spent + 100 * 80
    assert all(0.01 <= shrink <= 1 for _, shrink, _ in small)
    last, limits = 0, []
    for rows, _, most in sizes[1:]:
        if most == math.inf:
            last = 100 * rows
        else:
            limits.append(most <= max(last / 2, rows))
    assert all(limits)


@pytest.mark.thorough
def test_restarts_end_a_flat_search():
    [r] = minimise(Objective(2, lambda x: 0.0 * x[:, 0]), "cmaes", budget=50_000, settings={"restarts": 2})
    assert r.status == "converged"
    assert r.evaluations < 2000


@pytest.mark.slow
def test_decoding_beats_the_full_matrix_on_many_scales():
    n = 60
    scale = 10.0 ** (4 * np.arange(n) / (n - 1))
    objective = Objective(n, lambda x: jnp.sum(scale * (x - 0.4) ** 2, axis=1))
    full, decoded = (
        np.median([r.cost for r in minimise(objective, m, runs=3, budget=12_000, seed=1)])
        for m in ("cmaes", "dd_cmaes")
    )
    assert decoded < 1e-3 * full
