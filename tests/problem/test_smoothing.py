"""Smoothed tables: the rows against quadratics, the cost against its definition, every form of it against each
other, answers against linear algebra and a smoothing spline."""

from functools import cache

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError, SpecError
from plantfit.fitting import fit
from plantfit.models import Declared, Model, Table, steam_chamber, tabled_first_order
from plantfit.problem import Experiment, Problem
from plantfit.problem.evaluate.second_differences import second_differences
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

import jax

NODES = (0.0, 1.0, 3.0, 4.0, 6.0, 7.0, 10.0)


def smoothing_of(problem):
    assert problem.smoothing is not None
    return problem.smoothing


def curve(nodes=NODES, second=None):
    """y = f(u) or f(u, v): a static table."""
    axes = (nodes,) if second is None else (nodes, second)
    table = Table("f", ("u", "v")[: len(axes)], axes, "V")
    signals = ("u", "v")[: len(axes)]
    return Model(
        name="curve", states={}, inputs=dict.fromkeys(signals), outputs={"y": "V"},
        parameters=(Declared("f", "V", (-4.0, 6.0), shape=table.shape),),
        output=lambda x, u, p: {"y": table(p["f"], *(u[s] for s in signals))}, tables=(table,),
    )  # fmt: skip


def sampled(u, y, **more):
    signals = {"u": Signal(np.asarray(u, dtype=float)), "y": Signal(np.asarray(y, dtype=float), "V")}
    signals |= {n: Signal(np.asarray(v, dtype=float)) for n, v in more.items()}
    return Recording(np.arange(float(len(u))), signals, "curve")


def noisy(seed=0, n=200, sd=0.3):
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.0, 10.0, n)
    return u, np.sin(u) + sd * rng.normal(size=n)


def smoothed(smooth, u, y, **settings):
    return Problem(curve(), sampled(u, y), {"f": Parameter((-4.0, 6.0), "V", smooth=smooth)}, **settings)


def test_rows_vanish_on_lines_and_integrate_the_square_of_a_quadratics_bend():
    nodes = np.array(NODES)
    rows, x = second_differences(nodes), (nodes - nodes[0]) * (len(nodes) - 1) / (nodes[-1] - nodes[0])
    np.testing.assert_allclose(rows @ (3.0 * x - 1.0), 0.0, atol=1e-12)
    inner = 0.5 * (x[2:] - x[:-2])
    np.testing.assert_allclose(np.sum((rows @ x**2) ** 2), 4.0 * np.sum(inner), rtol=1e-12)
    np.testing.assert_allclose(second_differences(np.linspace(3.0, 9.0, 5))[1], [0.0, 1.0, -2.0, 1.0, 0.0], atol=1e-12)


def test_cost_is_that_of_the_data_and_of_the_bends():
    u, y = noisy()
    problem = smoothed(7.0, u, y)
    z = np.random.default_rng(3).uniform(size=7)
    values = np.asarray(problem.space.physical(z))
    bends = second_differences(np.array(NODES)) @ ((values + 4.0) / 10.0)
    wanted = (np.sum((np.interp(u, NODES, values) - y) ** 2) + 7.0 * np.sum(bends**2)) / len(u)
    assert float(problem.cost(z)) == pytest.approx(wanted, rel=1e-12)
    assert float(problem.unsmoothed.cost(z)) == pytest.approx(
        np.mean((np.interp(u, NODES, values) - y) ** 2), rel=1e-12
    )
    np.testing.assert_allclose(problem.residuals(z), np.interp(u, NODES, values) - y, atol=1e-12)


@cache
def steam(smooth, names=("k", "A1"), recordings=2, **shared):
    """Short records of a chamber whose tables are its own or shared, over log boxes for A1."""
    records = {}
    for i in range(recordings):
        t = np.arange(0.0, 30.0, 0.5)
        y = 5.0 * (1 + i) * (1 - np.exp(-t / 8.0)) + 0.05 * np.random.default_rng(i).normal(size=len(t))
        u = Signal(np.full(len(t), 25.0 * (1 + i)), "%")
        records[f"r{i}"] = Experiment(Recording(t, {"u": u, "y": Signal(y, "bar")}, f"r{i}"), before={"u": 0.0})
    own = {n: Parameter(per_recording=True, smooth=smooth if n in names else None) for n in ("k", "A2", "Td")}
    own["A1"] = Parameter((1.0, 100.0), "s", "log", per_recording=True, smooth=smooth if "A1" in names else None)
    model = steam_chamber(nodes={"from": 0, "to": 20, "count": 5}, **shared)
    return Problem(model, records, own, substeps=1)


def mixed():
    """A moving record and one at rest of a process with a gain that changes with its input."""
    t = np.arange(0.0, 30.0, 0.5)
    u, y = Signal(np.full(len(t), 40.0)), Signal(20.0 * (1 - np.exp(-t / 5.0)))
    rest = Recording(
        np.arange(3.0), {"u": Signal(np.array([20.0, 40.0, 60.0])), "y": Signal(np.array([9.0, 20.0, 33.0]))}, "rest"
    )
    records = {"moving": Recording(t, {"u": u, "y": y}, "moving"), "rest": Experiment(rest, steady=True)}
    model = tabled_first_order(dead_time=False, offset=False)
    return Problem(
        model, records, {"K": Parameter((0.1, 1.0), smooth=30.0), "tau": Parameter((1.0, 20.0), value=5.0)}, substeps=1
    )


@pytest.mark.parametrize("kind", ["steam", "curve", pytest.param("mixed", marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_every_form_of_the_cost_is_the_same(kind):
    if kind == "curve":
        problem = smoothed((2.0,), *noisy(n=40))
    else:
        problem = steam(30.0)
        if kind == "mixed":
            problem = mixed()
    z = np.random.default_rng(5).uniform(0.3, 0.7, problem.space.dimension)
    cost = float(problem.costs(z[None])[0])
    assert cost > float(problem.unsmoothed.costs(z[None])[0])
    value, gradient = problem.value_and_gradient(z)
    r, jacobian = problem.residuals_and_jacobian(z)
    short, by = problem.compressed(z)
    assert value == pytest.approx(cost, rel=1e-10)
    assert np.mean(r**2) == pytest.approx(cost, rel=1e-10)
    assert np.mean(short**2) == pytest.approx(cost, rel=1e-10)
    np.testing.assert_allclose(2.0 * jacobian.T @ r / len(r), gradient, rtol=1e-7, atol=1e-9 * np.abs(gradient).max())
    np.testing.assert_allclose(2.0 * by.T @ short / len(short), gradient, rtol=1e-7, atol=1e-9 * np.abs(gradient).max())
    if problem.separable is not None:
        parts = problem.separable_blocks(z)
        assert sum(float(a @ a) for a, _ in parts) == pytest.approx(cost, rel=1e-10)
        for k, (r, by) in enumerate(parts):
            alone = problem.separable_blocks(z, np.arange(len(parts)) == k)
            assert alone[k][0].tobytes() == r.tobytes()
            assert alone[k][1].tobytes() == by.tobytes()
            assert all(len(a) == 0 for n, (a, _) in enumerate(alone) if n != k)
    v = np.random.default_rng(6).normal(size=len(z))
    step = 1e-5 * v
    slope = float(problem.costs((z + step)[None])[0] - problem.costs((z - step)[None])[0])
    assert slope == pytest.approx(2.0 * float(gradient @ step), rel=1e-3)


def test_tables_of_separate_recordings_stay_separate_problems():
    parts = steam(30.0).separable
    assert parts is not None
    assert len(parts) == 2


def test_bends_of_a_logarithmic_box_are_those_of_logarithms():
    problem = steam(30.0, names=("A1",))
    values = {c.name: 0.5 * (c.lower + c.upper) for c in problem.space.coordinates}
    values |= {f"A1[{i}][{r}]": 2.0 * 3.0**i for i in range(4) for r in ("r0", "r1")}
    values |= {f"A1[4][{r}]": 50.0 for r in ("r0", "r1")}
    z = problem.space.cube(problem.space.vector(values))
    _, _, key = smoothing_of(problem).rows
    bends, _ = smoothing_of(problem).weighted(z)
    assert set(key) == {0}
    np.testing.assert_allclose(bends[[0, 1, 3, 4]], 0.0, atol=1e-9)
    wanted = np.sqrt(30.0) * (np.log(50.0) - 2 * np.log(54.0) + np.log(18.0)) / np.log(100.0)
    np.testing.assert_allclose(bends[[2, 5]], wanted, rtol=1e-9)


def test_two_axes_have_a_strength_each():
    second = (0.0, 5.0, 6.0, 10.0)
    rng = np.random.default_rng(2)
    u, v = rng.uniform(0, 10, (2, 50))
    record = sampled(u, np.zeros(50), v=v)
    make = lambda s: Problem(curve(second=second), record, {"f": Parameter((-4.0, 6.0), "V", smooth=s)})  # noqa: E731
    problem = make((2.0, 5.0))
    values = rng.uniform(-1.0, 2.0, (7, 4))
    z = problem.space.cube(values.ravel())
    first, other = (second_differences(np.array(n)) for n in (NODES, second))
    wanted = 2.0 * np.sum((first @ values) ** 2) + 5.0 * np.sum((values @ other.T) ** 2)
    bends, _ = smoothing_of(problem).weighted(z)
    assert float(bends @ bends) == pytest.approx(wanted / 100.0, rel=1e-12)
    both = make(2.0)
    assert dict(smoothing_of(both).strengths) == {("f", "u"): 2.0, ("f", "v"): 2.0}
    assert both.with_smoothing({("f", "v"): 5.0}).cost(z) == pytest.approx(float(problem.cost(z)), rel=1e-12)


def test_the_answer_solves_the_normal_equations():
    u, y = noisy()
    answer = fit(smoothed(50.0, u, y), seed=1)
    basis = np.stack([np.interp(u, NODES, row) for row in np.eye(7)], axis=1)
    bends = second_differences(np.array(NODES)) / 10.0
    wanted = np.linalg.solve(basis.T @ basis + 50.0 * bends.T @ bends, basis.T @ y)
    np.testing.assert_allclose(list(answer.values.values()), wanted, rtol=1e-6, atol=1e-7)


def test_dense_nodes_give_a_smoothing_spline():
    nodes = np.linspace(0.0, 10.0, 201)
    u, y = nodes[::4] + 0.0, np.sin(nodes[::4]) + 0.2 * np.random.default_rng(4).normal(size=51)
    h, strength = 0.05, 2.0  # of make_smoothing_spline: sum of squares + strength x integral of f''^2
    problem = Problem(
        curve(tuple(nodes)), sampled(u, y), {"f": Parameter((-4.0, 6.0), "V", smooth=strength * 100.0 / h**3)}
    )
    values = np.array(list(fit(problem, "least_squares", seed=0, settings={"agree": 1}).values.values()))
    np.testing.assert_allclose(values, make_smoothing_spline(u, y, lam=strength)(nodes), atol=2e-3)


def test_gradients_of_many_points_agree_in_a_batch():
    problem = steam(30.0)
    zs = np.random.default_rng(8).uniform(0.3, 0.7, (3, problem.space.dimension))
    f, g = problem.values_and_gradients(zs)
    np.testing.assert_allclose(f, problem.costs(zs), rtol=1e-12)
    np.testing.assert_allclose(g[1], problem.value_and_gradient(zs[1])[1], rtol=1e-9, atol=1e-12)
    assert np.all(np.isfinite(jax.jit(problem.costs)(zs)))


@pytest.mark.parametrize(
    ("smooth", "said"),
    [
        (-1.0, "strength of 0 or more"),
        ("cv", "'cross-validated', 'reml'"),
        ((1.0, 2.0), "one for each"),
        (np.nan, "strength of 0 or more"),
    ],
)
def test_a_strength_that_cannot_be_is_refused(smooth, said):
    with pytest.raises(SpaceError, match=said):
        smoothed(smooth, *noisy(n=20))


def test_single_numbers_and_short_tables_have_no_bends():
    with pytest.raises(SpaceError, match=r"'Td' has smooth = 1\.0, but it is a single number"):
        Problem(steam_chamber(), steam(1.0).experiments, {"Td": Parameter(smooth=1.0)}, substeps=1)
    with pytest.raises(SpaceError, match="a table of 2 entries"):
        Problem(curve((0.0, 1.0)), sampled(*noisy(n=20)), {"f": Parameter(smooth=1.0)})


def test_the_key_of_the_study_file(tmp_path):
    from plantfit.spec import parse

    u, y = noisy(n=30)
    (tmp_path / "c.csv").write_text(
        "t,u,y\n" + "".join(f"{i},{a},{b}\n" for i, (a, b) in enumerate(zip(u, y, strict=True)))
    )
    text = """name = "c"
[recording.c]
file = "c.csv"
time = "t"
[model]
equations = "y = f(u)"
inputs = ["u"]
outputs = ["y"]
[model.tables.f]
over = "u"
nodes = {{from = 0, to = 10, count = 6}}
[parameters.f]
bounds = [-4, 6]
smooth = {smooth}
"""
    for given, wanted in (("3", 3.0), ('"reml"', "reml"), ('"cross-validated"', "cross-validated")):
        study = parse(text.format(smooth=given), tmp_path / "c.toml")
        assert study.problem.space.parameters["f"].smooth == wanted
    with pytest.raises(SpecError, match=r"c\.toml: parameters\.f\.smooth = 'crossvalidated' cannot be used"):
        parse(text.format(smooth='"crossvalidated"'), tmp_path / "c.toml")
