"""Library models with tables and static curves: closed forms, special cases, options."""

from typing import Any

import numpy as np
import pytest
from model_calls import derivative, initial_state
from scipy.integrate import solve_ivp
from scipy.signal import lti, step

from plantfit.errors import ModelError
from plantfit.models import first_order, hammerstein_wiener, steam_chamber, tabled_first_order

import jax

RNG = np.random.default_rng(5)


def rates(model, x, u, p):
    return {n: float(v) for n, v in derivative(model)(x, u, p).items()}


def simulated(model, u, p, t):
    """Output under a constant input from zero states, by a tight solver."""
    names, channels = (
        list(model.states),
        {**dict.fromkeys([*model.inputs, *(d.channel for d in model.delays)], u), "t": 0.0},
    )
    f = jax.jit(
        lambda x: jax.numpy.stack([derivative(model)(dict(zip(names, x, strict=True)), channels, p)[n] for n in names])
    )
    solution = solve_ivp(lambda _, x: f(x), (0, t[-1]), np.zeros(len(names)), "LSODA", t_eval=t, rtol=1e-10, atol=1e-12)
    return np.array([float(model.output(dict(zip(names, x, strict=True)), channels, p)["y"]) for x in solution.y.T])


def test_steam_chamber_is_its_equation_with_numpy_tables():
    nodes = np.linspace(0, 20, 10)
    p = {"k": RNG.uniform(0.1, 1.5, 10), "A1": RNG.uniform(1, 160, 10), "A2": RNG.uniform(1, 160, 10), "Td": 0.4}
    for x1, x2, u in ((-2.0, 1.0, 10.0), (7.7, -3.0, 55.0), (23.0, 0.5, 100.0)):
        k, a1, a2 = (np.interp(x1, nodes, p[n]) for n in ("k", "A1", "A2"))
        found = rates(steam_chamber(), {"x1": x1, "x2": x2}, {"u": 0.0, "u_delayed": u}, p)
        assert found == pytest.approx({"x1": x2, "x2": (k * u - x1 - a1 * x2) / a2}, rel=1e-12)


def test_steam_surfaces_that_do_not_change_with_the_opening_are_the_tables():
    p = {"k": RNG.uniform(0.1, 1.5, 10), "A1": RNG.uniform(1, 160, 10), "A2": RNG.uniform(1, 160, 10)}
    surfaces = {n: np.repeat(v[:, None], 3, axis=1) for n, v in p.items()}
    x, u = {"x1": 6.5, "x2": 0.2}, {"u": 0.0, "u_delayed": 35.0}
    assert rates(steam_chamber(opening_nodes=[0, 40, 100]), x, u, surfaces) == pytest.approx(
        rates(steam_chamber(), x, u, p), rel=1e-12
    )


def test_steam_chamber_starts_empty_or_measured():
    assert {n: float(v) for n, v in initial_state(steam_chamber())({}, {"u": 1.0}, {"y": 3.0}).items()} == {
        "x1": 0.0,
        "x2": 0.0,
    }
    measured = initial_state(steam_chamber(initial="measured"))({}, {"u": 1.0}, {"y": 3.0})
    assert {n: float(v) for n, v in measured.items()} == {"x1": 3.0, "x2": 0.0}


@pytest.mark.parametrize("over", ["u", "y"])
def test_tabled_process_with_flat_tables_is_the_plain_one(over):
    p = {"K": 1.7, "tau": 12.0, "L": 1.0, "c": 3.0}
    flat = {**p, "K": np.full(6, 1.7), "tau": np.full(6, 12.0)}
    x, u = {"y": 40.0}, {"u": 0.0, "u_delayed": 33.0}
    assert rates(tabled_first_order(over=over), x, u, flat) == pytest.approx(rates(first_order(), x, u, p), rel=1e-12)


@pytest.mark.parametrize(("over", "at"), [("u", 33.0), ("y", 41.0)])
def test_tabled_process_reads_its_tables_where_it_says(over, at):
    nodes, K, tau = np.linspace(0, 100, 6), RNG.uniform(1, 2, 6), RNG.uniform(5, 20, 6)
    expected = (np.interp(at, nodes, K) * 33.0 + 3.0 - 41.0) / np.interp(at, nodes, tau)
    found = rates(
        tabled_first_order(over=over), {"y": 41.0}, {"u": 0.0, "u_delayed": 33.0}, {"K": K, "tau": tau, "c": 3.0}
    )
    assert found["y"] == pytest.approx(expected, rel=1e-12)


LINEAR: dict[str, Any] = {"input_curve": "none", "output_curve": "none"}


@pytest.mark.parametrize("order", [1, 2, 3])
def test_companion_block_is_the_transfer_function(order):
    a = [2.0, 1.5, 0.4][:order]
    t = np.linspace(0, 8, 30)
    found = simulated(
        hammerstein_wiener(order=order, form="companion", **LINEAR), 1.0, {f"a{i + 1}": v for i, v in enumerate(a)}, t
    )
    np.testing.assert_allclose(found, step(lti([1.0], [*a[::-1], 1.0]), T=t)[1], atol=1e-7)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_modal_block_is_the_sum_of_its_modes(order):
    tau, c = [0.5, 2.0, 5.0][:order], [0.3, 1.2][: order - 1]
    t = np.linspace(0, 8, 30)
    p = {**{f"tau{i + 1}": v for i, v in enumerate(tau)}, **{f"c{i + 1}": v for i, v in enumerate(c)}}
    shares = [*c, 1 - sum(c)]
    expected = sum(s * (1 - np.exp(-t / T)) for s, T in zip(shares, tau, strict=True))
    np.testing.assert_allclose(
        simulated(hammerstein_wiener(order=order, form="modal", **LINEAR), 1.0, p, t), expected, atol=1e-7
    )


CURVES = {
    "saturation": (lambda u: np.clip(u, -0.4, 0.6), {"low": -0.4, "high": 0.6}),
    "dead_zone": (lambda u: np.maximum(u - 0.6, 0) + np.minimum(u + 0.4, 0), {"low": -0.4, "high": 0.6}),
    "table": (
        lambda u: np.interp(u, [-1, -0.5, 0, 0.5, 1], [-1, -0.7, 0.1, 0.2, 1]),
        {"f": np.array([-0.7, 0.1, 0.2])},
    ),
    "none": (lambda u: u, {}),
}


@pytest.mark.parametrize("form", ["modal", "companion"])
@pytest.mark.parametrize("kind", CURVES)
def test_at_rest_the_output_is_curve_after_curve(kind, form):
    """Static gain 1 of the block: the start is at rest, and y is g(f(u)) there."""
    curve, p = CURVES[kind]
    model = hammerstein_wiener(input_curve=kind, order=3, form=form, degree=2)
    p = {**{q.name: 0.7 for q in model.parameters}, **p, "g0": 0.2, "g1": 3.0, "g2": -0.5}
    for u in (-1.5, -0.45, 0.3, 0.8, 2.0):
        start = initial_state(model)(p, {"u": u}, {"y": 99.0})
        assert float(model.output(start, {"u": u}, p)["y"]) == pytest.approx(
            0.2 + 3 * curve(u) - 0.5 * curve(u) ** 2, rel=1e-12
        )
        assert list(rates(model, start, {"u": u}, p).values()) == pytest.approx([0.0] * 3, abs=1e-12)


def test_table_without_an_output_curve_is_free_at_every_node_and_carries_the_unit():
    model = hammerstein_wiener(output_curve="none", input_unit="V", output_unit="rad/s")
    assert (model.declared("f").shape, model.declared("f").unit) == ((5,), "rad/s")
    pinned = hammerstein_wiener(input_unit="V", output_unit="rad/s")
    assert (pinned.declared("f").shape, pinned.declared("f").unit) == ((3,), "V")
    assert pinned.declared("g1").unit == "(rad/s)/(V)^1"


@pytest.mark.parametrize(
    ("build", "options", "words"),
    [
        (hammerstein_wiener, {"order": 4}, "order is 4; use a whole number from 1 to 3"),
        (hammerstein_wiener, {"degree": 0}, "degree is 0"),
        (hammerstein_wiener, {"input_curve": "deadzone"}, "Did you mean 'dead_zone'?"),
        (hammerstein_wiener, {"form": "jordan"}, "Use modal, companion"),
        (hammerstein_wiener, {"input_nodes": [0, 1]}, "give at least 3"),
        (hammerstein_wiener, {"input_nodes": [0, 2, 1]}, "do not increase"),
        (hammerstein_wiener, {"output_curve": "table", "output_nodes": "x"}, "output_nodes are 'x'"),
        (steam_chamber, {"nodes": [3]}, "give at least 2"),
        (steam_chamber, {"initial": "rest"}, "use 'zero' or 'measured'"),
        (tabled_first_order, {"over": "t"}, "use 'u' or 'y'"),
        (tabled_first_order, {"initial": "guess"}, "use 'measured' or 'free'"),
    ],
)
def test_options_that_cannot_be(build, options, words):
    with pytest.raises(ModelError) as caught:
        build(**options)
    assert words in str(caught.value)
