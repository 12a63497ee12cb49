"""States that begin at first measured values: the fit estimates the noise of these samples, as a free start would
be."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

import plantfit as pf
from plantfit import spec
from plantfit.space import Parameter
from plantfit.trust.finish.descent import descent
from plantfit.trust.finish.start_corrections import with_start_corrections
from plantfit.trust.intervals.first_values import first_value_effects, start_parameters
from plantfit.trust.intervals.linearised import linearise, residual_blocks

PERIOD, N, NOISE = 0.1, 400, 0.02
TEXT = "x' = (K*u - x)/tau\ny = x"


def record(seed, tau=6.0, off=None, lag=0.0, x0=1.5, samples=N, noise=NOISE, name="bench"):
    """A lag with K 2 in random steps, measured from x = x0 on; `off`: of the first value, in standard deviations;
    `lag`: a second one."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.0, 1.0, samples // 25 + 1).repeat(25)[:samples]
    pole = np.exp(-PERIOD / tau)
    x = lfilter([0.0, 2.0 * (1 - pole)], [1.0, -pole], u) + x0 * pole ** np.arange(samples)
    if lag:
        second = np.exp(-PERIOD / lag)
        x = lfilter([1 - second], [1.0, -second], x, zi=[second * x0])[0]
    errors = noise * rng.standard_normal(samples)
    if off is not None:
        errors[0] = off * noise
    return pf.Recording(PERIOD * np.arange(samples), {"u": pf.Signal(u, "V"), "y": pf.Signal(x + errors, "K")}, name)


def problem_of(records, initial="y", **options):
    model = pf.equations(
        TEXT, inputs={"u": "V"}, states={"x": {"unit": "K", "initial": initial}}, outputs={"y": "K"},
        parameters={"K": "K/V", "tau": "s"},
    )  # fmt: skip
    return pf.Problem(model, records, {"K": (0.1, 20.0), "tau": (0.1, 50.0)}, **options)


def other(records, skip=0.0):
    """K, tau, starts and standard errors of the first two: scipy with starts of their own, first values that are
    skipped as samples."""

    def residuals(p):
        found = []
        for x0, r in zip(p[2:], records, strict=True):
            pole = np.exp(-PERIOD / p[1])
            e = lfilter([0.0, p[0] * (1 - pole)], [1.0, -pole], r["u"]) + x0 * pole ** np.arange(len(r)) - r["y"]
            found.append(e[(r.t >= skip) | (r.t == 0.0)])
        return np.concatenate(found)

    end = least_squares(residuals, np.r_[1.0, 3.0, np.ones(len(records))], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    free = len(end.fun) - len(end.x)
    return end.x, np.sqrt(np.diag(np.linalg.inv(end.jac.T @ end.jac) * 2 * end.cost / free))[:2]


@pytest.mark.parametrize("seed", range(4))
def test_estimates_and_errors_are_those_of_a_free_start(seed):
    r = record(seed, off=2.5 * (-1) ** seed)
    answer = pf.fit(problem_of(r, standard_errors="classical"), budget=600)
    (k, tau, x0), errors = other([r])
    assert np.abs(np.array([answer.values["K"] - k, answer.values["tau"] - tau])).max() < 1e-3 * errors.min()
    assert answer.problem.start_corrections["bench"]["y"] == pytest.approx(x0 - r["y"][0], rel=1e-4)
    rows = {p["name"]: p["standard_error"] for p in answer.findings["parameters"]}
    np.testing.assert_allclose([rows["K"], rows["tau"]], errors, rtol=0.01)
    (test,) = answer.findings["residual_tests"]
    assert test["white"]
    assert test["first"] == answer.problem.start_corrections["bench"]["y"]
    assert "first measured" not in str(answer.verdict)


def test_a_first_value_that_is_skipped_counts_as_a_sample():
    r = record(5, off=2.0)
    answer = pf.fit(problem_of(r, skip=1.0), budget=600)
    (k, tau, x0), errors = other([r], skip=1.0)
    assert abs(answer.values["K"] - k) < 0.05 * errors[0]
    assert abs(answer.values["tau"] - tau) < 0.05 * errors[1]
    assert answer.problem.start_corrections["bench"]["y"] == pytest.approx(x0 - r["y"][0], rel=0.05)


def test_every_recording_has_a_start_of_its_own():
    records = [
        record(7, off=2.0),
        record(8, off=-2.0, x0=0.3, samples=250, name="short"),
        record(9, off=1.0, x0=4.0, name="hot"),
    ]
    answer = pf.fit(problem_of({r.name: r for r in records}, standard_errors="classical"), budget=600)
    (k, tau, *starts), errors = other(records)
    assert abs(answer.values["K"] - k) < 1e-3 * errors[0]
    assert abs(answer.values["tau"] - tau) < 1e-3 * errors[1]
    found = [answer.problem.start_corrections[r.name]["y"] for r in records]
    np.testing.assert_allclose(found, [x0 - r["y"][0] for x0, r in zip(starts, records, strict=True)], rtol=1e-3)


def test_a_first_value_that_no_noise_explains_stays_and_the_others_do_not():
    records = [
        record(7, off=12.0, samples=60),
        record(8, off=-2.0, x0=0.3, name="short"),
        record(9, off=1.0, x0=4.0, name="hot"),
    ]
    problem = problem_of({r.name: r for r in records})
    made, end = with_start_corrections(problem, descent(problem, np.full(2, 0.3)))
    assert set(made.start_corrections) == {"short", "hot"}
    assert end.cost < float(problem.costs(end.z[None])[0])
    assert first_value_effects(made, end.z, residual_blocks(made)).noise.shape[1] == 1
    assert first_value_effects(made, end.z, residual_blocks(made)).estimated.shape[1] == 2


@pytest.mark.parametrize(
    ("initial", "found"), [("y", set()), ("y + start", {"start"}), ("K*start", {"K", "start"}), ("1.5", set())]
)
def test_parameters_that_a_start_counts_by(initial, found):
    model = pf.equations(
        TEXT, inputs={"u": "V"}, states={"x": {"unit": "K", "initial": initial}}, outputs={"y": "K"}, check=False,
        parameters={"K": {"bounds": (0.1, 20.0)}, "tau": {"bounds": (0.1, 50.0)},
                    **({"start": {"bounds": (-1.0, 1.0)}} if found else {})},
    )  # fmt: skip
    problem = pf.Problem(
        model, {"a": record(1), "b": record(2)}, {"start": Parameter((-1.0, 1.0), per_recording=True)} if found else {}
    )
    assert start_parameters(problem, np.asarray(problem.space.physical(np.full(problem.space.dimension, 0.4)))) == found


@pytest.mark.thorough
def test_a_nonlinear_plant_of_two_outputs():
    """A pendulum whose angle and current are measured, against a fit in which the angle's start is a parameter of
    the model."""
    t, rng = np.arange(0.0, 6.0, 0.02), np.random.default_rng(3)
    text = "angle' = w\nw' = -g*sin(angle) - d*w\ny = angle\nz = g*cos(angle)"
    declared = {"g": {"bounds": (5.0, 60.0)}, "d": {"bounds": (0.01, 3.0)}}
    clean = pf.equations(
        text, states={"angle": {"initial": "1.2"}, "w": {}}, outputs=["y", "z"], parameters=declared, check=False
    )
    made = pf.Problem(
        clean, pf.Recording(t, {"y": pf.Signal(np.zeros(len(t))), "z": pf.Signal(np.zeros(len(t)))}), substeps=4
    )
    out = made.predict(made.space.vector({"g": 20.0, "d": 0.4}))
    signals = {
        k: pf.Signal(v + s * rng.standard_normal(len(t))) for (k, v), s in zip(out.items(), (0.03, 0.5), strict=True)
    }
    found = []
    for initial, more in (("y", {}), ("a0", {"a0": {"bounds": (0.5, 2.0)}})):
        model = pf.equations(
            text,
            states={"angle": {"initial": initial}, "w": {}},
            outputs=["y", "z"],
            parameters={**declared, **more},
            check=False,
        )
        answer = pf.fit(pf.Problem(model, pf.Recording(t, signals), substeps=4), budget=800)
        found.append({p["name"]: (p["value"], p["standard_error"]) for p in answer.findings["parameters"]})
        assert bool(answer.problem.start_corrections) == (initial == "y")
    for name in ("g", "d"):
        (value, error), (free, free_error) = found[0][name], found[1][name]
        assert abs(value - free) < 0.02 * free_error
        assert error == pytest.approx(free_error, rel=0.05)


@pytest.mark.parametrize(
    "changes",
    [{"off": 12.0}, {"noise": 0.0}, {"lag": 3.0, "x0": 3.0, "tau": 2.0}],
    ids=["no noise explains it", "no noise", "a lag lacks"],
)
def test_starts_stay_where_nothing_but_noise_is_to_be_taken_off(changes):
    problem = problem_of(record(1, **changes))
    end = descent(problem, np.full(2, 0.3))
    same, there = with_start_corrections(problem, end)
    assert same is problem
    assert there is end


@pytest.mark.parametrize("initial", [1.4, "y + start", "0"])
def test_starts_that_are_not_measured_or_have_a_parameter_stay(initial):
    more = {"start": {"unit": "K", "bounds": (-1.0, 1.0)}} if initial == "y + start" else {}
    model = pf.equations(
        TEXT, inputs={"u": "V"}, states={"x": {"unit": "K", "initial": initial}}, outputs={"y": "K"},
        parameters={"K": {"unit": "K/V", "bounds": (0.1, 20.0)}, "tau": {"unit": "s", "bounds": (0.1, 50.0)}, **more},
    )  # fmt: skip
    problem = pf.Problem(model, record(2))
    end = descent(problem, np.full(problem.space.dimension, 0.4))
    assert with_start_corrections(problem, end)[0] is problem


@pytest.mark.slow
def test_residuals_that_are_not_white_are_told_all_the_same():
    """A second lag, a first value that no noise explains, a start that nobody measured."""
    for seed in range(3):
        plants = [record(seed, lag=0.5, tau=2.0), record(seed, off=12.0), record(seed)]
        for r, initial in zip(plants, ("y", "y", "1.2"), strict=True):
            (test,) = pf.fit(problem_of(r, initial), budget=600).findings["residual_tests"]
            assert not test["white"]


def test_a_new_recording_begins_where_it_is_measured_and_the_fitted_one_where_the_fit_says():
    r = record(3, off=2.0)
    answer = pf.fit(problem_of(r), budget=600)
    correction = answer.problem.start_corrections["bench"]["y"]
    assert answer.predict(r)["y"][0] == pytest.approx(r["y"][0] + correction, abs=1e-12)
    new = dataclasses.replace(r, signals={**r.signals, "y": pf.Signal(r["y"] + 1e-9, "K")}, name="new")
    assert answer.predict(new)["y"][0] == pytest.approx(new["y"][0], abs=1e-12)


@pytest.mark.thorough
def test_a_stored_study_opens_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    r = record(4, off=-2.0)
    np.savetxt("bench.csv", np.c_[r.t, r["u"], r["y"]], delimiter=",", header="t [s],u [V],y [K]", comments="")
    text = 'name = "lag"\n[recording.bench]\nfile = "bench.csv"\n[model]\nkind = "first_order"\n'
    text += "[parameters.K]\nbounds = [0.1, 20]\n[parameters.tau]\nbounds = [0.1, 50]\n"
    (tmp_path / "lag.toml").write_text(text, "utf-8")
    code = (
        "import sys; sys.argv = ['plantfit', 'run', 'lag.toml', "
        "'--no-diagnose']; from plantfit.cli.start import run; run()"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
    # the second one reads what the first one's finishing left in the store
    first, again = (pf.open_study("lag"), pf.open_study("lag"))
    fresh = pf.fit(spec.load("lag.toml").problem, budget=600)
    assert first.problem.start_corrections["bench"]["y"] != 0.0
    assert first.problem.start_corrections == again.problem.start_corrections
    assert first.values == again.values
    assert np.array_equal(first.predict("bench")["y"], again.predict("bench")["y"])
    assert fresh.values["tau"] == pytest.approx(first.values["tau"], rel=1e-6)


@pytest.mark.thorough
def test_intervals_hold_the_truth_and_are_no_wider_than_needed():
    """The spread of estimates over records that differ in noise is that which is stated, and much smaller than
    without."""
    taus, errors, before = [], [], []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        t = PERIOD * np.arange(300)
        y = 3.0 - 2.0 * np.exp(-t / 2.0) + NOISE * rng.standard_normal(300)
        model = pf.models.make("first_order", dead_time=False)
        r = pf.Recording(t, {"u": pf.Signal(np.ones(300)), "y": pf.Signal(y)})
        problem = pf.Problem(model, r, {"K": (-50.0, 50.0), "tau": (0.05, 200.0), "c": (-50.0, 50.0)}, substeps=2)
        end = descent(problem, problem.space.cube(problem.space.vector({"K": 1.5, "tau": 2.6, "c": 1.2})))
        before.append(problem.space.physical(end.z)[1])
        made, end = with_start_corrections(problem, end)
        taus.append(float(made.space.physical(end.z)[1]))
        linear = linearise(made, end.z).linear
        assert linear is not None
        errors.append(float(linear.standard_error[1]))
    assert np.std(taus) == pytest.approx(np.median(errors), rel=0.25)
    assert np.std(before) > 1.6 * np.std(taus)
    assert np.mean(np.abs(np.array(taus) - 2.0) <= 1.97 * np.array(errors)) >= 0.88


@pytest.mark.slow
def test_starts_are_free_in_intervals_of_all_kinds():
    """A profile, the bootstrap and a posterior are those of the model whose start is a parameter: with the start held
    at its estimate they were two thirds as wide."""
    r = record(3, samples=60)
    free = pf.equations(
        TEXT, inputs={"u": "V"}, states={"x": {"unit": "K", "initial": "x0"}}, outputs={"y": "K"},
        parameters={"K": "K/V", "tau": "s", "x0": "K"},
    )  # fmt: skip
    bounds = {"K": (0.1, 20.0), "tau": (0.1, 50.0), "x0": (-5.0, 5.0)}
    asked = {"parameters": ("tau",), "replicates": 300, "draws": 800}
    own = pf.compare_intervals(pf.fit(problem_of(r), seed=1), kinds=("profile", "bootstrap", "posterior"), **asked)
    beside = pf.compare_intervals(pf.fit(pf.Problem(free, r, bounds), seed=1), kinds=("profile", "bootstrap"), **asked)
    found, wanted = (
        {k["kind"]: np.array([k["low"], k["high"]]) for k in c.record["parameters"][0]["kinds"]} for c in (own, beside)
    )
    width = float(np.ptp(wanted["profile"]))
    # ends of 300 refits and of draws are rough
    for kind, other_kind, loose in (
        ("profile", "profile", 0.03),
        ("bootstrap", "bootstrap", 0.12),
        ("posterior", "profile", 0.12),
    ):
        np.testing.assert_allclose(found[kind], wanted[other_kind], atol=loose * width, err_msg=kind)


@pytest.mark.thorough
def test_recordings_alone_have_starts_of_their_own():
    """Else each keeps the start that it has in the fit of all, and recordings agree more than their errors allow."""
    records = {f"r{k}": record(10 + k, samples=100, name=f"r{k}") for k in range(3)}
    answer = pf.fit(problem_of(records), seed=1)
    wanted = {n: other([r]) for n, r in records.items()}
    for rows in (answer.findings["heterogeneity"]["parameters"], pf.compare_records(answer).record["parameters"]):
        for k, row in enumerate(rows):
            for alone in row["alone"]:
                values, errors = wanted[alone["recording"]]
                assert alone["value"] == pytest.approx(values[k], abs=0.02 * errors[k]), (row["name"], alone)
