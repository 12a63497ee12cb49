"""Model-predictive control against the regulator where no limit acts, and against OSQP on the same problem not
condensed."""

import numpy as np
import osqp
import pytest
import scipy.sparse as sp
from plants import CARTS, PERIOD, STICK, carts, stick, upright

from plantfit.control import discretised, kalman_observer, linearised, lqr, mpc
from plantfit.control.linear.lqr import regulator
from plantfit.control.linear.predictive.quadratic import Split, prepared, solved
from plantfit.errors import SimulationError

import jax
import jax.numpy as jnp


def by_osqp(hessian, rows, low, high):
    solver = osqp.OSQP()
    solver.setup(
        sp.csc_matrix(hessian), np.zeros(hessian.shape[0]), sp.csc_matrix(rows), low, high,
        eps_abs=1e-10, eps_rel=1e-10, max_iter=400_000, polishing=True, verbose=False,
    )  # fmt: skip
    answer = solver.solve(raise_error=True)
    assert answer.info.status == "solved"
    return answer.x


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_programs_of_any_limits_equal_osqp(seed):
    rng = np.random.default_rng(seed)
    n, rows = 8, 14
    root, t = rng.normal(size=(n, n)), rng.normal(size=(rows, n))
    w, s = root @ root.T + 0.1 * np.eye(n), 2.0 * rng.normal(size=rows)
    inside = t @ rng.normal(size=n) + s  # so that some v meets the limits
    low, high = inside - rng.uniform(0.1, 1.0, rows), inside + rng.uniform(0.1, 1.0, rows)
    soft = np.r_[np.full(9, np.inf), np.full(5, 3.0)]
    low[9:], high[9:] = -0.2, 0.2
    # OSQP sees the soft rows with a slack each
    hessian = sp.block_diag([w, 3.0 * np.eye(5)])
    slack = np.concatenate([np.zeros((9, 5)), np.eye(5)])
    theirs = by_osqp(hessian, np.hstack([t, slack]), low - s, high - s)[:n]
    ours = solved(prepared(w, t, soft), s, low, high, Split(jnp.zeros(rows), jnp.zeros(rows)), 3000)
    np.testing.assert_allclose(ours.moved[:9], (t @ theirs)[:9], atol=2e-6)
    assert np.sum(np.abs(t @ theirs) > 0.05) > 5


def planned(plant, start, horizon, limits, most_speed=None, softness=0.0):
    """The inputs (horizon, m) of least cost by OSQP: states, inputs and slacks all unknown."""
    (n, m), steps, q, r = plant.B.shape, horizon, np.diag([1.0, 0.02]), np.array([[0.1]])
    _, last = regulator(plant, q, r)
    blocks = [q] * (steps - 1) + [last] + [r] * steps
    dynamics = np.hstack([np.eye(n * steps) - np.kron(np.eye(steps, k=-1), plant.A), -np.kron(np.eye(steps), plant.B)])
    begin = np.r_[plant.A @ start, np.zeros(n * (steps - 1))]
    rows = [dynamics, np.hstack([np.zeros((m * steps, n * steps)), np.eye(m * steps)])]
    low, high = [begin, np.full(m * steps, limits[0])], [begin, np.full(m * steps, limits[1])]
    if most_speed is not None:
        blocks += [softness * np.eye(steps)]
        speeds = np.hstack([np.kron(np.eye(steps), np.eye(n)[[1]]), np.zeros((steps, m * steps))])
        rows = [np.hstack([row, np.zeros((len(row), steps))]) for row in rows] + [np.hstack([speeds, np.eye(steps)])]
        low, high = [*low, np.full(steps, -most_speed)], [*high, np.full(steps, most_speed)]
    z = by_osqp(sp.block_diag(blocks), np.concatenate(rows), np.concatenate(low), np.concatenate(high))
    return z[n * steps : (n + m) * steps].reshape(steps, m)


BOTH = ("q", "w")
Q, R = {"q": 1.0, "w": 0.02}, {"u": 0.1}


def first_command(design, model, start, plant=STICK, samples=1):
    seen = design.close(model).simulate(design.parameters, plant, {}, samples=samples, x0=start)
    return np.asarray(seen.command["u"])


@pytest.mark.parametrize(
    ("start", "most_speed"), [((0.05, 0.1), None), ((0.09, 0.3), None), ((-0.14, 0.0), 0.25), ((0.13, -0.4), 0.3)]
)
def test_the_plan_is_that_of_osqp(start, most_speed):
    plant = upright(BOTH)
    limits = None if most_speed is None else {"w": (-most_speed, most_speed)}
    design = mpc(
        plant, PERIOD, Q, R, limits=(-0.8, 0.5), horizon=12, hold=2, state_limits=limits, softness=50.0, steps=4000
    )
    theirs = planned(discretised(plant, 2 * PERIOD), np.array(start), 12, (-0.8, 0.5), most_speed, 50.0)
    ours = first_command(design, stick(BOTH), dict(zip(BOTH, start, strict=True)))
    np.testing.assert_allclose(ours[0], theirs[0, 0], atol=2e-6)


@pytest.mark.thorough
def test_where_no_limit_acts_it_is_the_regulator():
    plant = linearised(carts(), CARTS)
    estimator = kalman_observer(plant, PERIOD, 0.1, 1e-3)
    q, r = {"q": 2.0, "s": 1.0}, {"F": 1.0, "G": 0.5}
    start = {"q": 0.3, "s": -0.2}
    both = [
        design.close(carts(), stepper="rk4", substeps=2).simulate(
            design.parameters, CARTS, {"s": 0.1}, samples=120, x0=start
        )
        for design in (
            lqr(plant, PERIOD, q, r, estimator=estimator),
            mpc(plant, PERIOD, q, r, estimator=estimator, limits=(-100.0, 100.0), horizon=7, steps=3),
        )
    ]
    for name in ("F", "G"):
        np.testing.assert_allclose(both[1].command[name], both[0].command[name], atol=1e-10)


def test_few_steps_follow_the_plan_along_a_motion():
    """Begun where the last sample ended, 25 steps stay near the exact plan, replanned at every sample."""
    plant = upright(BOTH)
    design = mpc(plant, PERIOD, Q, R, limits=(-0.6, 0.6), horizon=15, steps=25)
    seen = design.close(stick(BOTH)).simulate(design.parameters, STICK, {}, samples=40, x0={"q": 0.45})
    q, w = np.asarray(seen.states["q"]), np.asarray(seen.states["w"])
    sampled = discretised(plant, PERIOD)
    exact = [planned(sampled, np.array([q[k], w[k]]), 15, (-0.6, 0.6))[0, 0] for k in range(2, 40, 3)]
    np.testing.assert_allclose(np.asarray(seen.command["u"])[2::3], exact, atol=0.01)
    assert np.sum(np.abs(seen.command["u"]) > 0.599) > 2


def test_a_batch_of_starts():
    plant = upright()
    estimator = kalman_observer(plant, PERIOD, {"w": 1.0}, 1e-3)
    design = mpc(plant, PERIOD, Q, R, limits=(-0.5, 0.5), estimator=estimator, horizon=15)
    loop = design.close(stick())
    starts = jnp.array([-0.1, 0.0, 0.2])
    ends = jax.vmap(lambda q: loop.simulate(design.parameters, STICK, {}, samples=200, x0={"q": q}).y["q"][-1])(starts)
    np.testing.assert_allclose(ends, 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": 0}, "horizon = 0"),
        ({"hold": 1.5}, "hold = 1.5"),
        ({"steps": True}, "steps = True"),
        ({"softness": 0.0}, "softness = 0"),
        ({"state_limits": {"z": (0.0, 1.0)}}, "state_limits names 'z'"),
        ({"limits": {"u": (1.0, 0.0)}}, "lower below upper"),
    ],
)
def test_bad_input_is_named(change, words):
    with pytest.raises(SimulationError, match=words):
        mpc(upright(BOTH), PERIOD, Q, R, **({"limits": (-1.0, 1.0)} | change))
