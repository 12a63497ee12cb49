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
    assert {k: float(v) for k, v in tree.items()} == {"R": 1, "T": 2, "g": 9.81, "offset": 4, "R2": 1, "g2": 9.81, "offset2": 4}


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


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"a": Parameter()}, "neither bounds nor a value"),
        ({"a": Parameter((2, 1))}, "reversed"),
        ({"a": Parameter((1, 1))}, "value = 1"),
        ({"a": Parameter((0, np.inf))}, "finite"),
        ({"a": Parameter((0, np.nan))}, "finite"),
        ({"a": Parameter((1, 2, 3))}, "two numbers"),  # type: ignore[arg-type]
        ({"a": Parameter(("x", 2))}, "two numbers"),  # type: ignore[arg-type]
        ({"a": Parameter("12")}, "two numbers"),  # type: ignore[arg-type]
        ({"a": Parameter((0, 1), scale="log")}, "above 0"),
        ({"a": Parameter((0, 1), scale="cubic")}, "'linear' or 'log'"),  # type: ignore[arg-type]
        ({"a": Parameter(value=np.nan)}, "not a finite number"),
        ({"a": Parameter(value="x")}, "not a finite number"),  # type: ignore[arg-type]
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
