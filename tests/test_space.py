"""Parameters to cube and back, ties, per-recording copies, and the sentences that wrong ones get."""

import numpy as np
import pytest

from plantfit.errors import SpaceError
from plantfit.space import Parameter, Space

import jax

EXAMPLE = {
    "R": Parameter((0.5, 10.0), "ohm"),
    "T": Parameter((1e-6, 1e-2), "s", scale="log"),
    "g": Parameter(value=9.81),
    "offset": Parameter((-1.0, 1.0), per_recording=True),
    "R2": Parameter(tied="R"),
    "g2": Parameter(tied="g"),
    "offset2": Parameter(tied="offset"),
}


def test_names_order_and_tree():
    space = Space(EXAMPLE, ["a", "b"])
    assert space.names == ("R", "T", "offset[a]", "offset[b]")
    assert space.dimension == 4
    tree = space.tree(np.array([1.0, 2.0, 3.0, 4.0]), "b")
    assert {k: float(v) for k, v in tree.items()} == {
        "R": 1,
        "T": 2,
        "g": 9.81,
        "offset": 4,
        "R2": 1,
        "g2": 9.81,
        "offset2": 4,
    }


def test_physical_matches_closed_form():
    space = Space(EXAMPLE, ["a"])
    np.testing.assert_allclose(space.physical([0.5, 0.5, 0.5]), [5.25, 1e-4, 0.0], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(space.physical(np.zeros(3)), space.lower, rtol=1e-13)
    np.testing.assert_allclose(space.physical(np.ones(3)), space.upper, rtol=1e-13)


@pytest.mark.parametrize("shape", [(3,), (5, 3), (2, 4, 3)])
def test_cube_inverts_physical(shape):
    space = Space(EXAMPLE, ["a"])
    z = np.random.default_rng(0).random(shape)
    np.testing.assert_allclose(space.cube(space.physical(z)), z, atol=1e-12)


def test_gradient_is_finite_with_negative_linear_bounds_beside_log_ones():
    space = Space(EXAMPLE, ["a"])
    slope = np.diag(jax.jacobian(space.physical)(np.array([0.3, 0.5, 0.0])))
    np.testing.assert_allclose(slope, [9.5, 1e-4 * np.log(1e4), 2.0], rtol=1e-12)


def test_permuted_parameters_permute_the_vector():
    names = list(EXAMPLE)
    one, two = Space(EXAMPLE, ["a"]), Space({n: EXAMPLE[n] for n in reversed(names)}, ["a"])
    z = {"R": 0.1, "T": 0.7, "offset[a]": 0.4}
    a = dict(zip(one.names, np.asarray(one.physical(one.vector(z))), strict=True))
    b = dict(zip(two.names, np.asarray(two.physical(two.vector(z))), strict=True))
    assert a == b


ARRAYS = {
    "k": Parameter((0.1, 1.5), "bar", shape=(3,), per_recording=True, start=[0.2, 0.3, 0.4]),
    "R": Parameter((0.5, 10.0)),
    "A": Parameter(([[1, 2, 3], [4, 5, 6]], 1e3), scale="log", shape=(2, 3)),
    "same": Parameter(tied="A", shape=(2, 3)),
    "known": Parameter(value=[1, 2, 4], shape=(3,)),
    "flat": Parameter(value=7.0, shape=(2, 2)),
}


def test_arrays_have_a_coordinate_for_each_entry_beside_each_other():
    space = Space(ARRAYS, ["a", "b"])
    k = [f"k[{i}][{r}]" for r in "ab" for i in range(3)]
    assert space.names == (*k, "R", *(f"A[{i},{j}]" for i in range(2) for j in range(3)))
    np.testing.assert_array_equal(space.lower, [0.1] * 6 + [0.5] + [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(space.upper, [1.5] * 6 + [10.0] + [1e3] * 6)
    np.testing.assert_array_equal(space.log, [False] * 7 + [True] * 6)
    assert {c.unit for c in space.coordinates if c.parameter == "k"} == {"bar"}


def test_tree_gives_arrays_of_the_declared_shape():
    space = Space(ARRAYS, ["a", "b"])
    tree = space.tree(np.arange(13.0), "b")
    np.testing.assert_array_equal(tree["k"], [3, 4, 5])
    assert float(tree["R"]) == 6
    np.testing.assert_array_equal(tree["A"], np.arange(7.0, 13).reshape(2, 3))
    np.testing.assert_array_equal(tree["same"], tree["A"])
    np.testing.assert_array_equal(tree["known"], [1, 2, 4])
    np.testing.assert_array_equal(tree["flat"], np.full((2, 2), 7.0))
    assert all(np.asarray(v).dtype == np.float64 for v in tree.values())


def test_tree_of_arrays_can_be_traced_batched_and_differentiated():
    space = Space(ARRAYS, ["a", "b"])
    batch = np.random.default_rng(0).random((4, 13))
    trees = jax.jit(jax.vmap(lambda v: space.tree(v, "a")))(batch)
    np.testing.assert_array_equal(trees["A"], batch[:, 7:].reshape(4, 2, 3))
    np.testing.assert_array_equal(trees["k"], batch[:, :3])
    slope = jax.grad(lambda v: space.tree(v, "b")["k"] @ np.array([1.0, 2.0, 3.0]))(batch[0])
    np.testing.assert_array_equal(slope, [0, 0, 0, 1, 2, 3, *[0] * 7])


def test_an_array_of_equal_bounds_is_that_many_scalars():
    array = Space({"k": Parameter((0.1, 9.0), scale="log", shape=(4,))})
    scalars = Space({f"k{i}": Parameter((0.1, 9.0), scale="log") for i in range(4)})
    z = np.random.default_rng(0).random((5, 4))
    np.testing.assert_array_equal(array.physical(z), scalars.physical(z))
    np.testing.assert_array_equal(array.cube(array.physical(z)), scalars.cube(scalars.physical(z)))


def test_start_of_an_array_fills_its_entries_and_the_middle_the_others():
    space = Space(ARRAYS, ["a", "b"])
    assert space.start is not None
    np.testing.assert_allclose(space.start, [*[(v - 0.1) / 1.4 for v in (0.2, 0.3, 0.4)] * 2, *[0.5] * 7], rtol=1e-12)
    one = Space({"k": Parameter((0, 2), shape=(2, 2), start=0.5)})
    np.testing.assert_array_equal(one.start, [0.25] * 4)
    with pytest.raises(SpaceError, match=r"'k\[1\]' starts at 3"):
        _ = Space({"k": Parameter((0, 2), shape=(2,), start=[1, 3])}).start


def test_vector_takes_entries_by_name():
    space = Space({"k": Parameter((0, 2), shape=(2,))})
    np.testing.assert_array_equal(space.vector({"k[1]": 1.5, "k[0]": 0.5}), [0.5, 1.5])


def test_parameters_given_as_lists_or_arrays_are_equal():
    bounds = np.array([0.0, 1.0]), np.array([2.0, 3.0])
    assert Parameter(bounds, value=np.array([1.0, 2.0])) == Parameter(([0, 1], [2, 3]), value=[1, 2])


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (Parameter(([0, 1], 1), shape=(3,)), r"a bound of shape \(2,\); give shape \(3,\) or one number"),
        (Parameter(([0, 1, 2], [9, 0, 9]), shape=(3,)), r"'a\[1\]' has reversed bounds \[1, 0\]"),
        (Parameter(([1, 0], 9), scale="log", shape=(2,)), r"'a\[1\]' has scale 'log'"),
        (Parameter(([[0, 1], [2]], 9), shape=(2, 2)), "rows of different lengths"),
        (Parameter((["x", 0], 9), shape=(2,)), "two numbers"),
        (Parameter(value=[1, 2], shape=(3,)), r"a value of shape \(2,\)"),
        (Parameter(value=[1, np.inf], shape=(2,)), "not a finite number"),
        (Parameter(value=[1, 2]), "give one number"),
        (Parameter(([0], [1])), "give one number"),
        (Parameter(tied="b", shape=(2,)), r"shape \(2,\) is tied to 'b' of shape \(\)"),
    ],
)
def test_wrong_arrays(parameter, words):
    with pytest.raises(SpaceError, match=words):
        Space({"a": parameter, "b": Parameter((0, 1))})


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"a": Parameter()}, "neither bounds nor a value"),
        ({"a": Parameter((2, 1))}, "reversed"),
        ({"a": Parameter((1, 1))}, "value = 1"),
        ({"a": Parameter((0, np.inf))}, "finite"),
        ({"a": Parameter((0, np.nan))}, "finite"),
        ({"a": Parameter((1, 2, 3))}, "two numbers"),  # pyrefly: ignore[bad-argument-type]
        ({"a": Parameter(("x", 2))}, "two numbers"),
        ({"a": Parameter("12")}, "two numbers"),  # pyrefly: ignore[bad-argument-type]
        ({"a": Parameter((0, 1), scale="log")}, "above 0"),
        ({"a": Parameter((0, 1), scale="cubic")}, "'linear' or 'log'"),  # pyrefly: ignore[bad-argument-type]
        ({"a": Parameter(value=np.nan)}, "not a finite number"),
        ({"a": Parameter(value="x")}, "not a finite number"),
        ({"a": Parameter(tied="b")}, "does not exist"),
        ({"a": Parameter(tied="b"), "b": Parameter(tied="a")}, "circle"),
        ({"a": Parameter(tied="a")}, "circle"),
    ],
)
def test_wrong_parameters(parameters, words):
    with pytest.raises(SpaceError, match=words) as raised:
        Space(parameters)
    assert "a" in str(raised.value).replace("'", " ").split()


def test_missing_recording_and_missing_value():
    space = Space(EXAMPLE, ["a"])
    with pytest.raises(SpaceError, match="not for 'z'"):
        space.tree(np.zeros(3), "z")
    with pytest.raises(SpaceError, match="No value for parameter 'T'"):
        space.vector({"R": 1.0})
