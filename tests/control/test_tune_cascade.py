"""Cascades: responses by what the controller does, stability against poles of the closed loop, windup, C, the
search, what is refused."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from c_programs import PidProgram

import plantfit.runtime  # noqa: F401
from plantfit.control.c_export import cascade_to_c
from plantfit.control.linear.cascade import Cascade, Ends, cascade, cascade_response
from plantfit.control.pid import Gains
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.forms.cascade_form import cascade_form
from plantfit.control.tune.frequency import frequencies, input_matrices, loop_margins, pid_response, sampled_response
from plantfit.control.tune.loop_scores import Limits
from plantfit.control.tune.reduction import behind, gain_of, reduced
from plantfit.control.tune.told import table, verdict
from plantfit.errors import SimulationError
from plantfit.findings.results.tuned_controller import CascadeLoop, PidLoop
from plantfit.models.text.equations import equations
from plantfit.report.pages.controller import reduction

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

CHAIN = equations(
    "v' = (K*u - v)/t1\nw' = (v - w)/t2\ny' = (w - y)/t3\nz = y\nm = v", inputs={"u": "V"},
    states={"v": "K", "w": "K", "y": "K"},
    outputs={"z": "K", "m": "K"}, parameters=["K", "t1", "t2", "t3"], name="chain",
)  # fmt: skip
DRIVE = equations(
    "w' = (K*u - w)/t1\nq' = w\nz = q\nm = w", inputs={"u": "V"}, states={"w": "rad/s", "q": "rad"},
    outputs={"z": "rad", "m": "rad/s"},
    parameters=["K", "t1"], name="drive",
)  # fmt: skip
WISHES = Wishes(5.0, 2.0, 0.5, 0.5, -10.0, 10.0, controller="cascade", noise=0.005, inner_noise=0.01)
GAINS = Cascade(Gains(3.0, 0.2, 6.0, 0.7, 0.0, 0.5), Gains(1.5, 0.6))
OPEN = Limits(-np.inf, np.inf, 0.0), Ends(-np.inf, np.inf)


def family(n, seed):
    """The best fit, then n draws of 10 % each."""
    rng = np.random.default_rng(seed)
    values = {"K": 2.0, "t1": 5.0, "t2": 10.0, "t3": 10.0}
    return OneLoop(
        CHAIN, "z", "u", {}, {k: v * np.r_[1.0, np.exp(0.1 * rng.normal(size=n))] for k, v in values.items()}, "m"
    )


def drive():
    return OneLoop(DRIVE, "z", "u", {}, {"K": np.array([3.0]), "t1": np.array([2.0])}, "m")


@pytest.mark.parametrize("measured", ["y", "v"])
def test_response_is_that_of_what_the_controller_does(measured):
    """The z-transform of its answer to an impulse of either measurement."""
    law, h, given = cascade(0.5, "none", "y", "v"), 0.5, (GAINS, 1.5, *OPEN)
    at = {"y": 4.0, "v": 2.0}
    state = law.init({k: jnp.asarray(v) for k, v in at.items()}, given)
    pulse = np.r_[1.0, np.zeros(299)]

    def step(s, p):
        return law.update(s, {k: v + (p if k == measured else 0.0) for k, v in at.items()}, 4.0, given)

    _, u = jax.lax.scan(step, state, jnp.asarray(pulse))
    angles = np.array([0.1, 0.7, 2.0])
    z = 1.2 * np.exp(1j * angles)
    truth = -np.sum(np.asarray(u)[:, None] * z[None, :] ** -np.arange(300)[:, None], axis=0)
    w = (angles - 1j * np.log(1.2)) / h
    found = cascade_response(pid_response(GAINS.outer, h, w), pid_response(GAINS.inner, h, w))
    np.testing.assert_allclose(found[0 if measured == "y" else 1], truth, rtol=1e-7)


def closed_poles(rest, gains, period):
    """Of plant and controller together, by exact derivatives of one sample of both."""
    a, b = input_matrices(rest, period)
    assert len(b) == 1
    law, seen = cascade(period, "none", "y", "v"), (rest.C[0], np.eye(len(a))[0])  # the first state is the inner output
    given = (gains, 0.0, *OPEN)
    start, back = ravel_pytree(law.init({"y": jnp.zeros(()), "v": jnp.zeros(())}, given))
    n = len(a)

    def moved(s):
        x = s[:n]
        state, u = law.update(back(s[n:]), {"y": seen[0] @ x, "v": seen[1] @ x}, 0.0, given)
        return jnp.concatenate([a @ x + b[0] * u, ravel_pytree(state)[0]])

    return np.linalg.eigvals(np.asarray(jax.jacfwd(moved)(jnp.concatenate([jnp.zeros(n), jnp.zeros_like(start)]))))


@pytest.mark.parametrize("which", ["chain", pytest.param("drive", marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_stability_is_that_of_the_poles_of_the_closed_loop(which):
    """Two integrators in the controller, a third in the drive; 150 random gains, stable and not."""
    loop = family(0, 1) if which == "chain" else drive()
    rest = loop.at_rest(5.0, (-10.0, 0.0, 10.0))
    w = frequencies(0.5, 20.0, 3000)
    h = np.stack([sampled_response(rest, 0.5, w), sampled_response(loop.of_inner(rest), 0.5, w)], axis=1)
    rng, both = np.random.default_rng(4), [0, 0]
    for _ in range(150):
        k, ti, kd, p, ti2 = np.exp(
            rng.uniform(np.log([0.03, 3.0, 0.01, 0.1, 0.5]), np.log([20.0, 100.0, 30.0, 10.0, 30.0]))
        )
        gains = Cascade(Gains(k, k / ti, kd, 1.0, 0.0, 0.5), Gains(p, p / ti2))
        sizes = np.abs(closed_poles(rest, gains, 0.5))
        if abs(np.max(sizes) - 1.0) < 2e-3:
            continue
        truth = bool(np.max(sizes) < 1.0)
        c = cascade_response(*(pid_response(g, 0.5, w) for g in gains))
        assert bool(loop_margins(c, h, w, 2 if which == "chain" else 3).stable[0]) == truth
        both[truth] += 1
    assert min(both) >= 15, both


def test_the_gain_margin_of_an_outer_loop_that_needs_its_gain_is_the_factor_above_one():
    """k (z - 0.95)^2/(z - 1)^3 outside, nothing inside: below a gain and above another it is unstable, and a pole
    tells the latter."""
    w = np.geomspace(1e-4, np.pi, 4000)
    z, numerator, denominator = np.exp(1j * w), 0.3 * np.r_[0.0, np.poly([0.95, 0.95])], np.poly([1.0, 1.0, 1.0])
    loop = np.polyval(numerator, z) / np.polyval(denominator, z)
    h = np.stack([loop, 0.0 * loop])[None]
    found = loop_margins(np.stack([np.ones(4000), np.zeros(4000)]), h, w, 3)
    assert found.stable[0]
    assert found.gain[0] > 1.0
    sizes = [np.max(np.abs(np.roots(denominator + found.gain[0] * share * numerator))) for share in (0.999, 1.001)]
    assert sizes[0] < 1.0 < sizes[1]


def test_it_begins_at_rest_and_the_inner_set_point_stays_within_its_ends():
    law = cascade(0.5, "clamping", "y", "v")
    given = (GAINS, 1.5, Limits(-1e3, 1e3, 0.0), Ends(1.0, 3.0))
    rest = {"y": jnp.asarray(4.0), "v": jnp.asarray(2.0)}
    state = law.init(rest, given)
    for _ in range(3):
        state, command = law.update(state, rest, 4.0, given)
        assert float(command) == pytest.approx(0.0, abs=1e-12)
    for _ in range(100):  # the error stays: the inner set point is held at 3, one above the inner measurement
        before = float(state[1].integral)
        state, command = law.update(state, rest, 400.0, given)
    assert float(state[1].integral) - before == pytest.approx(0.5 * 0.6 * 1.0)
    assert float(state[0].integral) < 10.0  # it did not wind up


def test_it_does_not_wind_up_while_the_input_is_at_its_limit():
    """After a long time at a limit the outer integral is what it was, so that the output leaves the set point's side
    at once."""
    law = cascade(0.5, "clamping", "y", "v")
    given = (GAINS, 0.0, Limits(-2.0, 2.0, 0.0), Ends(-np.inf, np.inf))
    state = law.init({"y": jnp.asarray(0.0), "v": jnp.asarray(0.0)}, given)
    for _ in range(200):
        state, command = law.update(state, {"y": 0.0, "v": 0.5}, 10.0, given)
        assert float(command) == 2.0
    assert abs(float(state[0].integral)) < 5.0
    assert abs(float(state[1].integral)) < 50.0


@pytest.mark.parametrize("anti_windup", ["clamping", "back-calculation", "none"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_c_file_equals_python_over_ten_thousand_samples(tmp_path, anti_windup, sign):
    gains = Cascade(GAINS.outer, Gains(sign * 1.5, sign * 0.6))
    rng, follow = np.random.default_rng(1), 0.5 / 4.0 if anti_windup == "back-calculation" else 0.0
    n = np.arange(10_000)
    r = 5 + 0.4 * (n // 700 % 2)
    y = r + 0.3 * np.sin(n / 37.0) + rng.normal(0, 0.02, 10_000)
    v = 2.0 + 1.2 * np.sin(n / 37.0 + 0.7) + rng.normal(0, 0.1, 10_000)
    given = (gains, 1.0, Limits(-1.0, 3.0, follow), Ends(0.0, 4.0))
    law = cascade(0.5, anti_windup, "y", "v")
    begin = law.init({"y": jnp.asarray(y[0]), "v": jnp.asarray(v[0])}, given)
    _, truth = jax.lax.scan(
        lambda s, k: law.update(s, {"y": k[0], "v": k[1]}, k[2], given), begin, tuple(jnp.asarray(a) for a in (y, v, r))
    )  # fmt: skip
    tracked = 4.0 if follow else None
    program = CascadeProgram(
        cascade_to_c(
            gains, tmp_path, period=0.5, lower=-1.0, upper=3.0, inner_lower=0.0, inner_upper=4.0,
            anti_windup=anti_windup,
            tracking_time=tracked, name="both",
        )
    )  # fmt: skip
    program.begin(y[0], v[0], 1.0)
    told = np.array([program.update(*k) for k in zip(y, v, r, strict=True)])
    assert (told.min(), told.max()) == (-1.0, 3.0)
    assert np.mean((told > -1.0) & (told < 3.0)) > (0.04 if anti_windup == "none" else 0.1)
    np.testing.assert_allclose(told, np.asarray(truth) + 1.0, rtol=1e-12, atol=1e-11)


class CascadeProgram(PidProgram):
    """A cascade as exported."""

    def __init__(self, files):
        super().__init__(files, "double")
        self._init.argtypes, self._update.argtypes = (
            (*self._init.argtypes, self.kind),
            (*self._update.argtypes, self.kind),
        )

    def begin(self, outer, inner, command):  # pyrefly: ignore[bad-override]  (measures two)
        self._init(self.state, outer, inner, command)

    def update(self, outer, inner, reference):  # pyrefly: ignore[bad-override]
        return self._update(self.state, outer, inner, reference)


@pytest.mark.thorough
def test_what_cannot_be_is_said(tmp_path):
    with pytest.raises(SimulationError, match=r"A cascade measures two outputs; name the inner one"):
        tuned_loop(replace(family(3, 1), inner=None), replace(family(3, 2), inner=None), WISHES)
    still = equations("y' = (u - y)/t1\ns' = -s/t1\nz = y\nm = s", inputs=["u"], states=["y", "s"], outputs=["z", "m"],
                      parameters=["t1"],
                      name="still")  # fmt: skip
    apart = OneLoop(still, "z", "u", {}, {"t1": np.array([5.0, 5.1])}, "m")
    with pytest.raises(SimulationError, match=r"u does not move the inner output m at the set point"):
        tuned_loop(apart, apart, WISHES)
    with pytest.raises(SimulationError, match=r"inner set point's limits are \[4, 0\]; give lower below upper"):
        cascade_to_c(GAINS, tmp_path, period=0.5, inner_lower=4.0, inner_upper=0.0)


def test_the_start_of_a_position_loop_holds_it():
    """SIMC within, the drive's integrator without: stable, by the poles of the closed loop."""
    loop = drive()
    rest = loop.at_rest(5.0, (-10.0, 0.0, 10.0))
    form = cascade_form(reduced(rest, 0.25), reduced(loop.of_inner(rest), 0.25), ("z", "m"), WISHES, None)
    gains = jax.tree.map(float, form.made(form.starts[0]))
    assert np.max(np.abs(closed_poles(rest, gains, 0.5))) < 1.0


@pytest.fixture(scope="module")  # of slow tests
def design():
    return tuned_loop(family(30, 1), family(60, 2), WISHES, budget=250, seed=3)


@pytest.mark.slow
def test_a_load_is_hardly_seen_beside_a_pid_of_the_output_alone(design):
    """The inner loop takes the load away before the two lags that follow."""
    best, pid = design.best, design.rows[2]
    assert [r.form.name for r in design.rows[:3]] == ["cascade", "cascade", "PID"]
    assert best.share >= 0.9
    assert pid.scores.load_iae > 10.0 * best.scores.load_iae
    assert pid.scores.iae > 1.2 * best.scores.iae
    assert isinstance(table(design)[0], CascadeLoop)
    assert isinstance(table(design)[2], PidLoop)
    assert any("A PID tuned on the same plants: " in v.sentence for v in verdict(design, {}))


@pytest.mark.slow
def test_its_loops_are_those_of_a_plain_simulation(design):
    """Plant number 5 by its matrix exponential, the controller sample by sample."""
    w, p = design.wishes, {n: float(v[5]) for n, v in design.family.plants.items()}
    law = cascade(0.5, "clamping", "z", "m")
    rest = 3.0 / p["K"]
    given = (design.best.parameters, rest, Limits(-10.0, 10.0, 0.0), Ends(-np.inf, np.inf))
    a = np.array([[-1 / p["t1"], 0, 0], [1 / p["t2"], -1 / p["t2"], 0], [0, 1 / p["t3"], -1 / p["t3"]]])
    from scipy.linalg import expm

    big = expm(0.5 * np.block([[a, np.array([[p["K"] / p["t1"]], [0], [0]])], [np.zeros((1, 4))]]))
    x, update = np.full(3, 3.0), jax.jit(law.update)
    state = law.init({"z": jnp.asarray(3.0), "m": jnp.asarray(3.0)}, given)
    seen = design.judge.responses(design.best.parameters)["y"][5]
    for k in range(len(seen)):
        assert seen[k] == pytest.approx(x[2], abs=1e-6)
        state, command = update(state, {"z": x[2], "m": x[0]}, w.set_point, given)
        u = float(command) + rest + (w.load if k >= design.course.begin else 0.0)
        x = big[:3, :3] @ x + big[:3, 3] * u


CART = equations(
    "v' = K*u - c\ny' = v\nz = y\nm = v", inputs={"u": "V"}, states={"v": "m/s", "y": "m"},
    outputs={"z": "m", "m": "m/s"}, parameters=["K", "c"], name="cart",
)  # fmt: skip


def cart(*gains):
    return OneLoop(CART, "z", "u", {}, {"K": np.array(gains), "c": np.full(len(gains), 9.81)}, "m")


@pytest.mark.slow
def test_a_plant_of_two_integrators_of_which_the_inner_loop_closes_one_is_tuned():
    """As a copter's height by its climb; the loop is replayed on the closed form of the plant between samples."""
    wishes = Wishes(2.0, 0.5, 0.2, 0.02, 4.0, 15.0, controller="cascade", noise=0.002, inner_noise=0.002)
    found = tuned_loop(cart(1.0, 0.97, 1.03), cart(1.0, 0.98, 1.02), wishes, budget=100)
    assert [r.name for r in found.rows] == ["all plants", "best fit alone"]
    assert found.best.margins.stable
    assert found.best.scores.left < 0.05
    assert found.sign == 1
    law, h = cascade(0.02, "clamping", "z", "m"), 0.02
    given = (found.best.parameters, 9.81, Limits(4.0, 15.0, 0.0), Ends(-np.inf, np.inf))
    y, v, state, update = 1.5, 0.0, None, jax.jit(law.update)
    for _ in range(500):
        seen = {"z": jnp.asarray(y), "m": jnp.asarray(v)}
        state = law.init(seen, given) if state is None else state
        state, u = update(state, seen, 2.0, given)
        pull = float(np.clip(u, 4.0 - 9.81, 15.0 - 9.81))  # the command is counted from the input at rest
        y, v = y + h * v + 0.5 * h * h * pull, v + h * pull
    assert y == pytest.approx(2.0, abs=0.02)
    assert v == pytest.approx(0.0, abs=0.02)


def test_a_chain_that_no_inner_loop_closes_is_refused():
    """Three integrators, of which the inner output sees two; and a PID of two says what else there is."""
    three = equations(
        "a' = K*u\nv' = a\ny' = v\nz = y\nm = v", inputs=["u"], states=["a", "v", "y"], outputs=["z", "m"],
        parameters=["K"], name="three",
    )  # fmt: skip
    one = OneLoop(three, "z", "u", {}, {"K": np.ones(1)}, "m")
    wishes = Wishes(2.0, 0.5, 0.2, 0.02, -5.0, 5.0, controller="cascade")
    with pytest.raises(SimulationError, match="The plant has 2 integrators between input and output"):
        tuned_loop(one, one, wishes)
    with pytest.raises(SimulationError, match=r"--controller cascade --inner NAME\), or hold its states \(--hold\)"):
        tuned_loop(cart(1.0), cart(1.0), Wishes(2.0, 0.5, 0.2, 0.02, 4.0, 15.0))


def test_what_the_outer_loop_sees_is_the_loop_closed_by_hand():
    """From the set point of v to y under u = k (e + int e / ti): k K (s + 1/ti) / (s (s^2 + k K s + k K / ti))."""
    loop = cart(2.0)
    rest = loop.at_rest(2.0, (-10.0, 0.0, 10.0))
    seen = behind(rest, loop.of_inner(rest), (3.0, 0.5), loop.inner_row(rest)[0])
    for s in (0.3, 2.0 + 1.0j):
        truth = 6.0 * (s + 2.0) / (s * (s**2 + 6.0 * s + 12.0))
        assert seen.C[0] @ np.linalg.solve(s * np.eye(3) - seen.A[0], seen.B[0, 0]) == pytest.approx(truth)
    assert gain_of(rest) == pytest.approx(2.0)  # of the second derivative


def test_the_page_names_rules_only_where_they_are_beside_it():
    plant = SimpleNamespace(how="half rule", gain=2.0, lag=np.inf, dead_time=0.1, integrating=True)
    for sources, begins in (
        (["this search", "the same search on one plant"], "The outer loop sees the plant as an integrator"),
        (["this search", "the same search on one plant", "Skogestad"], "The rules saw the plant as an integrator"),
    ):
        record: Any = SimpleNamespace(reduced=plant, controllers=[SimpleNamespace(source=s) for s in sources])
        assert reduction(record).startswith(begins)
