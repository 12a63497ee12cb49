"""Inputs designed for a study's plant, against closed forms and against what fits of simulated recordings reach."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.special import erf
from scipy.stats import multivariate_normal

import plantfit as pf
from plantfit.errors import ModelError, SearchError, SpecError
from plantfit.experiment_design import _times, _without_limit, at_once
from plantfit.native.kept_programs import Kept
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.report.pages.next_experiment import asked, write_next_experiment_page
from plantfit.trust.experiment.criteria import Precision
from plantfit.trust.experiment.shapes import kind_of, shapes
from plantfit.trust.experiment.told import _beyond, precision_sentences

RATE = 0.1  # s
ONE = {"u": "1", "y": "1"}


def first_order(u, K, tau, L, dt=RATE):
    """y' = (K u(t - L) - y) / tau from rest, u held; exact at the samples (n,), the delay rounded to none of them."""
    whole, part = int(L // dt), L % dt
    late = np.r_[np.zeros(whole), u][: len(u)]
    later = np.r_[0.0, late][: len(u)]
    a, b = np.exp(-dt / tau), np.exp(-(dt - part) / tau)
    gained = K * ((1 - b) * late + (b - a) * later)  # until `part` into each sample the input before still acts
    return np.r_[0.0, lfilter([1.0], [1.0, -a], gained)[:-1]]


def resonance(u, K, w0, d, dt=0.05):
    """x'' = w0^2 (K u - x) - 2 d w0 x' from rest, u held; exact at the samples (n,)."""
    A = np.array([[0.0, 1.0, 0.0], [-w0 * w0, -2 * d * w0, K * w0 * w0], [0.0, 0.0, 0.0]])
    E = expm(A * dt)
    trace, det = E[0, 0] + E[1, 1], E[0, 0] * E[1, 1] - E[0, 1] * E[1, 0]
    b1, b2 = E[0, 2], E[0, 1] * E[1, 2] - E[1, 1] * E[0, 2]
    return lfilter([0.0, b1, b2], [1.0, -trace, det], u)


def answer_of(text, states, bounds, t, u, y, noise):
    model = pf.equations(
        text, inputs={"u": "1"}, outputs={"y": "1"}, states=states, parameters=list(bounds), name="plant", check=False
    )
    rng = np.random.default_rng(11)
    record = pf.from_arrays({"t": t, "u": u, "y": y + noise * rng.standard_normal(len(t))}, time="t", units=ONE)
    parameters = {n: pf.Parameter(bounds=b, scale="log", unit=w) for n, (b, w) in bounds.items()}
    return pf.fit(pf.Problem(model, record, parameters), seed=1)


LAG = {"K": (1.7, "1"), "tau": (1.3, "s"), "L": (0.43, "s")}


@pytest.fixture(scope="module")
def lag():
    t = RATE * np.arange(200)
    u = np.where(t < 1.0, 0.0, 0.5)
    bounds = {"K": ((0.2, 10.0), "1"), "tau": ((0.1, 10.0), "s"), "L": ((0.05, 2.0), "s")}
    y = first_order(u, *(LAG[n][0] for n in bounds))
    return answer_of("x' = (K*delay(u, L) - x)/tau\ny = x", {"x": "1"}, bounds, t, u, y, 0.02)


@pytest.fixture(scope="module")
def mode():
    t = 0.05 * np.arange(400)
    u = np.where(t < 1.0, 0.0, 0.7)
    bounds = {"K": ((0.1, 20.0), "1"), "w0": ((0.5, 20.0), "1/s"), "d": ((0.01, 1.0), "1")}
    return answer_of(
        "x' = v\nv' = w0*w0*(K*u - x) - 2*d*w0*v\ny = x",
        {"x": "1", "v": "1/s"},
        bounds,
        t,
        u,
        resonance(u, 2.0, 3.0, 0.15),
        0.1,
    )


@pytest.fixture(scope="module")
def static():
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, 60)
    model = pf.equations(
        "y = a + b*u + c*u*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=list("abc"), name="parabola"
    )
    record = pf.from_arrays({"u": u, "y": 1 + 2 * u - u * u + 0.1 * rng.standard_normal(60)}, period=1.0, units=ONE)
    return pf.fit(pf.Problem(model, record, {n: (-10.0, 10.0) for n in "abc"}), seed=1)


def test_a_parabola_is_measured_at_three_points_a_third_each(static):
    # Fedorov 1972, section 2.1: the D-optimal design of a quadratic over [-1, 1] is -1, 0, 1 with equal weights
    found = pf.design(static, inputs={"u": (-1, 1)}, duration=48, alone=True, draws=0, seed=3)
    u = np.round(found.recording["u"], 6)
    assert [int(np.sum(u == v)) for v in (-1, 0, 1)] == [16, 16, 16]
    rows = {r["name"]: r["alone"] for r in found.record["parameters"]}
    design = np.stack([np.ones(48), u, u * u], axis=1)
    noise = found.record["noise"]["y"]
    expected = noise * np.sqrt(found.record["inflation"] * np.diag(np.linalg.inv(design.T @ design)))
    assert [rows[n] for n in "abc"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.thorough
def test_a_curve_without_dynamics_is_told_as_levels_and_a_plant_with_them_as_time(static, lag, tmp_path):
    curve = pf.design(static, inputs={"u": (-1, 1)}, duration=48, alone=True, draws=0, seed=3)
    assert [(level["values"], level["samples"]) for level in curve.record["levels"]] == [
        ([-1], 16),
        ([0], 16),
        ([1], 16),
    ]
    said = " ".join(v["sentence"] for v in curve.verdict)
    assert "With 48 samples at these levels the standard errors become" in said
    assert "measure at u = -1 (16 samples), u = 0 (16 samples) and u = 1 (16 samples), each when the plant" in said
    assert "chirp" not in said
    assert "48 s of" not in said + repr(curve) + " ".join(asked(curve.typed))
    moving = pf.design(lag, inputs={"u": (0, 1)}, duration=20, alone=True, draws=0, budget=300)
    said = " ".join(v["sentence"] for v in moving.verdict)
    assert moving.record["levels"] == []
    assert "With 20 s of this input" in said
    assert "level" not in said
    for found, words in ((curve, "sample by sample, in any order"), (moving, "over time")):
        values = {"u": (found.recording["u"], "1")}
        page = write_next_experiment_page(found.typed, found.t, values, {}, tmp_path / "page.html", "next.csv")
        assert f"u {words}" in page.read_text("utf-8")


@pytest.mark.parametrize(
    ("text", "states", "once"),
    [
        ("y = K*u", None, True),
        ("y = K*delay(u, K)", None, False),
        ("y = K*u + t", None, False),
        ("x' = K*u - x\ny = x", {"x": {"initial": 0.0}}, False),
    ],
)
def test_which_models_follow_their_inputs_at_once(text, states, once):
    model = pf.equations(text, inputs=["u"], states=states or {}, outputs=["y"], parameters=["K"], check=False)
    assert at_once(model) is once


def test_the_information_is_that_of_the_exact_jacobian(lag):
    found = pf.design(lag, inputs={"u": (0, 1)}, duration=20, alone=True, draws=0, budget=300)
    one = found.goal
    assert isinstance(one, Precision)
    trial = one.trial
    u = found.recording["u"]
    record = pf.from_arrays({"t": found.t, "u": u, "y": np.zeros(len(u))}, time="t", units=ONE)
    before = pf.Experiment(record, before={"u": trial.begins["u"]})
    problem = pf.Problem(lag.problem.model, before, lag.problem.space.parameters, scales={"y": 1.0}, substeps=4)
    z = problem.space.cube(trial.plants[0])
    jacobian = residuals_and_jacobian(problem, z)[1] / problem.space.slopes(z) / found.record["noise"]["y"]
    own = one.information(trial.told(found.found.best.u))[0] * one.inflation / np.outer(one.scale, one.scale)
    assert own == pytest.approx(jacobian.T @ jacobian, rel=2e-3, abs=1e-3 * np.max(np.abs(own)))


@pytest.mark.parametrize(
    ("case", "simulate", "dt", "ends"),
    [
        ("lag", first_order, RATE, (0, 1)),
        pytest.param("mode", resonance, 0.05, (-1, 1), marks=pytest.mark.slow),
    ],
)
@pytest.mark.thorough
def test_fits_of_recordings_of_the_input_reach_the_errors_that_were_foretold(case, simulate, dt, ends, request):
    answer = request.getfixturevalue(case)
    found = pf.design(answer, inputs={"u": ends}, duration=20, alone=True, seed=2, budget=1500)
    rows, noise = found.record["parameters"], found.record["noise"]["y"]
    at, u = np.array([r["value"] for r in rows]), found.recording["u"]
    clean, rng = simulate(u, *at, dt), np.random.default_rng(5)

    def fitted():
        y = clean + noise * rng.standard_normal(len(u))
        return least_squares(lambda p: simulate(u, *np.exp(p), dt) - y, np.log(1.05 * at), diff_step=1e-6).x

    spread = np.std(np.exp([fitted() for _ in range(200)]), axis=0, ddof=1)  # known to 5 %
    assert spread == pytest.approx([r["alone"] for r in rows], rel=0.15)


TANK = "h' = (kin*u - kout*sqrt(h + 1e-9))/3\ny = h"


def tank_answer():
    t = 0.5 * np.arange(240)
    u = np.where(t < 10, 0.5, 0.8)
    h, y = (0.8 * 0.5 / 0.5) ** 2, []
    for v in u:  # small steps of Euler: their error is far below the noise
        y.append(h)
        for _ in range(50):
            h += 0.01 * (0.8 * v - 0.5 * np.sqrt(h)) / 3
    bounds = {"kin": ((0.1, 5.0), "1"), "kout": ((0.05, 3.0), "1")}
    states = {"h": {"unit": "1", "initial": "0.64"}}
    return answer_of(TANK.replace("/3", "/3.0"), states, bounds, t, u, np.array(y), 0.01)


@pytest.mark.slow
def test_errors_are_smaller_than_with_step_prbs_multisine_and_chirp_on_three_plants(lag, mode):
    for answer, ends, limits in (
        (lag, (0, 1), None),
        (mode, (-1, 1), None),
        (tank_answer(), (0.2, 1.5), {"y": (0.05, 1.6)}),
    ):
        found = pf.design(answer, inputs={"u": ends}, limits=limits)
        compared = {c["kind"]: c["times"] for c in found.record["compared"]}
        assert set(compared) == {"step", "PRBS", "multisine", "chirp"}
        assert min(compared.values()) > 1.01, compared
        assert found.record["kind"] == "designed"


@pytest.mark.thorough
def test_limits_of_level_slew_and_hold_are_kept(mode):
    found = pf.design(
        mode,
        inputs={"u": (-1, 1)},
        limits={"y": (-1.5, "1.2")},
        slew={"u": 4.0},
        hold="0.5 s",
        duration="15 s",
        draws=4,
        budget=1500,
    )
    free = pf.design(mode, inputs={"u": (-1, 1)}, duration="15 s", draws=4, budget=1500)
    u = found.recording["u"]
    assert len(u) == 300
    assert np.all(np.abs(u) <= 1 + 1e-12)
    assert np.max(np.abs(np.diff(u))) <= 4.0 * 0.05 + 1e-9
    goal, one = found.goal, free.goal
    assert isinstance(goal, Precision)
    assert isinstance(one, Precision)
    for plant in goal.trial.plants:
        y = resonance(u, *plant)
        assert y.min() > -1.5 - 0.01
        assert y.max() < 1.2 + 0.01
    assert np.max(np.abs(resonance(free.recording["u"], *one.trial.plants[0]))) > 1.5  # the limits did bind
    assert one.cost(one.trial.told(free.found.best.u)) < goal.cost(goal.trial.told(found.found.best.u))


def test_an_input_for_one_parameter_serves_that_one_best(lag):
    errors = {}
    for name in ("K", "L"):
        found = pf.design(lag, inputs={"u": (0, 1)}, duration=20, alone=True, draws=0, parameters=[name], budget=1500)
        errors[name] = {r["name"]: r["alone"] for r in found.record["parameters"]}
    assert errors["K"]["K"] < 0.9 * errors["L"]["K"]
    assert errors["L"]["L"] < 0.9 * errors["K"]["L"]


def test_what_no_input_can_tell_stays_open_in_words():
    t = 0.1 * np.arange(150)
    u = np.where(t < 1, 0.0, 1.0)
    bounds = {"a": ((0.1, 10.0), "1"), "b": ((0.1, 10.0), "1"), "tau": ((0.1, 10.0), "s")}
    answer = answer_of("x' = (a*b*u - x)/tau\ny = x", {"x": "1"}, bounds, t, u, first_order(u, 2.0, 0.8, 0.0), 0.02)
    found = pf.design(answer, inputs={"u": (0, 1)}, draws=0, budget=600)
    open_ = {r["name"]: r["open"] for r in found.record["parameters"]}
    assert open_ == {"a": True, "b": True, "tau": False}
    warned = [v["sentence"] for v in found.verdict if v["level"] == "warning"]
    assert any(s.startswith("a and b would stay open, each by itself,") for s in warned)
    assert any("because others can make up for them; hold or measure one of them" in s for s in warned)
    assert not any("too little effect" in s for s in warned)


def test_what_hardly_acts_is_not_said_to_be_made_up_for_by_others():
    """c acts a thousandth as much as noise does, and on nothing that another parameter touches."""
    t = 0.1 * np.arange(150)
    u = np.where(t < 1, 0.0, 1.0)
    bounds = {"K": ((0.1, 10.0), "1"), "c": ((0.1, 100.0), "1"), "tau": ((0.1, 10.0), "s")}
    text = "x' = (K*u - x)/tau\ny = x + 1e-6*c*sin(40*x)"
    answer = answer_of(text, {"x": "1"}, bounds, t, u, first_order(u, 2.0, 0.8, 0.0), 0.02)
    found = pf.design(answer, inputs={"u": (0, 1)}, draws=0, budget=300)
    told = [v["sentence"] for v in found.verdict]
    assert any(s.startswith("c would stay open under every input") and "it has too little effect" in s for s in told)
    assert not any("make up for" in s for s in told)


def _pulses(noise, seed):
    """A lag that answers to a pulse in every 16 s, sampled at 10 Hz, with `noise` (n,) of white errors."""
    t = RATE * np.arange(len(noise))
    u = np.where(np.arange(len(t)) % 160 < 8, 1.0, 0.0)
    bounds = {"K": ((0.2, 10.0), "1"), "tau": ((0.1, 10.0), "s")}
    y = first_order(u, 2.0, 0.6, 0.0) + noise * np.random.default_rng(seed).standard_normal(len(t))
    return answer_of("x' = (K*u - x)/tau\ny = x", {"x": "1"}, bounds, t, u, y, 0.0)


@pytest.mark.thorough
def test_white_errors_that_are_larger_where_parameters_are_told_are_not_called_correlated():
    noise = np.where(np.arange(1600) % 160 < 24, 0.2, 0.01)
    for seed in (4, 5):  # tests that take errors as of one size call those of 5 not white
        told = pf.design(_pulses(noise, seed), budget=100, draws=0).typed
        assert told.inflation > 2
        assert told.unlike == pytest.approx(told.inflation, rel=0.3)
        assert not told.correlated
        said = " ".join(v.sentence for v in told.verdict)
        assert "are correlated" not in said
        assert "white noise of one size: its errors are larger where the parameters are told" in said
    even = pf.design(_pulses(np.full(1600, 0.05), 4), budget=100, draws=0).typed
    assert "white noise" not in " ".join(v.sentence for v in even.verdict)


def test_errors_that_are_correlated_are_called_so():
    t = RATE * np.arange(600)
    u = np.where(np.arange(600) % 80 < 40, 1.0, 0.0)
    slow = lfilter([0.03], [1.0, -0.9], np.random.default_rng(2).standard_normal(600))
    bounds = {"K": ((0.2, 10.0), "1"), "tau": ((0.1, 10.0), "s")}
    answer = answer_of("x' = (K*u - x)/tau\ny = x", {"x": "1"}, bounds, t, u, first_order(u, 2.0, 0.6, 0.0) + slow, 0.0)
    made = pf.design(answer, budget=100, draws=0).typed
    assert made.correlated
    said = [v["sentence"] for v in precision_sentences(made)]
    assert any(s.startswith("The residuals of the study are correlated, which makes variances") for s in said)
    scattered = made.model_copy(update={"widened": ["K"]})
    said = [v["sentence"] for v in precision_sentences(scattered)]
    assert any("are correlated, and its recordings scatter in K, which makes" in s for s in said)
    said = [v["sentence"] for v in precision_sentences(scattered.model_copy(update={"correlated": False}))]
    assert any(s.startswith("The study's recordings scatter in K, which makes variances") for s in said)
    assert not any("are correlated" in s for s in said)


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_input(lag):
    one, same, other = (pf.design(lag, inputs={"u": (0, 1)}, budget=400, seed=s).recording["u"] for s in (4, 4, 5))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_another_input_for_the_same_answer_compiles_nothing(lag, monkeypatch):
    for seed in (4, 5):  # inputs of 33 to 64 and of more pieces, which share a program by powers of two
        pf.design(lag, inputs={"u": (0, 1)}, budget=200, seed=seed)
    monkeypatch.setattr(Kept, "_found_or_made", lambda *_: pytest.fail("a program was made anew"))
    pf.design(lag, inputs={"u": (0, 1)}, budget=200, seed=6)


def straight_or_bent(rows):
    """Columns of y = a + b u and of y = a + b u (1 + u): alike where u is small."""
    return np.stack([np.ones_like(rows), rows], axis=1), np.stack([np.ones_like(rows), rows * (1 + rows)], axis=1)


@pytest.mark.parametrize(("samples", "top"), [(16, 0.4), (20, 0.6), (30, 0.8)])
@pytest.mark.thorough
def test_two_models_are_told_apart_as_often_as_foretold(samples, top):
    rng, noise = np.random.default_rng(4), 0.1
    u = rng.uniform(0, 0.1, 80)
    y = 1 + 2 * u + noise * rng.standard_normal(80)
    fits = []
    for k, text in enumerate(("y = a + b*u", "y = a + b*u*(1 + u)")):
        model = pf.equations(
            text, inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name=f"model-{k}", check=False
        )
        record = pf.from_arrays({"u": u, "y": y}, period=1.0, units=ONE)
        fits.append(pf.fit(pf.Problem(model, record, {n: (-10.0, 10.0) for n in "ab"}), seed=1))
    found = pf.design(
        fits[0], against=fits[1], inputs={"u": (0, top)}, duration=samples, draws=0, noise={"y": noise}, budget=600
    )
    foretold = 0.5 * (1 + erf(0.5 * found.record["distance"] / np.sqrt(2)))
    assert (f"{100 * foretold:.3g} %" if foretold < 0.999 else "more than 99.9 %") in found.verdict[0]["sentence"]

    foreseen = []  # mean and covariance of the new recording, after the old one, under each model
    for old, new in zip(straight_or_bent(u), straight_or_bent(found.recording["u"]), strict=True):
        known = np.linalg.inv(old.T @ old)
        foreseen.append((new @ known @ old.T @ y, noise**2 * (np.eye(samples) + new @ known @ new.T)))
    right = 0
    for trial in range(4000):
        mean, covariance = foreseen[trial % 2]
        seen = rng.multivariate_normal(mean, covariance)
        right += trial % 2 == int(np.argmax([multivariate_normal.logpdf(seen, *f) for f in foreseen]))
    assert right / 4000 == pytest.approx(foretold, abs=0.03)


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"limits": {"y": (5.0, 6.0)}}, SearchError, "keeps the limits"),
        ({"limits": {"z": (0, 1)}}, SpecError, "limits names 'z'; there are x, y"),
        ({"inputs": {"w": (0, 1)}}, SpecError, "inputs names 'w'; there are u"),
        ({"inputs": {"u": (1, 0)}}, SpecError, "give the lower one first"),
        ({"duration": 0.3}, SpecError, "3 samples"),
        ({"duration": -1}, SpecError, "above 0"),
        ({"parameters": ["T"]}, SpecError, "There is no free parameter 'T'; there are K, tau, L"),
        ({"criterion": "E"}, SpecError, "There is no criterion 'E'"),
        ({"slew": {"u": 0}}, SpecError, "positive change per second"),
    ],
)
@pytest.mark.thorough
def test_refusals(lag, asked, error, words):
    with pytest.raises(error, match=words.replace("(", r"\(")):
        pf.design(lag, budget=200, **asked)


def test_regressions_have_no_input(static):
    from plantfit.models.library.pendubot import pendubot_regression

    regression = pendubot_regression("base")
    rng = np.random.default_rng(0)
    signals = {n: rng.standard_normal(40) for n in (*regression.signals, *regression.outputs)}
    record = pf.from_arrays(
        signals,
        period=1.0,
        units={n: u for n, u in {**regression.signals, **regression.outputs}.items() if u is not None},
    )
    answer = pf.fit(pf.Problem(regression, record, {p.name: (-5.0, 5.0) for p in regression.parameters}), seed=1)
    with pytest.raises(ModelError, match="no inputs over time"):
        pf.design(answer)


def test_a_design_for_plants_that_scatter_says_so_and_others_do_not(static):
    made = pf.design(static, inputs={"u": (-1, 1)}, duration=60, alone=True, seed=1, budget=100, draws=5).typed
    assert made.scatters == []
    assert not any("scatter" in s.sentence for s in made.verdict)
    said = [s["sentence"] for s in precision_sentences(made.model_copy(update={"scatters": ["a", "b"]}))]
    assert "Recordings scatter in a and b: the input serves 6 plants as another recording may find them." in said


@pytest.mark.thorough
def test_no_shape_changes_before_a_level_has_lasted():
    for hold in (1, 7, 40):
        found = dict(shapes(1320, 2, 1, hold))
        assert {kind_of(n) for n in found} == {"step", "PRBS", "multisine", "chirp"}
        for name, u in found.items():
            for column in u.T:
                ends = np.flatnonzero(np.diff(column)) + 1
                lasted = np.diff(np.r_[0, ends])
                assert np.min(lasted, initial=hold) >= hold, name


@pytest.mark.parametrize("period", [7200.0, 1e-3])
def test_a_rate_that_gives_too_few_or_too_many_samples_comes_with_one_that_does(period):
    t = np.arange(0.0, 90_000.0, 7200.0)
    model = pf.equations(
        "x' = (u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"],
        parameters={"tau": {"unit": "s", "bounds": (1.0, 9e4)}},
    )  # fmt: skip
    problem = pf.Problem(model, pf.Recording(t, {"u": pf.Signal(t), "y": pf.Signal(t)}))
    with pytest.raises(SpecError, match="is designed for 16 to 200,000") as refused:
        _times(problem, "25 h", 1.0 / period)
    rate = re.search(r"--rate (\S+)Hz", str(refused.value))
    assert rate is not None
    assert 16 <= len(_times(problem, "25 h", f"{rate[1]} Hz")[0]) <= 200_000


def beyond(inputs=(), outputs=()):
    made = (SimpleNamespace(**{"unit": "K", "slew": None, "open": "both", **r}) for r in [*inputs, *outputs])
    made = list(made)
    record: Any = SimpleNamespace(inputs=made[: len(inputs)], outputs=made[len(inputs) :])
    return [s["sentence"] for s in _beyond(record)]


def test_inputs_that_leave_the_recorded_range_are_told():
    near = {"name": "Tj", "low": 320.0, "high": 360.0, "seen": [323.0, 353.0]}
    still = {"name": "Tj", "low": 320.0, "high": 360.0, "seen": [330.0, 330.0]}
    assert beyond([near]) == beyond([still]) == []
    (text,) = beyond([{**near, "high": 400.0}])
    assert text.startswith("Tj may go from 320 to 400 K, and the recordings hold 323 to 353 K")
    assert "another unit" not in text
    for seen in (near, still):
        (text,) = beyond([{**seen, "low": 40.0, "high": 80.0}])
        assert text.endswith("Are these numbers meant in another unit than K?")


@pytest.mark.parametrize(("limit", "told"), [((None, 360.0), 1), ((30.0, np.inf), 0), ((30.0, 360.0), 0), (None, 1)])
def test_an_output_with_a_limit_to_one_side_is_looked_at_to_the_other(limit, told):
    side = _without_limit(limit)
    rows = [{"name": "T", "seen": [300.0, 350.0], "reached": [40.0, 313.0], "open": side}] if side else []
    assert len(beyond(outputs=rows)) == told
