"""The constrained least-squares optimum: against brute force, scipy, first-order conditions and a proven floor."""

import numpy as np
import pytest
from scipy.optimize import differential_evolution, least_squares

from plantfit.errors import ModelError
from plantfit.models.library.pendubot import pendubot_regression
from plantfit.models.library.pendubot_terms import base_values
from plantfit.problem.evaluate.compress import compress
from plantfit.trust.rigid_body.certified_floor import certified_floor
from plantfit.trust.rigid_body.constrained_optimum import constrained_optimum
from plantfit.trust.rigid_body.feasibility import LinkNames, link_constraints
from plantfit.trust.rigid_body.real_bodies import nearest_possible

NAMES = ("m1", "m2", "lc1", "lc2", "I1", "I2")
LOWER, UPPER = np.array([0.001, 0.001, 0.001, 0.001, 1e-4, 1e-4]), np.array([0.4, 0.4, 0.15, 0.3, 1e-3, 1e-3])
TRUTH = np.array([0.21, 0.1, 0.12, 0.15, 0.00053, 0.00077])
EDGE = np.array([0.39, 0.1, 0.149, 0.29, 1e-4, 9.9e-4])  # noise puts plain least squares outside
LINKS = [LinkNames("m1", "lc1", "I1", 0.15), LinkNames("m2", "lc2", "I2", 0.3)]


def coefficients(point):
    return np.array(list(base_values(dict(zip(NAMES, point, strict=True))).values()), dtype=float)


def record(seed, truth=TRUTH, noise=0.01, n=400):
    model, rng = pendubot_regression(), np.random.default_rng(seed)
    columns = model.columns({s: rng.uniform(-3, 3, n) for s in model.signals})
    return columns, columns @ coefficients(truth) + noise * rng.normal(size=n)


@pytest.fixture(scope="module")
def outside():
    return record(3, EDGE, noise=0.3)


@pytest.fixture(scope="module")
def optima(outside):
    """Without and with the constraints of links."""
    data = compress(*outside)
    return [
        constrained_optimum(data, base_values, NAMES, LOWER, UPPER, c, starts=6)
        for c in (None, link_constraints(LINKS))
    ]


@pytest.mark.parametrize("constrained", [False, True])
def test_an_optimum_outside_of_the_box_is_pressed_and_proven(outside, optima, constrained):
    data, found = compress(*outside), optima[constrained]
    assert not found.inside
    assert found.active
    assert found.cost > found.free_cost
    assert found.kkt < 1e-8
    values = np.array(list(found.values.values()))
    assert np.all((values >= LOWER) & (values <= UPPER))
    floor = certified_floor(data, base_values, NAMES, LOWER, UPPER, LINKS, found.cost, inside_links=constrained)
    assert floor.cost <= found.cost
    assert floor.gap < 1e-5
    assert "what holds it there" in found.sentence


def test_plain_least_squares_inside_the_box_is_the_optimum():
    columns, y = record(1)
    found = constrained_optimum(compress(columns, y), base_values, NAMES, LOWER, UPPER, starts=4)
    free, rest, *_ = np.linalg.lstsq(columns, y)
    assert found.inside
    assert found.active == ()
    np.testing.assert_allclose(found.coefficients, free, rtol=1e-6)
    assert found.cost == pytest.approx(rest[0] / len(y), rel=1e-10)
    assert "physically possible" in found.sentence


def test_scipys_bounded_least_squares_reaches_the_same_cost(outside, optima):
    (columns, y), found = outside, optima[0]
    rng, costs = np.random.default_rng(5), []
    width = UPPER - LOWER
    for _ in range(2):
        done = least_squares(
            lambda z: columns @ coefficients(LOWER + width * z) - y,
            rng.uniform(0.1, 0.9, 6),
            bounds=(0, 1),
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        costs.append(2 * done.cost / len(y))
    assert found.cost <= min(costs) * (1 + 1e-9)
    assert min(costs) == pytest.approx(found.cost, rel=1e-5)


def test_brute_force_finds_nothing_better_under_constraints(outside, optima):
    small, found = compress(*outside), optima[1]

    def cost(points):  # (6, m)
        m1, m2, c1, c2, i1, i2 = LOWER[:, None] + (UPPER - LOWER)[:, None] * points
        b = np.stack([m1 * c1**2 + m2 * 0.15**2 + i1, m2 * c2**2 + i2, m1 * c1 + m2 * 0.15, m2 * c2])
        value = (np.sum((small.R @ b - small.projected[:, None]) ** 2, axis=0) + small.rest) / small.n
        broken = np.maximum(i1 - m1 * c1 * (0.15 - c1), 0) + np.maximum(i2 - m2 * c2 * (0.3 - c2), 0)
        return value + 1e4 * broken

    done = differential_evolution(
        cost,
        [(0, 1)] * 6,
        rng=1,
        maxiter=600,
        popsize=20,
        tol=1e-12,
        vectorized=True,
        updating="deferred",
        polish=False,
    )
    assert done.fun >= found.cost * (1 - 1e-6)
    assert done.fun == pytest.approx(found.cost, rel=1e-3)


def test_two_parameters_against_a_grid():
    # y = a b x1 + a x2 with a + b <= 1
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(50, 2))
    y = columns @ [0.9 * 0.8, 0.9] + 0.1 * rng.normal(size=50)
    data = compress(columns, y)
    found = constrained_optimum(
        data, lambda p: [p["a"] * p["b"], p["a"]], "ab", [0, 0], [2, 2], {"a + b <= 1": lambda p: 1 - p["a"] - p["b"]}
    )
    a, b = np.meshgrid(np.linspace(0, 2, 1001), np.linspace(0, 2, 1001), indexing="ij")
    cost = (
        (data.R[0, 0] * a * b + data.R[0, 1] * a - data.projected[0]) ** 2
        + (data.R[1, 1] * a - data.projected[1]) ** 2
        + data.rest
    ) / data.n
    best = np.min(np.where(a + b <= 1 + 1e-12, cost, np.inf))
    assert found.active == ("a + b <= 1",)
    assert found.cost <= best * (1 + 1e-12)
    assert found.cost == pytest.approx(best, rel=1e-3)
    assert found.kkt < 1e-9


def test_an_upper_bound_on_inertia_needs_branching():
    # h and J of link 1 are told, its mass is held, so lc lies in the middle, where the chord is far from h^2/m
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[0], upper[0], upper[4] = 0.2, 0.22, 2e-4
    columns, y = record(2, np.array([0.21, 0.1, 0.08, 0.15, 9e-4, 7e-4]), noise=0.002)
    data = compress(columns, y)
    found = constrained_optimum(data, base_values, NAMES, lower, upper, starts=4)
    first = certified_floor(data, base_values, NAMES, lower, upper, LINKS, found.cost, tolerance=1.0)
    floor = certified_floor(data, base_values, NAMES, lower, upper, LINKS, found.cost, tolerance=1e-4)
    assert first.boxes == 1
    assert floor.boxes > 1
    assert first.gap > floor.gap
    assert floor.gap < 1e-4


def test_the_floor_is_below_every_point_of_the_box(outside):
    data = compress(*outside)
    floor = certified_floor(data, base_values, NAMES, LOWER, UPPER, LINKS, known=1.0, tolerance=1.0)
    rng = np.random.default_rng(4)
    for p in rng.uniform(LOWER, UPPER, (2000, 6)):
        m1, m2, c1, c2, i1, i2 = p
        b = np.array([m1 * c1**2 + m2 * 0.15**2 + i1, m2 * c2**2 + i2, m1 * c1 + m2 * 0.15, m2 * c2])
        assert (np.sum((data.R @ b - data.projected) ** 2) + data.rest) / data.n >= floor.cost


def test_whether_an_estimate_is_possible_is_told():
    b = coefficients(TRUTH)
    spread = np.diag((0.01 * b) ** 2)
    inside = nearest_possible(b, spread, base_values, NAMES, LOWER, UPPER, link_constraints(LINKS))
    assert inside.distance < 1e-6
    assert "physically possible, for example" in inside.sentence
    heavy = b.copy()
    heavy[1] = b[3] ** 2 / 0.4 - 1e-3  # less than the least inertia that b5 and the mass bound allow
    far = nearest_possible(heavy, spread, base_values, NAMES, LOWER, UPPER, link_constraints(LINKS))
    assert far.distance > 3
    assert far.p_value < 0.05
    assert "more than chance explains" in far.sentence


@pytest.mark.slow
def test_the_optimum_is_proven_global_for_many_noise_realisations():
    inside = 0
    for seed in range(24):
        columns, y = record(seed, *((TRUTH, 0.01) if seed % 2 else (EDGE, 0.2)))
        data = compress(columns, y)
        for constraints in ({}, link_constraints(LINKS)):
            found = constrained_optimum(data, base_values, NAMES, LOWER, UPPER, constraints, seed=seed)
            floor = certified_floor(
                data, base_values, NAMES, LOWER, UPPER, LINKS, found.cost, inside_links=bool(constraints)
            )
            assert floor.cost <= found.cost * (1 + 1e-12)
            assert floor.gap < 1e-5, (seed, constraints.keys(), found.sentence)
            assert found.kkt < 1e-6, (seed, found.sentence)
            inside += found.inside
    assert 5 < inside < 43  # both cases occur


def test_wrong_input_is_told_in_a_sentence():
    data = compress(*record(0))
    with pytest.raises(ModelError, match="No point of the box satisfies m1 >= 1"):
        constrained_optimum(data, base_values, NAMES, LOWER, UPPER, {"m1 >= 1": lambda p: p["m1"] - 1.0}, starts=2)
    with pytest.raises(ModelError, match="give a lower below an upper"):
        constrained_optimum(data, base_values, NAMES, UPPER, LOWER)
    with pytest.raises(ModelError, match="not linear"):
        certified_floor(
            data, lambda p: [*list(base_values(p).values())[:3], p["m2"] ** 2], NAMES, LOWER, UPPER, LINKS, 1.0
        )
    with pytest.raises(ModelError, match="m1 may be 0"):
        certified_floor(data, base_values, NAMES, np.r_[0.0, LOWER[1:]], UPPER, LINKS, 1.0)
    with pytest.raises(ModelError, match="length 0"):
        link_constraints([LinkNames("m", "c", "I", 0.0)])
