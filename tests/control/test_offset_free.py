"""Dead time in linear plants and offset-free predictive control, against closed forms and scipy."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import lsq_linear

import plantfit.runtime  # noqa: F401
from plantfit.control import LinearPlant, offset_free_mpc, with_dead_time
from plantfit.errors import SimulationError
from plantfit.models.text.equations import equations
from plantfit.simulate.loop.closed_loop import closed_loop

import jax.numpy as jnp

TWO = equations(
    "a' = (K*delay(u, Td) + load - a)/T1\nb' = (a - b)/T2\nz = b",
    inputs=["u", "load"], states=["a", "b"], outputs=["z"], parameters=["K", "T1", "T2", "Td"], name="two",
)  # fmt: skip
NUMBERS = {"K": 2.0, "T1": 1.5, "T2": 0.7, "Td": 0.83}


def plant(gain=2.0, t1=1.5, t2=0.7):
    a, b = np.array([[-1 / t1, 0.0], [1 / t2, -1 / t2]]), np.array([[gain / t1], [0.0]])
    rest = {"states": ("a", "b"), "inputs": ("u",), "outputs": ("z",), "units": {}}
    return LinearPlant(
        a,
        b,
        np.array([[0.0, 1.0]]),
        np.zeros((1, 1)),
        x0=np.array([2.0, 2.0]),
        u0=np.array([1.0]),
        y0=np.array([2.0]),
        **rest,
    )


def designed(R=0.05, late=0.83, seconds=1.0, **more):
    given: dict[str, Any] = {"limits": (0.0, 3.0), "disturbance": 0.5, "measurement": 0.01, "horizon": 15, "steps": 400}
    return offset_free_mpc(plant(), 0.25, 1.0, R, dead_time=late, longest_delay=seconds, **given | more)


@pytest.mark.parametrize(("late", "longest"), [(0.0, 0.0), (0.5, 0.5), (0.83, 1.0), (0.1, 2.0), (0.75, 0.75)])
def test_dead_time_as_states(late, longest):
    """The step response is that of two lags in series, begun `late` seconds later."""
    made = with_dead_time(plant(), 0.25, late, longest)
    assert made.A.shape[0] == 2 + round(np.ceil(longest / 0.25))
    x, ys = np.zeros(made.A.shape[0]), []
    for _ in range(40):
        ys.append((made.C @ x)[0])
        x = made.A @ x + made.B[:, 0]
    t = np.maximum(0.25 * np.arange(40) - late, 0.0)
    np.testing.assert_allclose(ys, 2.0 * (1 - (1.5 * np.exp(-t / 1.5) - 0.7 * np.exp(-t / 0.7)) / 0.8), atol=1e-12)


@pytest.mark.parametrize("level", [2.3, 3.5, 5.9, 0.2])
def test_the_first_move_is_that_of_bounded_least_squares(level):
    """From rest at 2 the plan is the least of a sum of squares over bounded moves, not condensed about a regulator;
    scipy solves it."""
    design = designed(late=0.83)
    state = design.controller.init(jnp.asarray(2.0), design.parameters)
    move = float(design.controller.update(state, jnp.asarray(2.0), jnp.asarray(level), design.parameters)[1]["u"])
    late = with_dead_time(plant(), 0.25, 0.83, 1.0)
    a, b, n = late.A, late.B, len(late.A)
    p = solve_discrete_are(a, b, late.C.T @ late.C, np.array([[0.05]]))
    factor = np.linalg.cholesky(p + 1e-12 * np.eye(n)).T
    u_rest = (level - 2.0) / 2.0  # deviations: gain 2
    x, moves, rows, right = np.r_[-(level - 2.0), -(level - 2.0), np.full(n - 2, -u_rest)], np.zeros((n, 15)), [], []
    for k in range(15):
        rows += [late.C @ moves, np.sqrt(0.05) * np.eye(15)[k : k + 1]]
        right += [-(late.C @ x), np.zeros(1)]
        moves = a @ moves
        moves[:, k] += b[:, 0]
        x = a @ x
    rows, right = np.vstack([*rows, factor @ moves]), np.concatenate([*right, -(factor @ x)])
    best = lsq_linear(rows, right, bounds=(0.0 - 1.0 - u_rest, 3.0 - 1.0 - u_rest), method="bvls", tol=1e-13).x
    assert move == pytest.approx(best[0] + 1.0 + u_rest, abs=2e-5)


@pytest.mark.thorough
def test_no_offset_with_another_gain_dead_time_and_load():
    for parameters, load in ((NUMBERS, 0.0), ({"K": 1.5, "T1": 1.9, "T2": 0.6, "Td": 0.95}, 0.0), (NUMBERS, -0.8)):
        design = designed(R=0.2, steps=25, disturbance=0.1, measurement=0.1)
        loop = closed_loop(TWO, design.controller, period=0.25, output="z", input="u", longest_delay=1.0)
        seen = loop.simulate(design.parameters, parameters, np.repeat([1.0, 3.0], 120), inputs={"load": load})
        y, u = np.asarray(seen.y), np.asarray(seen.u)
        np.testing.assert_allclose([y[119], y[-1]], [1.0, 3.0], atol=1e-3)
        assert u.min() >= 0.0
        assert u.max() <= 3.0


def test_designs_of_one_longest_delay_share_a_loop():
    one, other = designed(late=0.1), designed(late=0.99, R=2.0)
    assert one.controller is other.controller
    shapes = [
        [np.shape(v) for v in (d.parameters.F, d.parameters.free, d.parameters.task.project)] for d in (one, other)
    ]
    assert shapes[0] == shapes[1]


def test_bad_input_is_named():
    wide = replace(plant(), C=np.eye(2), D=np.zeros((2, 1)), outputs=("a", "b"), y0=np.zeros(2))
    blind = replace(plant(), B=np.zeros((2, 1)))
    for said, call in (
        ("longest_delay = 0.5", lambda: designed(late=0.83, seconds=0.5)),
        ("dead_time = -1", lambda: with_dead_time(plant(), 0.1, -1.0)),
        ("horizon = 0", lambda: designed(horizon=0)),
        ("1 inputs and 2 outputs", lambda: offset_free_mpc(wide, 0.1, 1, 1, limits=None, disturbance=1, measurement=1)),
        ("do not tell a load", lambda: offset_free_mpc(blind, 0.1, 1, 1, limits=None, disturbance=1, measurement=1)),
        ("measurement = 0", lambda: designed(measurement=0)),
    ):
        with pytest.raises(SimulationError, match=said):
            call()
