"""Variable projection: costs against scipy on the whole problem, derivatives against differences, bounds, rank,
digits."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from projection_plants import LAG_TEXT, NIST, curve, problem, text
from scipy.optimize import least_squares, lsq_linear

import plantfit.runtime  # noqa: F401
from plantfit.models import Declared, LinearModel, equations, first_order
from plantfit.optimize.loop.counter import Counter
from plantfit.problem import Problem, Projection
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.study.objective import objective_of

import jax.numpy as jnp

OVER_INPUT = {"k": {"over": ["u"], "nodes": [0.0, 1.0, 2.0, 3.0]}}
TIGHT = (0.9, 1.1)  # bounds that linear coordinates meet


@cache
def made(name: str) -> Problem:
    """Problems of every kind, with answers inside the bounds and on them; all tests share their programs."""
    sums = text("y = a*exp(-b*u) + c*exp(-d*u) + g", "a b c d g")
    lag, wide = text(*LAG_TEXT, states=["x"]), {"K": (-50.0, 50.0), "c": (-50.0, 50.0)}
    two = text("y = a*u + b; q = c*exp(-d*u) + b", "a b c d", outputs=["y", "q"])
    return {
        "curve": lambda: problem(sums, {n: (-50.0, 50.0) for n in "acg"}),
        "curve at its bounds": lambda: problem(sums, {"a": TIGHT, "c": (-50.0, 50.0), "g": TIGHT}),
        "lag": lambda: problem(lag, wide),
        "lag at a bound": lambda: problem(lag, {**wide, "K": TIGHT}),
        "lag with three records": lambda: problem(lag, {**wide, "c": Parameter((-50.0, 50.0), per_recording=True)},
                                                  records=3),
        "one offset at its bound": lambda: problem(lag, {**wide, "c": Parameter((-0.1, 0.1), per_recording=True)},
                                                   records=2),
        "process": lambda: problem(first_order(initial="free"),
                                   {"K": (-50, 50), "c": (-50, 50), "y0": (-50, 50), "L": (0.05, 0.35)}),
        "gain by decades": lambda: problem(lag, {"c": (-50.0, 50.0), "K": Parameter((1e-3, 1e3), scale="log")}),
        "gain by decades at its bound": lambda: problem(lag,
                                                        {"c": (-50.0, 50.0), "K": Parameter((5.0, 1e3), scale="log")}),
        "two outputs": lambda: problem(two, {n: (-50.0, 50.0) for n in "abc"}),
        "table": lambda: problem(text("x' = (k(u) - x)/T; y = x", "T k", states=["x"], tables=OVER_INPUT),
                                 {"k": (-50.0, 50.0)}),
        "smooth table": lambda: problem(
            text("x' = (k(u) - x)/T; y = x", "T k", states=["x"], tables=OVER_INPUT),
            {"k": Parameter((-50.0, 50.0), smooth=3.0)}
        ),
        "balance": lambda: problem(lag, wide, records=2, balance="recordings"),
        "at rest": lambda: problem(
            text("x' = K*u - x - T*x^3; y = g*x + c", "K T g c", states=["x"]), {"g": (-9, 9), "c": (-9, 9)},
            steady=True
        ),
        "regression": lambda: problem(_regression(), {"m": (-50.0, 50.0), "J": (-50.0, 50.0)}),
        "tied": lambda: problem(text("y = a*u + b*exp(-c*u) + d", "a b c d"),
                                {"a": (-9, 9), "b": (-9, 9), "d": Parameter(tied="a")}),
    }[name]()  # fmt: skip


KINDS = [
    "curve",
    "curve at its bounds",
    "lag",
    "lag at a bound",
    "lag with three records",
    "one offset at its bound",
    "process",
]
KINDS += [
    "gain by decades",
    "gain by decades at its bound",
    "two outputs",
    "table",
    "smooth table",
    "balance",
    "at rest",
    "regression",
    "tied",
]


def _regression() -> LinearModel:
    parameters = tuple(Declared(n, bounds=(0.2, 3.0)) for n in ("m", "l", "J"))
    return LinearModel(
        "r", {"y": None}, parameters, lambda s: np.column_stack([s["u"], s["u"] ** 2, np.ones(60)]), {"u": None},
        {"c0": None, "c1": None, "c2": None},
        lambda p: {"c0": p["m"] * p["l"] ** 2 + p["J"], "c1": p["m"] * jnp.sin(p["l"]), "c2": p["J"] * p["l"]},
    )  # fmt: skip


@cache
def projected_kind(kind: str, full: bool = False) -> Projection:
    return projected(made(kind), full=full)


def projected(p: Problem, **settings: Any) -> Projection:
    found = Projection.of(p, **settings)
    assert found is not None
    return found


def points(projection: Projection, n: int = 3, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.15, 0.85, (n, projection.dimension))


def whole(p: Problem, z: np.ndarray) -> np.ndarray:
    """All residuals, scaled so that the mean of their squares is the cost, those of smoothing too."""
    return p.residuals_and_jacobian(z)[0]


def slopes(function, at: np.ndarray, h: float = 1e-5) -> np.ndarray:
    """Central differences, extrapolated once, by the last axis."""

    def central(h):
        return np.stack([(function(at + h * e) - function(at - h * e)) / (2 * h) for e in np.eye(len(at))], axis=-1)

    return (4.0 * central(h) - central(2 * h)) / 3.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.further(13)
def test_the_cost_is_the_least_over_the_linear_coordinates(kind):
    p, projection = made(kind), projected_kind(kind)
    places, kept = projection.solved, projection.kept
    for zn in points(projection):
        z = np.full(p.space.dimension, 0.5)
        z[kept] = zn

        def residuals(share, z=z):
            values = np.array(p.space.physical(z))
            values[places] = p.space.lower[places] + share * (p.space.upper[places] - p.space.lower[places])
            return whole(p, np.clip(p.space.cube(values), 0.0, 1.0))

        begin = residuals(np.full(len(places), 0.5))
        columns = np.column_stack([residuals(0.5 + 0.5 * e) - begin for e in np.eye(len(places))]) / 0.5
        best = lsq_linear(columns, -begin, (-0.5, 0.5), method="bvls", tol=1e-15)
        cost = projection.costs(zn)[0]
        assert cost == pytest.approx(2.0 * best.cost / len(begin), rel=1e-9)
        assert float(p.cost(projection.lift(zn)[0])) == pytest.approx(cost, rel=1e-11)
        search = least_squares(
            lambda share: residuals(share), np.full(len(places), 0.5), bounds=(0, 1), xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        assert cost <= 2.0 * search.cost / len(begin) * (1 + 1e-9)


@pytest.mark.parametrize("full", [False, True], ids=["kaufman", "full"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.further(19)
def test_rows_have_the_cost_and_the_exact_gradient(kind, full):
    projection = projected_kind(kind, full)
    zn = points(projection)
    r, jacobian, z, _ = projection.rows(zn)
    k = projection.dimension + 1
    assert r.shape == (3, k)
    assert jacobian.shape == (3, k, k - 1)
    np.testing.assert_allclose(np.mean(r**2, axis=1), projection.problem.costs(z), rtol=1e-11)
    np.testing.assert_array_equal(z[:, projection.kept], zn)
    assert np.all((z >= 0.0) & (z <= 1.0))
    for i in range(len(zn)):
        gradient = 2.0 * jacobian[i].T @ r[i] / k
        expected = slopes(lambda zn: projection.costs(zn)[0], zn[i])
        np.testing.assert_allclose(gradient, expected, rtol=2e-6, atol=1e-7 * np.abs(expected).max() + 1e-11)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.further(12)
def test_a_sample_costs_what_the_answer_costs(kind):
    projection = projected_kind(kind)
    zn = points(projection, 8)
    costs, z = projection.sample(zn)
    np.testing.assert_allclose(costs, projection.costs(zn), rtol=1e-7)
    np.testing.assert_allclose(projection.problem.costs(z), costs, rtol=1e-6)
    np.testing.assert_array_equal(z[:, projection.kept], zn)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.further(6)
def test_rows_above_a_limit_are_left_after_their_cost(kind):
    projection = projected_kind(kind)
    zn = points(projection, 6)
    costs = projection.costs(zn)
    limit = np.full(6, float(np.median(costs)))
    part, every = projection.rows(zn, limit), projection.rows(zn)
    assert np.all(part.whole[costs <= limit])
    assert not np.any(part.whole[costs > limit * (1 + 1e-5)])
    assert np.all(every.whole)
    np.testing.assert_allclose(np.mean(part.r**2, axis=1), costs, rtol=1e-7)
    for a, b in zip(part, every, strict=True):
        np.testing.assert_array_equal(a[part.whole], b[part.whole])


def test_a_row_that_is_left_and_a_sample_cost_one_jacobian():
    projection = projected(made("curve at its bounds"))
    objective = objective_of(projection.problem)
    counter = Counter(objective, 1e6)
    counter.projected = projection
    zn = points(projection, 4)
    counter.projected_costs(zn)
    assert counter.spent == 4 * objective.jacobian_charge
    counter.projected_rows(zn, np.array([0.0, 0.0, 0.0, np.inf]))
    assert counter.spent == (4 + 3 + 2) * objective.jacobian_charge


@pytest.mark.parametrize(
    "kind", [k for k in KINDS if k not in ("process", "two outputs", "balance", "at rest", "tied")]
)
@pytest.mark.further(6)
def test_full_derivatives_are_those_of_the_residuals_at_the_answer(kind):
    p, projection, simple = made(kind), projected_kind(kind, True), projected_kind(kind)
    zn = points(projection)
    for i, (_, jacobian, *_) in enumerate(zip(*projection.rows(zn), strict=True)):
        moved = slopes(lambda zn: whole(p, projection.lift(zn)[0]), zn[i])
        expected = moved.T @ moved / len(moved)
        found = jacobian.T @ jacobian / len(jacobian)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
        short = simple.rows(zn[i]).jacobian[0]
        assert np.all(np.linalg.eigvalsh(found - short.T @ short / len(short)) > -1e-12 * np.abs(found).max())


def test_bounds_are_met_exactly_and_the_rest_is_solved_for():
    projection = projected(made("curve at its bounds"))
    z = projection.lift(points(projection, 8))
    at = z[:, projection.solved]
    assert np.any((at == 0.0) | (at == 1.0))
    assert np.any((at > 0.0) & (at < 1.0))


def test_names_and_places_are_those_of_the_problem():
    projection = projected(made("lag with three records"))
    assert projection.names == ("T",)
    assert projection.solved_names == ("K", "c[r0]", "c[r1]", "c[r2]")
    assert projection.restrict(np.array([[0.1, 0.2, 0.3, 0.4, 0.5]])).tolist() == [[0.2]]
    assert projection.charge == 2 * projection.problem.jacobian_charge
    same = Projection.of(projection.problem.with_scales({"y": 2.0}))
    assert same is not None
    np.testing.assert_allclose(same.costs([[0.3]]) * 4.0, projection.costs([[0.3]]), rtol=1e-12)


def test_a_problem_without_anything_linear_has_no_projection():
    assert Projection.of(problem(text("y = exp(-a*u)/(b + u)", "a b"))) is None


def test_a_purely_linear_problem_has_no_coordinate_left():
    p = problem(text("y = a*u + b", "a b"), {"a": (-50.0, 50.0), "b": (-50.0, 50.0)})
    projection = projected(p)
    assert projection.dimension == 0
    r, jacobian, z, _ = projection.rows(np.zeros((1, 0)))
    assert r.shape == (1, 1)
    assert jacobian.shape == (1, 1, 0)
    record = p.experiments["r0"].recording
    slope, offset = np.polyfit(record["u"], record["y"], 1)
    np.testing.assert_allclose(p.space.physical(z[0]), [slope, offset], rtol=1e-12)
    assert projection.costs(np.zeros((2, 0))).tolist() == [float(r[0, 0] ** 2)] * 2
    with_terms = projected(p, full=True)
    np.testing.assert_allclose(with_terms.rows(np.zeros((1, 0))).r, r)


def test_columns_that_are_the_same_are_solved_for_together():
    p = problem(text("y = a*u + b*u + c*exp(-d*u)", "a b c d"), {n: (-50.0, 50.0) for n in "abc"})
    alone = problem(text("y = a*u + c*exp(-d*u)", "a c d"), {n: (-50.0, 50.0) for n in "ac"})
    zn = [[0.3], [0.8]]
    found, expected = projected(p).rows(zn), projected(alone).rows(zn)
    np.testing.assert_allclose(np.mean(found.r**2, axis=1), np.mean(expected.r**2, axis=1), rtol=1e-11)
    ours, theirs = (np.einsum("nkd,nk->nd", a.jacobian, a.r) for a in (found, expected))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)
    values = np.asarray(p.space.physical(found.z))
    np.testing.assert_allclose(values[:, 0], values[:, 1], rtol=1e-9)  # neither is preferred
    np.testing.assert_allclose(values[:, :2].sum(axis=1), np.asarray(alone.space.physical(expected.z))[:, 0], rtol=1e-9)


def test_more_linear_coordinates_than_samples_leave_no_residual():
    entries = curve(lambda u, p: sum(p["b"][i] * jnp.cos(i * p["w"] * u) for i in range(6)), {"b": (6,), "w": ()})
    record = Recording(
        np.arange(4.0), {"u": Signal(np.arange(4.0)), "y": Signal(np.array([1.0, 2.0, 0.5, 1.5]))}, "short"
    )
    projection = projected(Problem(entries, record, {"b": (-50.0, 50.0)}))
    r, jacobian, *_ = projection.rows([[0.4]])
    assert np.all(np.isfinite(jacobian))
    assert np.sum(r**2) < 1e-24


def test_candidates_that_cannot_be_simulated_spare_their_neighbours():
    p = problem(curve(lambda u, p: p["a"] * jnp.sqrt(p["c"] - 1.0) * u + p["b"], {"a": (), "b": (), "c": ()}))
    projection = projected(p)
    zn = np.array([[0.1], [0.6], [0.2], [0.9]])
    r, jacobian, z, _ = projection.rows(zn)
    assert np.isnan(r).all(axis=1).tolist() == [True, False, True, False]
    assert np.isnan(jacobian).all(axis=(1, 2)).tolist() == [True, False, True, False]
    assert np.all(np.isfinite(z))
    assert np.isinf(projection.costs(zn)).tolist() == [True, False, True, False]
    np.testing.assert_allclose(r[1], projection.rows(zn[1]).r[0], rtol=1e-12)


@pytest.mark.parametrize("steep", [70.0, 120.0, 400.0])
def test_columns_too_large_to_be_squared_are_no_candidates(steep):
    projection = projected(problem(text(f"y = a*exp({steep}*b*u) + c", "a b c"), {"a": (-9.0, 9.0), "c": (-9.0, 9.0)}))
    r, _, z, _ = projection.rows([[1.0], [0.0]])
    assert np.isnan(r[0]).all()
    assert projection.costs([[1.0]])[0] == np.inf
    assert np.all(np.isfinite(z))


def test_a_candidate_has_the_same_bits_alone_and_beside_others():
    projection = projected(made("curve"))
    zn = points(projection, 5)
    together = projection.rows(zn)
    for i in range(5):
        for alone, beside in zip(projection.rows(zn[i]), together, strict=True):
            np.testing.assert_array_equal(alone[0], beside[i])


def test_the_order_of_parameters_changes_nothing():
    lines, wide = "y = a*exp(-b*u) + c*exp(-d*u) + g", {n: (-50.0, 50.0) for n in "acg"}
    first, second = (projected(problem(text(lines, names), wide)) for names in ("a b c d g", "g d c b a"))
    zn = points(first)
    np.testing.assert_allclose(first.costs(zn), second.costs(zn[:, ::-1]), rtol=1e-11)
    values = [dict(zip(q.problem.space.names, np.asarray(q.problem.space.physical(z)), strict=True))
              for q, z in ((first, first.lift(zn)[0]), (second, second.lift(zn[:, ::-1])[0]))]  # fmt: skip
    for name, value in values[0].items():
        assert values[1][name] == pytest.approx(value, rel=1e-8)


def test_outputs_in_other_units_and_about_other_means_move_the_linear_ones_along():
    plain = problem(text(*LAG_TEXT, states=["x"]), {"K": (-50.0, 50.0), "c": (-50.0, 50.0)})
    record = plain.experiments["r0"].recording
    other = Recording(record.t, {**record.signals, "y": Signal(1000.0 * record["y"] + 7e4)}, record.name)
    moved = Problem(plain.model, {"r0": other}, {"K": (-5e4, 5e4), "c": (-1e5, 1e5)})
    before, after = projected(plain), projected(moved)
    zn = points(before)
    np.testing.assert_allclose(after.costs(zn), 1e6 * before.costs(zn), rtol=1e-9)
    values = [np.asarray(q.problem.space.physical(q.lift(zn))) for q in (before, after)]
    np.testing.assert_allclose(values[1][:, 0], 1000.0 * values[0][:, 0], rtol=1e-8)
    np.testing.assert_allclose(values[1][:, 2], 1000.0 * values[0][:, 2] + 7e4, rtol=1e-8)


# -- digits -------------------------------------------------------------------------------------------


def lanczos(noise: bool = False) -> Problem:
    """Three exponentials (Lanczos, Applied Analysis, 1956, p. 272), to all digits or as published to five, in boxes
    of +-1e6."""
    x = 0.05 * np.arange(24)
    y = 0.0951 * np.exp(-x) + 0.8607 * np.exp(-3.0 * x) + 1.5576 * np.exp(-5.0 * x)
    if noise:
        y = np.loadtxt((NIST / "Lanczos3.dat").read_text().splitlines()[60:])[:, 0]
    bounds = {n: {"bounds": (-1e6, 1e6)} for n in ("b1", "b3", "b5")} | {
        n: {"bounds": (0.0, 20.0)} for n in ("b2", "b4", "b6")
    }
    model = equations(
        "y = b1*exp(-b2*x) + b3*exp(-b4*x) + b5*exp(-b6*x)", inputs=["x"], outputs=["y"], parameters=bounds
    )
    return Problem(model, Recording(x, {"x": Signal(x), "y": Signal(y)}, "lanczos"))


def test_sums_of_exponentials_keep_their_digits_in_wide_boxes():
    projection = projected(lanczos())
    zn = projection.problem.space.cube([0.0, 0.0, 0.0, 1.0, 3.0, 5.0])[projection.kept]
    values = np.asarray(projection.problem.space.physical(projection.lift(zn)[0]))
    # a box of 2e6 leaves 1e-10 of a coordinate between 0 and 1
    np.testing.assert_allclose(values[:3], [0.0951, 0.8607, 1.5576], atol=2e-9)
    assert projection.costs(zn)[0] < 1e-30  # though the cube cannot say the amplitudes better


@pytest.mark.parametrize("full", [False, True], ids=["kaufman", "full"])
def test_a_search_over_the_rates_alone_reaches_the_certified_answer(full):
    projection = projected(lanczos(noise=True), full=full)
    search = least_squares(
        lambda zn: projection.rows(zn).r[0],
        projection.problem.space.cube([0.0, 0.0, 0.0, 0.3, 4.0, 9.0])[projection.kept],
        lambda zn: projection.rows(zn).jacobian[0], bounds=(0, 1), xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=500,
    )  # fmt: skip
    assert projection.costs(search.x)[0] * 24 == pytest.approx(1.6117193594e-08, rel=1e-8)
    rates = np.sort(20.0 * search.x)
    np.testing.assert_allclose(rates, [0.95548984186, 2.9517829086, 4.9493977170], rtol=0.05)


def test_a_coordinate_that_the_solved_ones_make_up_for_has_no_slope():
    """A gain that is a product: with one factor solved for, the other changes nothing, and rounding is no slope."""
    t = np.linspace(0.0, 5.0, 80)
    u = np.sign(np.sin(2.0 * t))
    declared = {"a": {"bounds": (0.1, 10.0)}, "b": {"bounds": (0.1, 10.0)}, "tau": {"bounds": (0.05, 5.0)}}
    model = equations("x' = (a*b*u - x)/tau\ny = x", inputs=["u"], states=["x"], outputs=["y"], parameters=declared)
    noise = 0.05 * np.random.default_rng(0).normal(size=len(t))
    y = Problem(model, Recording(t, {"u": Signal(u), "y": Signal(u)}), substeps=4).predict(np.array([1.7, 1.2, 0.6]))[
        "y"
    ]
    projection = projected(Problem(model, Recording(t, {"u": Signal(u), "y": Signal(y + noise)}), substeps=4))
    assert projection.solved_names in (("a",), ("b",))
    rows = projection.rows(points(projection, 6) * 0.5 + 0.25)
    other = [k for k, n in enumerate(projection.names) if n in ("a", "b")]
    assert np.all(rows.jacobian[:, :, other] == 0.0)
    assert np.all(np.linalg.norm(np.delete(rows.jacobian, other, axis=2), axis=1) > 1e-3)
