"""Genetic algorithms: operators against closed forms and plain loops, populations, precision, structural bias."""

import numpy as np
import pytest
from scipy import stats

from plantfit.optimize import Objective, minimise
from plantfit.optimize.algorithms.genetic import operators
from plantfit.optimize.algorithms.genetic.binary_ga import BinaryGenetic, decode, encode, flip, one_point
from plantfit.optimize.algorithms.genetic.cga import ContinuousGenetic
from plantfit.optimize.algorithms.genetic.elite_ga import EliteGenetic
from plantfit.optimize.algorithms.genetic.operators import Pool
from plantfit.optimize.contract import Facts

import jax
import jax.numpy as jnp

GRID = jnp.asarray((np.arange(20_000) + 0.5) / 20_000)
D = 5
OPTIMUM = np.linspace(0.2, 0.85, D)


def sphere(x):
    return jnp.sum((10 * (x - OPTIMUM)) ** 2, axis=1)


def noise(x):
    """A number in [0, 1) that depends on x through every bit (splitmix64): no place of the cube is better than
    another."""
    word = jax.lax.bitcast_convert_type(x, jnp.uint64)
    total = jnp.zeros(len(x), jnp.uint64)
    for j in range(x.shape[1]):
        z = (total ^ word[:, j]) + jnp.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> 30)) * jnp.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> 27)) * jnp.uint64(0x94D049BB133111EB)
        total = z ^ (z >> 31)
    return (total >> 11).astype(float) / 2.0**53


@pytest.mark.parametrize(("size", "alive"), [(1, 7), (2, 50), (3, 12), (3, 1)])
def test_tournament_has_the_distribution_of_the_least_rank(size, alive):
    ranks = np.asarray(operators.tournament(GRID, size, alive))
    r = np.arange(alive)
    expected = ((alive - r) ** size - (alive - r - 1) ** size) / alive**size
    np.testing.assert_allclose(np.bincount(ranks, minlength=alive) / len(GRID), expected, atol=2e-4)


def test_blend_is_uniform_beyond_the_parents():
    child = np.asarray(operators.blend(GRID, jnp.full(len(GRID), 0.7), jnp.full(len(GRID), 0.3), 0.5))
    np.testing.assert_allclose(child, 0.1 + 0.8 * GRID, atol=1e-12)


def test_simulated_binary_keeps_the_mean_and_has_the_published_spread():
    a, b, eta = 0.9, 0.1, 15.0
    one, two = (
        np.asarray(c) for c in operators.simulated_binary(GRID, jnp.full(len(GRID), a), jnp.full(len(GRID), b), eta)
    )
    np.testing.assert_allclose(one + two, a + b, atol=1e-12)
    beta = (one - two) / (a - b)
    assert np.isclose(np.mean(beta < 0), 0.5)  # which child gets which value
    crossed = np.abs(np.abs(beta) - 1) > 1e-12
    assert np.isclose(np.mean(crossed), 0.5, atol=1e-3)

    def cdf(s):
        return np.where(s <= 1, 0.5 * s ** (eta + 1), 1 - 0.5 * s ** -(eta + 1))

    assert stats.kstest(np.abs(beta[crossed]), cdf).statistic < 1e-3


def test_polynomial_mutation_has_the_published_distribution_and_rate():
    rate, eta = 0.25, 20.0
    moved = np.asarray(operators.polynomial_mutation(GRID, jnp.zeros(len(GRID)), eta, rate))
    assert np.all(moved[rate <= GRID] == 0)

    def cdf(delta):
        return np.where(delta < 0, 0.5 * (1 + delta) ** (eta + 1), 1 - 0.5 * (1 - delta) ** (eta + 1))

    assert stats.kstest(moved[rate > GRID], cdf).statistic < 1e-3


def test_reflect_mirrors_and_leaves_the_inside_alone():
    z = np.array([-0.25, 0.0, 1e-20, 0.3, 1.0, 1.25, 2.0])
    np.testing.assert_allclose(operators.reflect(jnp.asarray(z)), [0.25, 0.0, 1e-20, 0.3, 1.0, 0.75, 0.0], rtol=1e-15)


def test_uniforms_cuts_one_draw():
    one, two = operators.uniforms(jax.random.key(1), (2, 3), (4,))
    np.testing.assert_array_equal(np.concatenate([np.ravel(one), two]), jax.random.uniform(jax.random.key(1), (10,)))


@pytest.mark.parametrize("gray", [True, False])
@pytest.mark.parametrize("bits", [2, 9, 16])
def test_code_round_trip(bits, gray):
    levels = np.arange(2**bits)
    words = encode(jnp.asarray(levels / (2**bits - 1)), bits, gray)
    np.testing.assert_array_equal(words, levels ^ (levels >> 1) if gray else levels)
    points = np.asarray(decode(words, bits, gray))
    np.testing.assert_allclose(points, levels / (2**bits - 1), rtol=1e-15)
    assert points.max() <= 1.0
    if gray:
        neighbours = np.asarray(words)[1:] ^ np.asarray(words)[:-1]
        assert all(int(w).bit_count() == 1 for w in neighbours)


def test_bit_operators_against_strings():
    rng = np.random.default_rng(3)
    bits, d = 7, 3
    a, b = rng.integers(0, 2**bits, (2, 40, d)).astype(np.uint32)
    cut, place = rng.integers(1, bits * d, (40, 1)), rng.integers(0, bits * d, (40, 1))

    def text(words):
        return ["".join(f"{w:0{bits}b}" for w in row) for row in np.asarray(words)]

    child, turned = (
        text(one_point(jnp.asarray(a), jnp.asarray(b), jnp.asarray(cut), bits)),
        text(flip(jnp.asarray(a), jnp.asarray(place), bits)),
    )
    for k in range(40):
        assert child[k] == text(a)[k][: cut[k, 0]] + text(b)[k][cut[k, 0] :]
        different = [i for i, (p, q) in enumerate(zip(text(a)[k], turned[k], strict=True)) if p != q]
        assert len(different) == 1
        assert different[0] // bits == place[k, 0] // bits


def test_replace_worst_is_one_child_after_another():
    rng = np.random.default_rng(5)
    for _ in range(20):
        x = rng.integers(0, 3, (6, 2)) / 2.0
        cost = lambda z: np.where(z[:, 0] == 1.0, np.inf, 3 * z[:, 0] + z[:, 1])  # noqa: E731
        x = np.unique(x, axis=0)
        children = rng.integers(0, 5, (8, 2)) / 4.0
        order = np.argsort(cost(x), kind="stable")
        pool = Pool(jnp.asarray(x[order]), jnp.asarray(cost(x)[order]))
        members = [(f, tuple(p)) for f, p in zip(cost(x), x, strict=True)]
        for f, p in zip(cost(children), map(tuple, children), strict=True):
            worst = max(range(len(members)), key=lambda i: members[i][0])
            if f < members[worst][0] and p not in [m[1] for m in members]:
                members[worst] = (f, p)
        new = operators.replace_worst(pool, jnp.asarray(children), jnp.asarray(cost(children)))
        np.testing.assert_array_equal(new.f, sorted(m[0] for m in members))


def _generations(method, cost, count, d=D, budget=10_000):
    """(x, f, state told) of each generation."""
    state = method.init(jax.random.key(0), Facts(d, budget))
    ask, tell = jax.jit(method.ask), jax.jit(method.tell)
    for g in range(count):
        x, state = ask(jax.random.key(g + 1), state)
        f = np.asarray(cost(np.asarray(x)))
        state, _ = tell(state, x, f)
        yield np.asarray(x), f, state


@pytest.mark.parametrize(
    ("method", "elite"),
    [(ContinuousGenetic(population=40), 2), (BinaryGenetic(population=20), 1), (EliteGenetic(population=20), 4)],
    ids=["cga", "binary", "elite"],
)
def test_elites_survive_without_evaluation(method, elite):
    n = len(method.init(jax.random.key(0), Facts(D, 10_000)).pool.f)
    assert method.rows(Facts(D, 10_000)) == n - elite
    before = None
    for _, f, state in _generations(method, lambda x: np.asarray(sphere(x)), 3):
        kept = np.sort(f if before is None else np.concatenate([before[:elite], f]))
        np.testing.assert_array_equal(np.asarray(state.pool.f)[: len(kept)], kept)
        assert np.sum(np.isfinite(state.pool.f)) == (n - elite if before is None else n)
        before = kept


@pytest.mark.parametrize(
    "method",
    [
        ContinuousGenetic(crossover_rate=0.0, mutation_index=1000.0),
        ContinuousGenetic(crossover_rate=0.0, mutation_index=1000.0, replacement="steady_state", children=50),
        BinaryGenetic(crossover_rate=0.0, mutation_rate=0.0),
        EliteGenetic(mutation_rate=0.0, immigrants=0),
    ],
    ids=["cga", "steady", "binary", "elite"],
)
def test_failed_points_are_never_parents(method):
    def cost(x):
        return np.where(x[:, 0] < 0.5, np.inf, np.asarray(sphere(x)))

    *_, (x, _, _) = _generations(method, cost, 2)
    assert np.all(x[:, 0] > 0.49)


def test_binary_rates_as_fractions():
    method = BinaryGenetic(rates="fractions", crossover_rate=0.6, population=51, tournament=1)
    first, second = _generations(method, lambda x: np.zeros(len(x)), 2)
    crossed, copies = np.split(np.asarray(encode(jnp.asarray(second[0]), 16, True)), [30])
    known = {w.tobytes() for w in np.asarray(first[2].pool.x)}
    turned = [min(sum(int(g).bit_count() for g in row ^ np.frombuffer(k, np.uint32)) for k in known) for row in copies]
    assert turned == [1] * 20
    assert sum(row.tobytes() not in known for row in crossed) > 15


def test_paper_variant_takes_the_published_numbers():
    method = EliteGenetic(variant="paper")
    assert method.sizes() == (500, 10, 10)
    *_, (x, _, _) = _generations(EliteGenetic(variant="paper", mutation_rate=0.0), lambda x: np.asarray(sphere(x)), 2)
    one, two = x[:240], x[240:480]  # both children of a pair: their genes together are those of the two parents
    assert len(np.unique(np.concatenate([one, two]).round(12))) < 500 * D
    assert len(np.unique(np.sort(np.stack([one, two]), axis=0)[0, :, 0])) < 240


def test_linear_schedule_ends_with_small_moves():
    method = EliteGenetic(schedule="linear", immigrants=0, gamma=0.5)
    assert method.needs.schedule_bound
    assert not EliteGenetic().needs.schedule_bound
    steps = []
    before = None
    for x, _, state in _generations(method, lambda x: np.zeros(len(x)), 25, budget=25 * 40):
        if before is not None:
            steps.append(max(np.min(np.abs(before[:, 0] - v)) for v in x[:, 0]))
        before = np.asarray(state.pool.x)
    assert 0 < steps[-1] <= 0.5 / 25
    assert max(steps[:5]) > 0.02


@pytest.mark.parametrize(
    ("method", "settings", "low", "high"),
    [
        ("cga", {"crossover": "blx"}, 0.0, 1e-4),  # blx mixes widely to the end
        ("cga", {"crossover": "sbx"}, 0.0, 1e-6),
        ("cga", {"replacement": "steady_state", "crossover": "blx"}, 0.0, 1e-6),
        ("binary_ga", {}, 1e-9, 3e-8),  # 16 bits: the grid
        ("binary_ga", {"coding": "plain"}, 1e-6, 2.0),  # Hamming cliffs
        ("elite_ga", {}, 0.0, 1e-3),
    ],
)
@pytest.mark.further(1)
def test_median_on_the_sphere(method, settings, low, high):
    results = minimise(Objective(D, sphere), method, runs=9, budget=20_000, seed=3, settings=settings)
    assert low <= np.median([r.cost for r in results]) < high


def _bias(method, settings):
    """Kolmogorov-Smirnov distance of 2000 final coordinates on noise from uniform ones; 0.03 is its 5 % limit."""
    results = minimise(
        Objective(25, noise), method, runs=80, budget=1500, seed=6, settings={"population": 30, **settings}
    )
    return stats.kstest(np.concatenate([r.x for r in results]), "uniform").statistic


@pytest.mark.parametrize(("method", "settings"), [("cga", {"crossover": "sbx"}), ("binary_ga", {}), ("elite_ga", {})])
@pytest.mark.thorough
def test_best_points_on_noise_are_uniform(method, settings):
    assert _bias(method, settings) < 0.03


@pytest.mark.parametrize(("method", "settings"), [("cga", {"crossover": "blx"}), ("pso", {})])
def test_documented_lean_towards_the_middle(method, settings):
    assert 0.03 < _bias(method, settings) < 0.08
