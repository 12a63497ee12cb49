"""Several methods on one study: against the exact likelihood, closed forms, truth behind simulated records, and what
a user gets wrong."""

import numpy as np
import pytest
import wandering_plants as lag
from scipy.optimize import minimize

import plantfit as pf
from plantfit.errors import ModelError, RecordingError, SearchError, SpaceError, SpecError, UnitError
from plantfit.estimate import Estimate, Noise
from plantfit.estimate.methods.agreement import agreement
from plantfit.estimate.methods.likely import likely
from plantfit.estimate.methods.proposals import proposed, scales_at


@pytest.fixture(scope="module")
def found():
    return pf.estimate_parameters(lag.problem(lag.record(1)), initial={"x": "200 mK"}, truth=lag.TRUTH)


def test_the_likelihoods_answer_is_that_of_the_scalar_recursion(found):
    recording = found.problem.experiments["run"].recording

    def cost(log):
        return lag.minus_log_likelihood(recording, *np.exp(log), initial=0.2)

    start = np.log([1.0, 1.0, 0.1, 0.1])
    exact = minimize(
        cost, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000, "maxfev": 8000}
    )
    assert found.likelihood.estimate.names == ("K", "tau", "process x", "measurement y")
    far = (found.likelihood.estimate.values - np.exp(exact.x)) / found.likelihood.estimate.standard_error
    assert np.all(np.abs(far) < 1e-3)
    assert found.record["log_likelihood"] == pytest.approx(-exact.fun, abs=1e-6)


def test_every_method_stands_in_the_record_with_an_interval_and_they_agree(found):
    record = found.record
    assert record["methods"] == ["least squares", "maximum likelihood", "EKF", "UKF"]
    for p in record["parameters"]:
        assert list(p["estimates"]) == record["methods"]
        assert p["truth"] == lag.TRUTH[p["name"]]
        for e in p["estimates"].values():
            assert e["low"] < e["value"] < e["high"]
            assert e["low"] * 0.8 < p["truth"] < e["high"] * 1.25
    assert found.agree is True
    assert record["verdict"][0]["level"] == "good"
    assert all(f["nis"]["consistent"] for f in record["filters"])
    assert {r["how"] for r in record["noise"]} == {"found"}
    levels = {r["kind"]: r for r in record["noise"]}
    # one record in twenty is allowed to miss its interval, none to be far out
    assert levels["process"]["low"] * 0.8 < lag.PROCESS < levels["process"]["high"] * 1.25
    assert levels["measurement"]["low"] * 0.8 < lag.MEASUREMENT < levels["measurement"]["high"] * 1.25
    assert "K [K/V]" in found.table()
    assert found.to_frame().height == 8


def test_a_page_shows_how_the_constants_settle(found, tmp_path):
    text = found.report(tmp_path / "page.html").read_text("utf-8")
    for words in ("How the constants settle", "least squares, 95 %", "truth", "Do the methods differ?"):
        assert words in text


@pytest.mark.thorough
def test_process_noise_that_is_not_there_is_left_out_and_the_answer_is_the_closed_form():
    recording = lag.record(2, process=0.0)
    problem = lag.problem(recording, name="still")
    problem = pf.Problem(problem.model, recording, {"tau": 0.5}, substeps=1)
    known = pf.estimate_parameters(problem, methods=["maximum likelihood"])
    assert [r["how"] for r in known.record["noise"]] == ["left out", "found"]
    f = np.exp(-lag.PERIOD / 0.5)
    g = np.zeros(len(recording))
    for k in range(len(g) - 1):
        g[k + 1] = f * g[k] + (1 - f) * recording["u"][k]
    gain = g @ recording["y"] / (g @ g)
    sd = np.sqrt(np.mean((recording["y"] - gain * g) ** 2))
    # the first state may be off by a thousandth of its spread, which moves the gain by far less than its error
    error = sd / np.sqrt(g @ g)
    assert known.values["K"] == pytest.approx(gain, abs=0.01 * error)
    assert known.noise.measurement["y"] == pytest.approx(sd, rel=1e-3)
    assert any("process x: 0" in s for s in known.record["assumed"])


@pytest.mark.thorough
def test_process_noise_that_is_there_is_kept_in_every_record():
    kept = []
    for seed in range(2):
        problem = lag.problem(lag.record(20 + seed, 150))
        scales = scales_at(problem, lag.TRUTH | {"K": 3.0})
        likelihood, left = likely(problem, proposed(problem, scales, {}, {}, {}), {"K": 3.0, "tau": 1.0}, budget=60)
        kept.append(not left)
        assert likelihood.estimate.named["process x"] > 0.1
    assert all(kept)


def test_levels_that_are_too_small_are_told():
    """A filter that is told of a sensor ten times as good as it is has to be called too sure."""
    problem = lag.problem(lag.record(3))
    wrong = pf.estimate_parameters(
        problem, process={"x": 0.001}, measurement={"y": "5 mK"}, methods=["ekf"], begin="answer"
    )
    assert wrong.likelihood is None
    assert [r["how"] for r in wrong.record["noise"]] == ["given", "given"]
    told = [v for v in wrong.record["verdict"] if v["level"] == "warning"]
    assert any("too sure" in v["sentence"] for v in told)
    assert any("neighbouring innovations are correlated" in v["sentence"] for v in told)
    assert wrong.record["filters"][0]["memory"]["y"] > 0.3


def test_estimates_that_differ_are_told_and_those_that_do_not_are_not():
    def known(k):
        estimate = Estimate(("K", "tau"), np.array([k, 0.5]), np.diag([0.01, 0.0025]))
        return estimate, {"K": (k - 0.2, k + 0.2), "tau": (0.4, 0.6)}

    pairs = agreement({"least squares": known(2.0), "maximum likelihood": known(2.1), "EKF": known(3.0)})
    assert {(p.second, p.first): p.differs for p in pairs} == {
        ("least squares", "maximum likelihood"): False, ("least squares", "EKF"): True,
        ("maximum likelihood", "EKF"): True,
    }  # fmt: skip
    for p in pairs:  # two degrees of freedom: the tail is an exponential
        k = 3.0 if p.first == "EKF" else 2.1
        chi = (k - (2.1 if p.second == "maximum likelihood" else 2.0)) ** 2 / 0.02
        assert p.p == pytest.approx(np.exp(-chi / 2), rel=1e-6)
        assert p.p is not None
        assert p.p_adjusted is not None
        assert p.p_adjusted >= p.p
    assert "EKF differs from least squares by more than chance" in pairs[1].sentence
    held = known(9.0)[0], {"K": (None, None), "tau": (0.4, 0.6)}  # a value that the data leave open is not compared
    assert [p.degrees for p in agreement({"least squares": known(2.0), "EKF": held})] == [1]


def test_recordings_are_filtered_in_turn_and_the_unseen_part_is_not():
    from plantfit.estimate.methods.over_records import over_recordings

    recordings = {"a": lag.record(5, 200), "b": lag.record(6, 200)}
    noise = Noise({"x": lag.PROCESS}, {"y": lag.MEASUREMENT}, {"x": 1e-3})
    from plantfit.estimate import ekf

    both = lag.problem(recordings)
    runs = over_recordings(ekf, both, noise, ["K", "tau"], at={}, prior={}, drift={})
    first = ekf(both, noise, ["K", "tau"], recording="a").run()
    assert np.array_equal(runs.runs["a"].mean, first.mean)
    begin = runs.runs["b"]
    assert begin.mean[0, 1:] == pytest.approx(first.mean[-1, 1:], abs=1e-3)
    assert np.all(runs.estimate.standard_error < first.estimate.standard_error)
    spoiled = recordings["b"]["y"].copy()
    spoiled[150:] = 1e6
    cut = pf.Experiment(
        pf.from_arrays(period=lag.PERIOD, signals={"u": (recordings["b"]["u"], "V"), "y": (spoiled, "K")}),
        fit=(0.0, 7.5),
    )
    part = lag.problem({"b": cut})
    assert np.all(np.isfinite(ekf(part, noise, ["K", "tau"]).run(fitted=True).mean))
    assert len(ekf(part, noise, ["K"]).run(fitted=True).t) == 150
    assert np.max(np.abs(ekf(part, noise, ["K", "tau"]).run(fitted=True).mean)) < 10


FRICTION = "v' = (F - friction(v, Fc, Fs))/m\ny = v"


def friction_problem():
    model = pf.equations(
        FRICTION,
        inputs=["F"],
        states=["v"],
        outputs=["y"],
        parameters={n: {"bounds": (0.1, 10)} for n in ("Fc", "Fs", "m")},
    )
    t = np.arange(50) * 0.1
    return pf.Problem(model, pf.from_arrays(t, signals={"F": np.sin(t), "y": np.zeros(50)}))


def test_what_no_filter_works_on_is_refused_before_anything_is_fitted():
    with pytest.raises(
        ModelError, match=r"dry friction, backlash or late states.*tanh\(v/width\).*`plantfit run` fits"
    ):
        pf.estimate_parameters(friction_problem())
    static = pf.equations("y = a*u", inputs=["u"], outputs=["y"], parameters={"a": {"bounds": (0, 1)}})
    with pytest.raises(ModelError, match="has no states to filter"):
        pf.estimate_parameters(
            pf.Problem(static, pf.from_arrays(period=1.0, signals={"u": np.arange(9.0), "y": np.arange(9.0)}))
        )
    steady = pf.Experiment(lag.record(1, 30), steady=True)
    with pytest.raises(RecordingError, match="'run' is steady"):
        pf.estimate_parameters(lag.problem({"run": steady}))


@pytest.mark.thorough
def test_a_record_without_noise_asks_for_a_level():
    exact = lag.problem(lag.record(1, 100, process=0.0, measurement=0.0))
    with pytest.raises(SearchError, match="do not show how large the noise of 'y' is; give its standard deviation"):
        pf.estimate_parameters(exact, methods=["maximum likelihood"])


@pytest.mark.parametrize(
    ("wishes", "error", "sentence"),
    [
        ({"process": {"v": 1.0}}, SpecError, r"estimate.process\] names 'v', which is no state; there are x"),
        ({"measurement": {"x": 1.0}}, SpecError, r"names 'x', which is no output; there are y"),
        ({"drift": {"x": 1.0}}, SpecError, r"names 'x', which is no free parameter; there are K, tau"),
        ({"process": {"x": -1.0}}, SpaceError, r"The process level of 'x' is -1.0; give a number of at least 0"),
        ({"measurement": {"y": 0.0}}, SpaceError, r"level of 'y' is 0; give a standard deviation above 0"),
        ({"measurement": {"y": (2.0, 1.0)}}, SpaceError, r"level of 'y' is \(2.0, 1.0\)"),
        ({"measurement": {"y": "3 V"}}, UnitError, r"measurement\] y = '3 V'.*cannot be converted to 'kelvin'"),
        ({"prior": {"K": 0.0}}, SpecError, r"prior\] K = 0.0; give a standard deviation above 0"),
        ({"methods": ["ekff"]}, SpecError, "methods.* = 'ekff' cannot be used"),
        ({"noise": 1}, SpecError, r"does not know 'noise'; it takes methods, process"),
    ],
)
def test_wishes_that_cannot_be_are_told(wishes, error, sentence):
    with pytest.raises(error, match=sentence):
        pf.estimate_parameters(lag.problem(lag.record(1, 30)), **wishes)


def test_the_linear_filter_is_for_linear_models():
    tank = pf.equations(
        "x' = u - k*sqrt(x)\ny = x",
        inputs=["u"],
        states={"x": {"initial": 1.0}},
        outputs=["y"],
        parameters={"k": {"bounds": (0.1, 1)}},
    )
    recording = pf.from_arrays(period=0.1, signals={"u": np.ones(30), "y": np.ones(30)})
    with pytest.raises(ModelError, match="not linear in its states and inputs"):
        pf.estimate_parameters(pf.Problem(tank, recording), methods=["kalman"])


def test_levels_have_units_and_spreads_are_those_of_the_study():
    from plantfit.estimate.methods.levels import asked
    from plantfit.spec.tables import EstimateTable

    problem = pf.Problem(
        lag.problem(lag.record(1, 30)).model, lag.record(1, 30), {"K": pf.Parameter((1.0, 5.0), "K/V")}
    )
    table = EstimateTable.model_validate(
        {"process": {"x": ["1 mK/s^0.5", "2 K/s^0.5"]}, "measurement": {"y": "20 mK"},
         "prior": {"K": "500 mK/V", "tau": 0.2},
         "truth": {"tau": "500 ms"}}
    )  # fmt: skip
    told = asked(table, problem)
    assert told.process["x"] == pytest.approx((1e-3, 2.0))
    assert told.measurement["y"] == pytest.approx(0.02)
    assert told.truth["tau"] == pytest.approx(0.5)
    prior, drift = told.spreads(problem, ["K", "tau"], {"K": 2.0, "tau": 1.0})
    assert not drift
    assert prior["tau"] == pytest.approx(0.2)  # a share of it
    assert prior["K"] == pytest.approx(0.5 * 4.0 / (1.0 * 3.0))  # of the logit within 1 to 5


def test_what_moves_and_where_states_begin_is_seen():
    model = pf.equations(
        "x' = v\nv' = (F - k*x - d*v)/m\nz' = (x - z)/0.3\ny = x\ns = z",
        inputs=["F"], states={"x": {"initial": "x0"}, "v": {"initial": 0.0}, "z": {"initial": "s"}}, outputs=["y", "s"],
        parameters={n: {"bounds": (0.1, 10.0)} for n in ("k", "d", "m", "x0")},
    )  # fmt: skip
    rng, t = np.random.default_rng(1), 0.05 * np.arange(200)
    recording = pf.from_arrays(
        t, signals={"F": np.sin(3 * t), "y": 0.1 * rng.standard_normal(200), "s": rng.standard_normal(200)}
    )
    problem = pf.Problem(model, recording, substeps=2)
    scales = scales_at(problem, {"k": 2.0, "d": 1.0, "m": 1.0, "x0": 0.5})
    assert scales.kinematic == {"x": "v"}
    assert scales.begin == {"x": "parameter", "v": "model", "z": "measured"}
    assert scales.period == pytest.approx(0.05)
    assert scales.scatter["s"] == pytest.approx(1.0, rel=0.25)
    told = proposed(problem, scales, {}, {}, {})
    assert set(told.noise.process) == {"v", "z"}
    assert any("x' = v holds exactly" in s for s in told.assumed)
    assert told.noise.initial["x"] == pytest.approx(1e-3 * scales.spread["x"])
    assert told.noise.initial["z"] >= 10 * scales.residual["s"] * 0.999
    given = proposed(problem, scales, {"v": 0.1}, {"y": 0.1, "s": 1.0}, {"x": 0.0, "v": 0.0, "z": 1.0})
    assert given.assumed == ()
    assert given.noise == Noise({"v": 0.1}, {"y": 0.1, "s": 1.0}, {"x": 0.0, "v": 0.0, "z": 1.0})


@pytest.mark.thorough
def test_levels_at_a_bound_are_called_so():
    """The likelihood's range of K ends below the truth."""
    recording = lag.record(7, 200)
    problem = pf.Problem(lag.problem(recording).model, recording, {"K": (0.2, 1.5)}, substeps=1)
    found = pf.estimate_parameters(problem, methods=["maximum likelihood"], measurement={"y": 0.05}, process={"x": 0.3})
    row = next(p for p in found.record["parameters"] if p["name"] == "K")["estimates"]["maximum likelihood"]
    assert row["value"] == pytest.approx(1.5)
    assert row["at_bound"] is True
    assert row["low"] is None
    assert "1.5 (at a bound)" in found.table()


@pytest.mark.slow
def test_intervals_of_every_method_cover_the_truth():
    """The command's own intervals over seeds of a plant simulated exactly; figures are in docs/kalman.md."""
    runs, inside = 100, {}
    for seed in range(runs):
        one = pf.estimate_parameters(lag.problem(lag.record(5000 + seed)))
        for p in one.record["parameters"]:
            for m, e in p["estimates"].items():
                inside[m, p["name"]] = inside.get((m, p["name"]), 0) + (e["low"] <= lag.TRUTH[p["name"]] <= e["high"])
    print({k: v / runs for k, v in inside.items()})
    # least squares takes 15 independent stretches of process noise for sensor noise with memory, and knows too little
    # of that
    least = {"least squares": 0.72, "maximum likelihood": 0.86, "EKF": 0.86, "UKF": 0.86}
    assert all(v / runs >= least[m] for (m, _), v in inside.items()), inside


def test_the_scatter_of_an_output_with_times_of_its_own_is_that_of_its_samples():
    from plantfit.estimate.methods.proposals import _scatter

    rng = np.random.default_rng(2)
    noise = 0.3 * rng.standard_normal(4000)
    between = np.full(8000, np.nan)
    between[1::2] = noise + np.linspace(0, 5, 4000)  # slow errors do not count
    assert _scatter([between]) == pytest.approx(0.3, rel=0.06)
    gaps = noise.copy()
    gaps[::10] = np.nan
    assert _scatter([gaps]) == pytest.approx(0.3, rel=0.08)
