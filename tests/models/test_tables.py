"""Look-ups against numpy and closed forms: values, first and nested derivatives, batches."""

import numpy as np
import pytest

from plantfit.errors import ModelError
from plantfit.models import Table, lookup, lookup2

import jax
import jax.numpy as jnp

RNG = np.random.default_rng(3)
GRIDS = {
    "even": np.linspace(0, 20, 10),
    "even, far from zero": np.linspace(1000, 1001, 11),
    "even, two nodes": np.array([-1.0, 2.0]),
    "uneven": np.array([-3.0, -1.0, 0.5, 4.0, 4.25]),
}
grids = pytest.mark.parametrize("nodes", GRIDS.values(), ids=GRIDS)


def points(nodes, n=200):
    span = nodes[-1] - nodes[0]
    return np.random.default_rng(0).uniform(nodes[0] - 0.3 * span, nodes[-1] + 0.3 * span, n)


def hats(nodes, x):
    """d value/d values (len(x), n): what interpolating each unit table gives."""
    return np.stack([np.interp(x, nodes, row) for row in np.eye(len(nodes))], axis=-1)


@grids
@pytest.mark.thorough
def test_value_is_that_of_numpy_for_arrays_and_numbers(nodes):
    values, x = RNG.normal(size=len(nodes)), points(nodes)
    expected = np.interp(x, nodes, values)
    np.testing.assert_allclose(lookup(values, nodes, x), expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(
        lookup(values, nodes, x.reshape(4, 5, 10)), expected.reshape(4, 5, 10), rtol=1e-10, atol=1e-10
    )
    assert float(lookup(values, nodes, x[0])) == pytest.approx(expected[0], rel=1e-10, abs=1e-10)
    np.testing.assert_allclose(lookup(values, nodes, nodes), values, rtol=1e-12, atol=1e-12)


@grids
def test_slope_at_nodes_is_the_one_to_the_right_and_zero_outside(nodes):
    values = RNG.normal(size=len(nodes))
    slope = jax.jit(jax.vmap(jax.grad(lambda x: lookup(values, nodes, x))))
    right = np.append(np.diff(values) / np.diff(nodes), 0.0)
    np.testing.assert_allclose(slope(jnp.asarray(nodes)), right, rtol=1e-9)
    np.testing.assert_array_equal(
        slope(jnp.array([nodes[0] - 1e-6, nodes[0] - 9.0, nodes[-1] + 1e-6, nodes[-1] + 9.0])), 0.0
    )


@grids
@pytest.mark.parametrize("jacobian", [jax.jacrev, jax.jacfwd])
@pytest.mark.further(7)
def test_derivative_by_values_is_the_hats_and_by_x_the_difference(nodes, jacobian):
    values, x, h = RNG.normal(size=len(nodes)), points(nodes), 1e-7
    x = x[np.min(np.abs(x[:, None] - nodes), axis=1) > 10 * h]
    by_values, by_x = jax.jit(jacobian(lambda v, at: lookup(v, nodes, at), (0, 1)))(values, x)
    np.testing.assert_allclose(by_values, hats(nodes, x), atol=1e-9)
    by_x = np.diag(by_x)
    difference = (np.interp(x + h, nodes, values) - np.interp(x - h, nodes, values)) / (2 * h)
    np.testing.assert_allclose(by_x, difference, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("nodes", [GRIDS["even"], GRIDS["uneven"]], ids=["even", "uneven"])
def test_nested_derivatives_in_every_order(nodes):
    """The slope is a difference of neighbouring values over the cell: its derivative by values is known, that by x
    is 0."""
    values = RNG.normal(size=len(nodes))
    x = nodes[0] + 0.37 * (nodes[1] - nodes[0])
    expected = np.zeros(len(nodes))
    expected[:2] = np.array([-1.0, 1.0]) / (nodes[1] - nodes[0])

    @jax.jit
    def nested(v, at):
        def f(v, at):
            return lookup(v, nodes, at)

        modes = ((jax.jacrev, jax.grad), (jax.jacfwd, jax.grad), (jax.jacrev, jax.jacfwd), (jax.jacfwd, jax.jacfwd))
        mixed = [outer(inner(f, i), 1 - i)(v, at) for outer, inner in modes for i in (0, 1)]
        return mixed, [outer(inner(f, 1), 1)(v, at) for outer, inner in modes]

    mixed, curvature = nested(values, x)
    np.testing.assert_allclose(mixed, [expected] * 8, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(curvature, 0.0)


def test_gradient_of_many_points_is_the_weighted_sum_of_hats():
    nodes, x, weight = GRIDS["even"], points(GRIDS["even"], 5000), RNG.normal(size=5000)

    @jax.jit
    def total(v):
        return jnp.vdot(weight, jax.vmap(lambda at: lookup(v, nodes, at))(x))

    np.testing.assert_allclose(jax.jit(jax.grad(total))(np.ones(10)), weight @ hats(nodes, x), rtol=1e-9)


def test_batch_over_tables_and_points():
    nodes = GRIDS["even"]
    values, x = RNG.normal(size=(3, 10)), points(nodes, 60).reshape(3, 20)
    found = jax.vmap(lambda v, at: lookup(v, nodes, at))(values, x)
    np.testing.assert_allclose(
        found, [np.interp(a, nodes, v) for v, a in zip(values, x, strict=True)], rtol=1e-12, atol=1e-12
    )


def test_scaled_and_shifted_axes_change_nothing():
    nodes, values, x = GRIDS["uneven"], RNG.normal(size=5), points(GRIDS["uneven"])
    expected = lookup(values, nodes, x)
    np.testing.assert_allclose(lookup(values, 3 * nodes + 2, 3 * x + 2), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(lookup(5 - 2 * values, nodes, x), 5 - 2 * expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(lookup(values[::-1], -nodes[::-1], -x), expected, rtol=1e-9, atol=1e-12)


@grids
def test_not_a_number_stays_and_infinity_is_clamped(nodes):
    values = RNG.normal(size=len(nodes))
    found = lookup(values, nodes, np.array([np.nan, np.inf, -np.inf, 1e300]))
    np.testing.assert_allclose(found, [np.nan, values[-1], values[0], values[-1]])


def count(jaxpr, name):
    """How often a primitive stands in a jaxpr, inner ones included."""
    total = 0
    for equation in jaxpr.eqns:
        total += equation.primitive.name == name
        for inner in jax.tree.leaves(
            list(equation.params.values()), is_leaf=lambda v: hasattr(v, "jaxpr") or hasattr(v, "eqns")
        ):
            inner = getattr(inner, "jaxpr", inner)
            total += count(inner, name) if hasattr(inner, "eqns") else 0
    return total


def test_value_and_slope_take_one_gather_together():
    values, x = jnp.ones(10), jnp.zeros(7)
    jaxpr = jax.make_jaxpr(lambda at: jax.jvp(lambda s: lookup(values, GRIDS["even"], s), (at,), (jnp.ones(7),)))(x)
    assert count(jaxpr.jaxpr, "gather") == 1


def test_tables_over_the_same_signal_share_the_cell_once_compiled():
    def three(a, b, c, x):
        return lookup(a, GRIDS["even"], x) + lookup(b, GRIDS["even"], x) * lookup(c, GRIDS["even"], x)

    text = jax.jit(three).lower(jnp.ones(10), jnp.ones(10), jnp.ones(10), jnp.zeros(700)).compile().as_text()
    assert text is not None
    assert text.count(" floor(") == 1


PAIR = (np.linspace(-1, 3, 5), np.array([0.0, 1.0, 2.5]))


def bilinear(values, y, u):
    """Interpolation along u for each row, then along y."""
    rows = [np.interp(u, PAIR[1], row) for row in values]
    return np.array([np.interp(at, PAIR[0], [row[k] for row in rows]) for k, at in enumerate(y)])


@pytest.mark.thorough
def test_bilinear_value_against_numpy_inside_and_outside():
    values = RNG.normal(size=(5, 3))
    y, u = RNG.uniform(-2, 4, 100), RNG.uniform(-1, 3.5, 100)
    np.testing.assert_allclose(lookup2(values, PAIR, y, u), bilinear(values, y, u), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        lookup2(values.T, (PAIR[1], PAIR[0]), u, y), bilinear(values, y, u), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(
        lookup2(values, PAIR, y[:, None], u), [bilinear(values, 0 * u + a, u) for a in y], rtol=1e-12, atol=1e-12
    )


def test_bilinear_derivatives():
    values, y, u, h = RNG.normal(size=(5, 3)), 0.3, 1.7, 1e-6

    def f(v, a, b):
        return lookup2(v, PAIR, a, b)

    f = jax.jit(f)
    weights = np.outer([0, 1 - 0.3, 0.3, 0, 0], [0, 1 - 0.7 / 1.5, 0.7 / 1.5])
    np.testing.assert_allclose(jax.grad(f)(values, y, u), weights, atol=1e-12)
    np.testing.assert_allclose(jax.jacfwd(f)(values, y, u), weights, atol=1e-12)
    for place, step in ((1, (h, 0)), (2, (0, h))):
        difference = (f(values, y + step[0], u + step[1]) - f(values, y - step[0], u - step[1])) / (2 * h)
        assert float(jax.grad(f, place)(values, y, u)) == pytest.approx(float(difference), rel=1e-8)
    twist = values[2, 2] - values[1, 2] - values[2, 1] + values[1, 1]
    assert float(jax.grad(jax.grad(f, 1), 2)(values, y, u)) == pytest.approx(twist / 1.5, rel=1e-12)


def test_values_of_another_shape_are_refused():
    with pytest.raises(ModelError, match=r"nodes of shape \(10,\) has values of shape \(9,\)"):
        lookup(np.ones(9), GRIDS["even"], 1.0)
    with pytest.raises(ModelError, match=r"nodes of shape \(5, 3\) has values of shape \(3, 5\)"):
        lookup2(np.ones((3, 5)), PAIR, 1.0, 1.0)


def test_table_calls_the_look_up_of_its_number_of_signals():
    one = Table("k", ("y",), ((0.0, 1.0, 2.0),), "s")
    assert one.shape == (3,)
    assert float(one(np.array([1.0, 2.0, 4.0]), 1.5)) == 3.0
    two = Table("k", ("y", "u"), ((0.0, 1.0), (0.0, 1.0, 2.0)))
    assert two.shape == (2, 3)
    assert float(two(np.arange(6.0).reshape(2, 3), 0.5, 1.5)) == 3.0


@pytest.mark.parametrize(
    ("over", "nodes", "words"),
    [
        (("y",), ((0.0,),), "give at least 2"),
        (("y",), ((0.0, 2.0, 1.0),), r"do not increase at number 2 \(2, then 1\)"),
        (("y",), ((0.0, 0.0),), "do not increase at number 1"),
        (("y",), ((0.0, float("nan")),), "finite"),
        (("y", "u"), ((0.0, 1.0),), "one list of nodes for each"),
        ((), (), "one or two signals"),
        (("a", "b", "c"), ((0.0, 1.0),) * 3, "one or two signals"),
    ],
)
@pytest.mark.thorough
def test_tables_that_cannot_be(over, nodes, words):
    with pytest.raises(ModelError, match=words) as caught:
        Table("gain", over, nodes)
    assert "'gain'" in str(caught.value)
