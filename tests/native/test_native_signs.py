"""Changes of sign are taken by the sums that use them: fewer operations, the same bits."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan
from plantfit.native.graph.nodes import walk
from plantfit.native.passes import passes

# isort: split
import jax
import jax.numpy as jnp


def expression(rng, depth=7):
    """A random function of four numbers in which signs change on the way."""
    leaves = [lambda v, i=i: v[i] for i in range(4)]

    def grown(depth):
        if depth == 0:
            return leaves[rng.integers(4)]
        a, b, kind = grown(depth - 1), grown(depth - 1), rng.integers(6)
        return [
            lambda v: -a(v),
            lambda v: a(v) * -b(v),
            lambda v: a(v) - b(v),
            lambda v: -a(v) + b(v),
            lambda v: -(a(v) / v[3]) - b(v) / v[3],
            lambda v: -a(v) * b(v) - v[0],
        ][kind]

    return grown(depth)


def run(function, values):
    def body(c, x):
        return c, function(x)

    return np.asarray(jax.jit(lambda x: native_scan(body, jnp.zeros(()), x, keep=True)[1])(values))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.further(2)
def test_bits_are_those_of_the_code_with_its_signs(seed, monkeypatch):
    function = expression(np.random.default_rng(seed))
    values = tuple(jnp.asarray(a) for a in np.random.default_rng(seed + 100).normal(size=(4, 50)))
    found = run(function, values)
    monkeypatch.setattr(passes, "_sink_signs", lambda region: None)
    jax.clear_caches()
    np.testing.assert_array_equal(found, run(function, values))
    assert np.all(np.isfinite(found))


def test_signs_of_shared_divisions_reach_the_sums(monkeypatch):
    """-a/c and b/c share 1/c; the sign of the first is left to the sum."""
    seen = []
    kept = passes._sink_rows
    monkeypatch.setattr(passes, "_sink_rows", lambda region: (seen.append(region), kept(region)))
    run(lambda v: v[0] * (-v[1] / v[3]) + (v[2] / v[3]), tuple(jnp.ones((4, 3))))
    ops = [node.op for region in seen for node in walk(region)]
    assert "rcp" in ops
    assert "neg" not in ops
