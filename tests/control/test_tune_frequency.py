"""Sampled frequency responses and margins against state space with delay states, closed forms and published margins."""

from dataclasses import replace

import numpy as np
import pytest
from test_tune_pid import WISHES, family

import plantfit.runtime  # noqa: F401
from plantfit.control import Gains, LinearPlant, with_dead_time
from plantfit.control.tune.forms.servo_forms import lqi_form
from plantfit.control.tune.forms.smith_form import smith_form
from plantfit.control.tune.frequency import (
    continuous_response,
    frequencies,
    loop_margins,
    margins,
    margins_in_search,
    pid_response,
    poles_outside,
    sampled_response,
)
from plantfit.control.tune.one_loop import OneLoop
from plantfit.control.tune.plant_checks import sign_of
from plantfit.control.tune.reduction import gain_of, integrators, open_poles, reduced, slowest, step_response
from plantfit.control.tune.rules import rule_gains
from plantfit.control.tune.told import _phase
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.models.text.equations import equations

import jax
import jax.numpy as jnp

LAG = equations(
    "y' = (K*delay(u, L) - y)/tau\nz = y",
    inputs=["u"],
    states=["y"],
    outputs=["z"],
    parameters=["K", "tau", "L"],
    name="lag",
)
TWO = equations(
    "a' = (K*delay(u, L) - a)/t1\nb' = (a - b)/t2\nz = b", inputs=["u"], states=["a", "b"], outputs=["z"],
    parameters=["K", "t1", "t2", "L"], name="two",
)  # fmt: skip
TANK = equations(
    "y' = K*delay(u, L)\nz = y", inputs=["u"], states=["y"], outputs=["z"], parameters=["K", "L"], name="tank"
)


def rest_of(model, level=1.0, **parameters):
    rows = {n: np.atleast_1d(np.asarray(v, dtype=float)) for n, v in parameters.items()}
    return OneLoop(model, "z", "u", {}, rows).at_rest(level, (0.0, 1.0))


def test_the_rest_is_where_the_model_stays():
    rest = rest_of(LAG, 6.0, K=[2.0, 3.0], tau=[5.0, 4.0], L=[1.0, 2.0])
    np.testing.assert_allclose(rest.u, [3.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(rest.x[:, 0], 6.0, rtol=1e-12)


@pytest.mark.parametrize("damping", [0.002, 0.05])
def test_frequencies_show_the_peaks_of_plants_that_swing(damping):
    """The largest gain of each plant, of 1/(2 damping sqrt(1 - damping^2)), and Ms of a PI on it."""
    model = equations(
        "p' = v\nv' = W*W*(u - p) - 2*Z*W*v\nz = p", inputs=["u"], states=["p", "v"], outputs=["z"],
        parameters=["W", "Z"], name="swings",
    )  # fmt: skip
    rest = rest_of(model, W=[1.9, 2.0, 2.13], Z=3 * [damping])
    w = frequencies(0.01, 10.0, 200, rest.A)
    peak = np.max(np.abs(continuous_response(rest, w)), axis=1)
    np.testing.assert_allclose(peak, 1 / (2 * damping * np.sqrt(1 - damping**2)), rtol=0.03)
    found, close = (
        margins(pid_response(Gains(0.0, 0.5 * damping), 0.01, w) * sampled_response(rest, 0.01, w), w, 1).ms
        for w in (w, np.linspace(1e-3, 3.0, 60_000))
    )
    np.testing.assert_allclose(found, close, rtol=0.03)
    assert len(frequencies(0.01, 10.0, 200, rest_of(model, W=2.0, Z=0.5).A)) == 200


def test_dead_time_is_exact_in_the_continuous_response():
    rest, w = rest_of(LAG, K=2.0, tau=5.0, L=1.7), np.geomspace(1e-3, 30, 50)
    truth = 2.0 * np.exp(-1.7j * w) / (1 + 5.0j * w)
    np.testing.assert_allclose(continuous_response(rest, w)[0], truth, rtol=1e-12)


@pytest.mark.parametrize("dead", [0.0, 0.3, 1.0, 1.7, 4.45])
def test_the_sampled_response_is_that_of_the_plant_with_delay_states(dead):
    period, rest = 0.5, rest_of(TWO, K=1.3, t1=4.0, t2=1.5, L=dead)
    plain = LinearPlant(
        rest.A[0], rest.B[0].sum(0)[:, None], rest.C[0][None, :], np.zeros((1, 1)), ("a", "b"), ("u",), ("z",),
        np.zeros(2), np.zeros(1), np.zeros(1), {},
    )  # fmt: skip
    late = with_dead_time(plain, period, dead)
    w = frequencies(period, 6.0, 40)
    z = np.exp(1j * w * period)
    truth = [(late.C @ np.linalg.solve(v * np.eye(len(late.A)) - late.A, late.B))[0, 0] for v in z]
    np.testing.assert_allclose(sampled_response(rest, period, w)[0], truth, rtol=1e-9)


def closed_poles(rest, gains, period, dead):
    """Poles of the sampled loop: plant with delay states, integrator and filtered derivative, put together in state
    space."""
    n = rest.A.shape[-1]
    plain = LinearPlant(
        rest.A[0], rest.B[0].sum(0)[:, None], rest.C[0][None, :], np.zeros((1, 1)), tuple("ab"[:n]), ("u",), ("z",),
        np.zeros(n), np.zeros(1), np.zeros(1), {},
    )  # fmt: skip
    late = with_dead_time(plain, period, dead)
    size, kp, ki, kd, tf = len(late.A), gains.Kp, gains.Ki * period / 2, gains.Kd, gains.filter_time
    # states: plant, integral, derivative, last error; e = -y
    a = np.zeros((size + 3, size + 3))
    e = np.concatenate([-late.C[0], np.zeros(3)])
    integral = np.eye(size + 3)[size] + ki * (e + np.eye(size + 3)[size + 2])
    derivative = (tf * np.eye(size + 3)[size + 1] + kd * (e - np.eye(size + 3)[size + 2])) / (tf + period)
    u = kp * e + integral + derivative
    a[:size, :size] = late.A
    a[:size] += np.outer(late.B[:, 0], u)
    a[size], a[size + 1], a[size + 2] = integral, derivative, e
    return np.linalg.eigvals(a)


@pytest.mark.parametrize(("model", "dead"), [(LAG, 0.0), (LAG, 1.3), (TANK, 0.8)])
def test_stability_by_encirclements_is_that_of_the_poles_of_the_closed_loop(model, dead):
    parameters = {"K": 0.4 if model is TANK else 2.0, "L": dead} | ({} if model is TANK else {"tau": 5.0})
    rest, period, rng = rest_of(model, **parameters), 0.25, np.random.default_rng(1)
    w, kinds = frequencies(period, 5.0, 4000), set()
    h = sampled_response(rest, period, w)
    for _ in range(60):
        gain = 10 ** rng.uniform(-1, 1.3)
        gains = Gains(gain, gain / 10 ** rng.uniform(-0.5, 1.5), gain * 10 ** rng.uniform(-2, 0), 1.0, 0.0, 0.1)
        largest = float(np.max(np.abs(closed_poles(rest, gains, period, dead))))
        if abs(largest - 1.0) < 1e-3:
            continue
        found = margins(pid_response(gains, period, w)[None, :] * h, w, 1 + integrators(rest))
        assert bool(found.stable[0]) == (largest < 1.0), (gains, largest)
        kinds.add(largest < 1.0)
        if largest < 1.0:  # at the gain margin a pole lies on the circle
            g = found.gain[0]
            assert np.isfinite(g)
            at = closed_poles(rest, Gains(g * gains.Kp, g * gains.Ki, g * gains.Kd, 1.0, 0.0, 0.1), period, dead)
            assert np.max(np.abs(at)) == pytest.approx(1.0, abs=2e-3)
    assert kinds == {True, False}


@pytest.mark.parametrize("dead", [0.0, 20.0, 150.0, 400.0])
def test_the_phase_of_a_loop_with_a_long_dead_time_has_no_jumps(dead):
    """A lag under a PI every second: its phase is that without dead time less w L, 68,000 degrees at 400 samples."""
    w, gains = frequencies(1.0, 50.0 + dead, 1200), Gains(0.2, 0.004)
    late, plain = (
        pid_response(gains, 1.0, w)[None] * sampled_response(rest_of(LAG, K=1.0, tau=50.0, L=v), 1.0, w)
        for v in (dead, 0.0)
    )
    truth = np.degrees(np.unwrap(np.angle(plain[0])) - w * dead)
    np.testing.assert_allclose(_phase(late, w, np.array([dead]))[0], truth, atol=1e-6)


def test_plants_that_the_data_leave_unstable_are_counted_by_poles_of_their_own():
    """x' = a x + u behind a lag: a PI holds it whatever the sign of a, whose best fit is below 0; poles of the loops
    tell which."""
    drift = equations(
        "x' = a*x + u\nv' = (x - v)/b\nz = v",
        inputs=["u"],
        states=["x", "v"],
        outputs=["z"],
        parameters=["a", "b"],
        name="d",
    )
    rates = np.array([-0.1, 0.1, 0.3, 0.0, -1e-6, 1e-6, -1e-4, 1e-4, 0.01])
    rest, period, kinds = rest_of(drift, a=rates, b=np.full(9, 0.3)), 0.1, []
    w = frequencies(period, 10.0, 1200)
    h, (count, outside) = sampled_response(rest, period, w), open_poles(rest, w[0])
    for kp, ki in ((0.05, 0.001), (0.2, 0.01), (1.0, 0.1), (5.0, 2.0), (40.0, 4.0)):
        found = margins(pid_response(Gains(kp, ki), period, w)[None, :] * h, w, 1 + count, outside)
        each = [type(rest)(*(v[i : i + 1] for v in vars(rest).values())) for i in range(9)]
        truth = [np.max(np.abs(closed_poles(one, Gains(kp, ki, 0.0), period, 0.0))) < 1.0 for one in each]
        assert found.stable.tolist() == truth, (kp, ki)
        kinds += [(bool(a > 0), bool(held)) for a, held in zip(rates, truth, strict=True)]
    assert len(set(kinds)) == 4
    assert not np.any(sign_of(rest)[1])


@pytest.mark.parametrize("kp", [0.5, 1.0, 2.0])
def test_a_lag_without_dead_time_has_its_gain_margin_at_half_the_sampling_frequency(kp):
    """kp (1 - a)/(z - a), a = e^-1, reaches the negative axis at z = -1 alone and crosses it nowhere: (1 + a)/(kp (1
    - a)), 1.08 for 2."""
    rest, a = rest_of(LAG, K=1.0, tau=1.0, L=0.0), np.exp(-1.0)
    w = frequencies(1.0, 1.0, 1200)
    loop = pid_response(Gains(kp), 1.0, w)[None, :] * sampled_response(rest, 1.0, w)
    found, truth = margins(loop, w, 0), (1 + a) / (kp * (1 - a))
    assert found.stable[0]
    assert found.gain[0] == pytest.approx(truth, rel=1e-9)
    assert float(margins_in_search(loop)[0][0]) == pytest.approx(truth, rel=1e-9)


@pytest.mark.parametrize(
    ("model", "parameters", "gm", "pm", "ms"),
    [(LAG, {"K": 1.0, "tau": 5.0, "L": 1.0}, 3.14, 61.4, 1.59), (TANK, {"K": 1.0, "L": 1.0}, 2.96, 46.9, 1.70)],
)
def test_simc_has_the_margins_that_its_paper_states(model, parameters, gm, pm, ms):
    """Skogestad 2003, table 2: tau_c = theta; sampled quickly, the loop is the continuous one."""
    rest, period = rest_of(model, **parameters), 1e-3
    isa = rule_gains("SIMC", reduced(rest), derivative=False)
    assert isa is not None
    w = frequencies(period, 6.0, 6000)
    found = margins(
        pid_response(isa.gains(), period, w)[None, :] * sampled_response(rest, period, w), w, 1 + integrators(rest)
    )
    assert (found.gain[0], found.phase[0], found.ms[0]) == pytest.approx((gm, pm, ms), rel=6e-3)
    assert found.stable[0]


def test_the_half_rule_gives_the_examples_of_its_paper():
    """Skogestad 2003, example E5: 1/((s+1)(0.2s+1)(0.04s+1)(0.008s+1))."""
    text = "\n".join(f"x{k}' = ({'u' if k == 0 else f'x{k - 1}'} - x{k})/t{k}" for k in range(4)) + "\nz = x3"
    states = [f"x{k}" for k in range(4)]
    chain = equations(
        text, inputs=["u"], states=states, outputs=["z"], parameters=[f"t{k}" for k in range(4)], name="chain"
    )
    found = reduced(rest_of(chain, t0=1.0, t1=0.2, t2=0.04, t3=0.008))
    assert found.first_order == pytest.approx((1.0, 1.1, 0.148), rel=1e-6)
    assert found.second_order == pytest.approx((1.0, 1.0, 0.22, 0.028), rel=1e-6)
    assert "half rule" in found.how


def test_a_plant_with_a_zero_is_fitted_and_its_step_is_met():
    text = "a' = (K*delay(u, L) - a)/6\nb' = (a - b)/2\nz = b + 0.5*a"
    plant = equations(text, inputs=["u"], states=["a", "b"], outputs=["z"], parameters=["K", "L"], name="zero")
    rest = rest_of(plant, K=2.0, L=1.0)
    found = reduced(rest)
    assert found.how.startswith("least squares")
    assert gain_of(rest) == pytest.approx(3.0)
    t = np.linspace(0, 40, 300)
    k, t1, t2, dead = found.second_order
    s = np.maximum(t - dead, 0)
    model = k * (1 - (t1 * np.exp(-s / t1) - t2 * np.exp(-s / t2)) / (t1 - t2))
    assert np.max(np.abs(model - step_response(rest, t))) < 0.05 * 3.0


def test_amigo_on_its_own_model():
    """Astrom and Hagglund 2004, eqs. 7 and 8 by hand for K = 1, L = 1, T = 4."""
    isa = rule_gains("AMIGO", reduced(rest_of(LAG, K=1.0, tau=4.0, L=1.0)))
    assert isa is not None
    assert isa[:3] == pytest.approx((0.2 + 0.45 * 4, (0.4 + 0.8 * 4) / 1.4, 0.5 * 4 / 4.3), rel=1e-9)
    assert isa.b == 0.0


def test_a_state_that_reaches_no_measured_output_does_not_hinder_its_loop():
    """The angle of a motor grows while its speed is held: a loop of the speed rests, and has the matrices of the
    speed alone."""
    model = equations(
        "i' = (u - R*i - k*w)/L\nw' = (k*i - d*w)/J\nq' = w\nz = w\ny = q", inputs=["u"], states=["i", "w", "q"],
        outputs=["z", "y"],
        parameters=["R", "L", "k", "d", "J"], name="motor",
    )  # fmt: skip
    p = {n: np.array([v, 1.1 * v]) for n, v in {"R": 1.0, "L": 0.1, "k": 0.2, "d": 0.01, "J": 0.02}.items()}
    speed = OneLoop(model, "z", "u", {}, p)
    assert speed.followed == ("i", "w")
    rest = speed.at_rest(3.0, (-10.0, 0.0, 10.0))
    truth = 3.0 * (p["d"] * p["R"] / p["k"] + p["k"])
    np.testing.assert_allclose(rest.u, truth, rtol=1e-9)
    np.testing.assert_allclose(rest.A[0], [[-10.0, -2.0], [10.0, -0.5]])
    angle = OneLoop(model, "y", "u", {}, p, inner="z")
    assert angle.followed == ("i", "w", "q")
    rest = angle.at_rest(3.0, (-10.0, 0.0, 10.0))
    np.testing.assert_allclose(rest.u, 0.0, atol=1e-9)
    assert angle.of_inner(rest).A.shape == (2, 2, 2)
    assert integrators(rest) == 1
    assert integrators(angle.of_inner(rest)) == 0


@pytest.mark.parametrize("kind", ["smith", "lqi"])
@pytest.mark.thorough
def test_loops_of_controllers_with_poles_outside_are_counted_from_above_and_below_the_line(kind):
    """What a search counts without the controller's own poles is what these and the encirclements say."""
    wishes = replace(WISHES, controller=kind)
    rest = family(4, 1).at_rest(5.0, (-10.0, 0.0, 10.0))
    small = reduced(rest, 0.25)
    plant = ServoPlant.of(rest, small, wishes)
    form = smith_form(plant, small, 1, wishes, None) if kind == "smith" else lqi_form(plant, small, wishes)
    assert form.parts is not None
    w = frequencies(0.5, slowest(small), 400, rest.A)
    h, (at_one, outside) = sampled_response(rest, 0.5, w), open_poles(rest, w[0])
    unstable, own = 0, 0
    for z in np.random.default_rng(5).random((12, form.space.dimension)):
        made = jax.tree.map(np.asarray, form.made(jnp.asarray(z)))
        above, below = form.parts(made, w)
        np.testing.assert_allclose(above / below, form.response(made, w), rtol=1e-9)
        counted = poles_outside(below * (1.0 + above / below * h) - 1.0, at_one + form.parted, outside)
        poles = form.unstable(made)
        known = loop_margins(above / below, h, w, at_one + form.integrators, outside + poles).stable
        np.testing.assert_array_equal(counted == 0, known)
        unstable, own = unstable + int(np.sum(~known)), own + (poles > 0)
    assert kind == "lqi" or (unstable > 0 and own > 0)
