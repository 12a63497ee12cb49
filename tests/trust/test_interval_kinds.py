"""Intervals by covariance, profile, bootstrap and posterior against closed forms, quadrature and coverage, for white
and coloured noise."""

import h5netcdf
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student

import plantfit as pf
from plantfit.errors import SpecError
from plantfit.findings.results.intervals_compared import ComparisonOfIntervals
from plantfit.folders import code_folder
from plantfit.native import kept_programs
from plantfit.trust.intervals.kinds.bootstrap import bootstrap, percentiles
from plantfit.trust.intervals.kinds.noise import log_likelihood, noise_of
from plantfit.trust.intervals.kinds.posterior import posterior
from plantfit.trust.intervals.kinds.told import interval_sentences

pytestmark = pytest.mark.thorough

ONE = {"u": "1", "y": "1"}


def line(u, y, bounds=(-10.0, 10.0), **options):
    """The answer of y = a + b*u to samples (n,) a second apart."""
    model = pf.equations(
        "y = a + b*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name="line", check=False
    )
    record = pf.from_arrays({"u": u, "y": y}, period=1.0, units=ONE)
    return pf.fit(pf.Problem(model, record, {"a": bounds, "b": bounds}, **options), seed=1)


def slow_noise(rng, n, rho, sd):
    return lfilter([1.0], [1.0, -rho], sd * np.sqrt(1 - rho * rho) * rng.standard_normal(n + 200))[200:]


@pytest.fixture(scope="module")
def white():
    rng = np.random.default_rng(3)
    u = rng.uniform(-1, 1, 40)
    return u, (y := 1 + 2 * u + 0.3 * rng.standard_normal(40)), line(u, y)


@pytest.fixture(scope="module")
def found(white):
    return pf.compare_intervals(
        white[2], kinds=("covariance", "profile", "bootstrap", "posterior"), replicates=2000, draws=2000
    )


def test_all_kinds_meet_the_closed_form_of_a_straight_line(white, found):
    u, y, _ = white
    X = np.stack([np.ones(40), u], axis=1)
    best, squares = np.linalg.lstsq(X, y, rcond=None)[:2]
    errors = np.sqrt(squares[0] / 38 * np.diag(np.linalg.inv(X.T @ X)))
    for k, p in enumerate(found.record["parameters"]):
        # variance integrated out under 1/sigma: Student's t with n - d degrees of freedom (Box and Tiao 1973, section
        # 2.7)
        exact = student.interval(0.95, 38, best[k], errors[k])
        own = {i["kind"]: (i["low"], i["high"]) for i in p["kinds"]}
        # 2.5 % quantiles of some 5000 draws: 0.04 errors
        assert own["posterior"] == pytest.approx(exact, abs=0.08 * errors[k])
        assert own["profile"] == pytest.approx(exact, abs=0.05 * errors[k])
        assert own["bootstrap"] == pytest.approx(exact, abs=0.35 * errors[k])
        assert own["covariance"] == pytest.approx(exact, abs=0.05 * errors[k])
    assert found.record["posterior"]["orders"] == {"y": 0}
    assert [v["level"] for v in found.record["verdict"]] == ["good", "good"], found.verdict


def test_covariance_and_profile_of_few_samples_are_those_of_student_at_any_level():
    rng = np.random.default_rng(3)
    u = rng.uniform(0, 5, 8)
    y = 1 + 2 * u + 0.5 * rng.normal(size=8)
    X = np.stack([np.ones(8), u], axis=1)
    best, squares = np.linalg.lstsq(X, y, rcond=None)[:2]
    errors = np.sqrt(squares[0] / 6 * np.diag(np.linalg.inv(X.T @ X)))
    found = pf.compare_intervals(line(u, y), kinds=("covariance", "profile"), level=0.9)
    for p, value, error in zip(found.record["parameters"], best, errors, strict=True):
        for own in p["kinds"]:
            assert (own["low"], own["high"]) == pytest.approx(student.interval(0.9, 6, value, error), abs=0.01 * error)


@pytest.mark.parametrize("seed", range(4))
def test_a_profile_allows_for_what_the_covariance_allows_for(seed):
    """Of a straight line, whose cost is a parabola, both are the same, whatever its few errors look like."""
    rng = np.random.default_rng(seed)
    records = {}
    for name, level in (("a", 0.3), ("b", 1.0), ("c", 4.0)):
        u = level * np.exp(-np.arange(10) / 4.0)
        e = slow_noise(rng, 10, 0.5, 0.1)
        records[name] = pf.from_arrays({"u": u, "y": 1 + 2 * u * (1 + e) + 0.05 * e}, period=1.0, units=ONE)
    model = pf.equations(
        "y = a + b*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name="line", check=False
    )
    answer = pf.fit(
        pf.Problem(model, records, {"a": (-10.0, 10.0), "b": (-10.0, 10.0)}, standard_errors="robust"), seed=1
    )
    found = pf.compare_intervals(answer, kinds=("covariance", "profile"))
    for p in found.typed.parameters:
        _, one, other = p.kinds
        assert other.ends == pytest.approx(one.ends, abs=0.03 * one.width), p.name


def test_the_posterior_under_coloured_noise_is_that_of_quadrature(monkeypatch):
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1, 1, 12), 10)
    y = 1 + 2 * u + slow_noise(rng, 120, 0.8, 0.3)
    answer = line(u, y)
    problem, z = answer.problem, answer.best.x
    noise = noise_of(problem, np.asarray(problem.unsmoothed.residuals(z)))
    assert noise[0].order == 1
    found = posterior(problem, z, noise, {}, draws=2000, seed=2)

    def log_density(
        a, b
    ):  # numpy alone: regression of the residual on the one before, variance and coefficient integrated out
        e = y - a - b * u
        now, before = e[1:], e[:-1]
        gram = before @ before
        return -0.5 * 118 * np.log(now @ now - (before @ now) ** 2 / gram) - 0.5 * np.log(gram)

    a, b = np.linspace(-1, 3, 161), np.linspace(0.5, 3.5, 161)
    density = np.array([[log_density(p, q) for q in b] for p in a])
    density = np.exp(density - density.max())
    for k, (grid, marginal) in enumerate(((a, density.sum(axis=1)), (b, density.sum(axis=0)))):
        mean = (grid * marginal).sum() / marginal.sum()
        deviation = np.sqrt(((grid - mean) ** 2 * marginal).sum() / marginal.sum())
        sample = found.values[:, :, k].ravel()
        assert sample.mean() == pytest.approx(mean, abs=0.08 * deviation)
        assert sample.std() == pytest.approx(deviation, rel=0.08)
    assert np.all(found.r_hat < 1.02)
    assert np.all(found.effective > 400)
    if code_folder("programs") is not None:
        monkeypatch.setattr(kept_programs, "_made", lambda *_: pytest.fail("compiled anew"))
        np.testing.assert_array_equal(posterior(problem, z, noise, {}, draws=2000, seed=2).values, found.values)


def test_a_prior_and_the_data_meet_as_two_normal_distributions_do(white):
    _, _, answer = white
    rows = {r["name"]: r for r in answer.findings["parameters"]}
    error = rows["b"]["standard_error"]
    known = pf.compare_intervals(
        answer, kinds=("posterior",), priors={"b": (rows["b"]["value"] + error, error)}, draws=2000
    )
    own = {p["name"]: p["kinds"][-1] for p in known.record["parameters"]}["b"]
    assert own["median"] == pytest.approx(rows["b"]["value"] + 0.5 * error, abs=0.15 * error)
    assert own["high"] - own["low"] == pytest.approx(2 * 1.96 * error / np.sqrt(2), rel=0.12)
    assert not any("one of them is wrong" in v["sentence"] for v in known.record["verdict"])
    posterior = known.record["posterior"] | {"priors": {"b": [rows["b"]["value"] + 9 * error, error]}}
    sentences = [v["sentence"] for v in interval_sentences(known.typed.having(posterior=posterior))]
    assert any("lie 6.4 standard deviations apart: one of them is wrong" in s for s in sentences)


@pytest.mark.slow
def test_of_200_records_each_kind_holds_the_truth_in_95_percent():
    held = {"profile": 0, "bootstrap": 0}
    for seed in range(200):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(-1, 1, 30), 4)
        y = 1 + 2 * u + 0.3 * rng.standard_normal(120)
        found = pf.compare_intervals(
            line(u, y), kinds=("profile", "bootstrap"), replicates=200, parameters=["b"], seed=seed
        )
        for k in found.record["parameters"][0]["kinds"][1:]:
            held[k["kind"]] += k["low"] <= 2 <= k["high"]
    assert 180 <= held["profile"] <= 199, held  # binomial(200, 0.95): 184 to 196 in 95 % of seeds
    assert 178 <= held["bootstrap"] <= 199, held


@pytest.mark.slow
def test_under_coloured_noise_each_kind_holds_the_truth_in_95_percent():
    held = {"covariance": 0, "profile": 0, "bootstrap": 0, "posterior": 0}
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        u = np.repeat(rng.uniform(-1, 1, 40), 10)
        y = 1 + 2 * u + slow_noise(rng, 400, 0.8, 0.3)
        # a model without states has classical ones by itself, and says so
        answer = line(u, y, standard_errors="robust")
        found = pf.compare_intervals(answer, kinds=tuple(held), replicates=300, draws=300, parameters=["b"], seed=seed)
        for k in found.record["parameters"][0]["kinds"][1:]:
            held[k["kind"]] += k["low"] <= 2 <= k["high"]
    assert min(held.values()) >= 52, held  # of 60; binomial(60, 0.95): 53 to 60 in 95 % of seeds


def test_the_order_of_the_noise_is_found_and_a_slow_misfit_is_no_noise():
    rng = np.random.default_rng(5)
    u = rng.uniform(-1, 1, 600)
    orders = []
    for rho in (0.0, 0.6, 0.9):
        answer = line(u, 1 + 2 * u + slow_noise(rng, 600, rho, 0.3))
        r = np.asarray(answer.problem.unsmoothed.residuals(answer.best.x))
        orders.append(noise_of(answer.problem, r)[0].order)
    assert orders[0] == 0
    assert all(o >= 1 for o in orders[1:])
    wavy = line(u, 1 + 2 * u + 0.5 * np.sign(np.sin(np.arange(600) / 9)) + 0.02 * rng.standard_normal(600))
    found = pf.compare_intervals(wavy, kinds=("posterior",), draws=100)
    assert found.draws is None
    assert "No posterior is drawn" in found.record["refused"]["posterior"]


def test_gaps_and_uneven_clocks_break_the_autoregression():
    rng = np.random.default_rng(7)
    t = np.arange(200.0)
    t[100:] += 50.5
    u = rng.uniform(-1, 1, 200)
    y = 1 + 2 * u + slow_noise(rng, 200, 0.7, 0.3)
    model = pf.equations(
        "y = a + b*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name="line", check=False
    )
    record = pf.from_arrays({"t": t, "u": u, "y": y}, time="t", units=ONE)
    answer = pf.fit(pf.Problem(model, record, {"a": (-10.0, 10.0), "b": (-10.0, 10.0)}), seed=1)
    found = noise_of(answer.problem, np.asarray(answer.problem.unsmoothed.residuals(answer.best.x)))
    assert found[0].order == 0
    assert found[0].against == "are correlated, and the clock is uneven"


def test_the_likelihood_is_flat_in_the_scale_of_the_noise(white):
    _, _, answer = white
    r = np.asarray(answer.problem.unsmoothed.residuals(answer.best.x))
    noise = noise_of(answer.problem, r)
    assert float(log_likelihood(noise, 3 * r)) == pytest.approx(float(log_likelihood(noise, r)) - 40 * np.log(3))


def test_draws_are_saved_with_their_dimensions_and_units(found, tmp_path):
    with h5netcdf.File(found.save_draws(tmp_path / "a.nc"), "r") as file:
        b = file["posterior"]["b"]
        assert b.dimensions == ("chain", "draw")
        assert np.array_equal(b[:], found.draws.values[:, :, 1])
        assert b.attrs["units"] == "1"
        assert np.array_equal(file["sample_stats"]["lp"][:], found.draws.log_density)


def test_the_same_seed_draws_the_same_and_few_draws_are_told(white):
    one, same = (pf.compare_intervals(white[2], kinds=("posterior",), draws=100, chains=2, seed=4) for _ in range(2))
    assert one.draws is not None
    assert same.draws is not None
    assert np.array_equal(one.draws.values, same.draws.values)
    assert any("give more --draws" in v["sentence"] for v in one.record["verdict"])


def test_a_verdict_that_holds_another_answer_is_told_as_that():
    """An oral dose whose rates may be exchanged with another volume (flip-flop): nothing leaves the bounds of the
    search."""
    x = np.linspace(0.0, 12.0, 40)
    exact = 1.5 / 1.3 * (np.exp(-0.2 * x) - np.exp(-1.5 * x))
    y = exact + 0.005 * np.random.default_rng(2).normal(size=40)
    model = pf.equations(
        "y = ka/(V*(ka - ke))*(exp(-ke*x) - exp(-ka*x))", inputs={"x": "1"}, outputs={"y": "1"},
        parameters=["V", "ka", "ke"], check=False,
    )  # fmt: skip
    bounds = {"V": (0.02, 5.0), "ka": (0.01, 5.0), "ke": (0.01, 5.0)}
    answer = pf.fit(pf.Problem(model, pf.from_arrays({"x": x, "y": y}, period=1.0, units={"x": "1", "y": "1"}), bounds))
    found = pf.compare_intervals(answer, kinds=("profile",))
    assert "different answers fit equally well" in " ".join(v["sentence"] for v in answer.findings["verdict"])
    (volume, *_) = found.typed.parameters
    verdict, one = volume.kinds
    assert verdict.low is not None
    assert verdict.high is not None
    assert verdict.low < 0.2 / 1.5 < 1.0 < verdict.high
    assert one.width < 0.2
    said = [s["sentence"] for s in found.record["verdict"] if s["sentence"].startswith("V:")]
    assert "the verdict holds other answers of as little cost" in said[0]


def test_an_interval_at_a_bound_is_open_there_and_ends_as_half_a_bell_does():
    rng = np.random.default_rng(3)
    u = rng.uniform(-1, 1, 60)
    answer = line(u, 1 - 2 * u + 0.1 * rng.standard_normal(60), bounds=(0.0, 5.0))  # b has to be below 0
    found = pf.compare_intervals(answer, kinds=("bootstrap",), replicates=2000)
    b = found.record["parameters"][1]["kinds"][-1]
    r = np.asarray(answer.problem.unsmoothed.residuals(answer.best.x)) * answer.problem.scales["y"]
    error = np.std(r, ddof=2) / np.sqrt(np.sum((u - u.mean()) ** 2))
    assert b["open_low"]
    assert b["high"] == pytest.approx(norm.ppf(0.975) * error, rel=0.08)


@pytest.mark.parametrize("low", [1e-13, 3e-10])
def test_an_end_is_at_a_bound_on_the_scale_of_the_search(low):
    """A diode's current of 2e-9 A, searched over decades up to 1e-5 A: a thousandth of that box is 1e-8 A."""
    v = np.linspace(0.3, 0.6, 30)
    current = np.log(1.0 + np.exp(v / 0.03) * 2e-9) + 0.05 * np.random.default_rng(1).normal(size=30)
    model = pf.equations(
        "y = log(1 + exp(v/0.03)*I0)", inputs={"v": "1"}, outputs={"y": "1"}, parameters=["I0"], check=False
    )
    bounds = {"I0": pf.Parameter((low, 1e-5), scale="log")}
    answer = pf.fit(
        pf.Problem(model, pf.from_arrays({"v": v, "y": current}, period=1.0, units={"v": "1", "y": "1"}), bounds)
    )
    found = pf.compare_intervals(answer, kinds=("profile", "bootstrap"), replicates=200).typed
    (p,) = found.parameters
    assert not found.refused
    assert not any(k.open_low or k.open_high for k in p.kinds)
    for k in p.kinds:
        assert k.low is not None
        assert k.high is not None
        assert 1.5e-9 < k.low < 2e-9 < k.high < 2.6e-9


def test_corrected_percentiles_of_a_normal_sample_are_its_quantiles():
    sample = np.random.default_rng(0).normal(2.0, 0.5, 200_000)
    assert percentiles(sample, 2.0, 0.9, (-100.0, 100.0)) == pytest.approx(norm.interval(0.9, 2.0, 0.5), abs=0.01)


def test_blocks_are_as_long_as_the_noise_remembers(white):
    rng = np.random.default_rng(2)
    u = rng.uniform(-1, 1, 1000)
    slow = line(u, 1 + 2 * u + slow_noise(rng, 1000, 0.9, 0.3))
    assert bootstrap(white[2].problem, white[2].best.x, 50).block == {"y": 1}
    assert 50 < bootstrap(slow.problem, slow.best.x, 50).block["y"] < 150


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"kinds": ("mcmc",)}, "There is no kind 'mcmc' of interval; there are covariance"),
        ({"kinds": ()}, "at least one kind"),
        ({"level": 1.5}, "level is 1.5; give 0.5 to 0.999"),
        ({"replicates": 3}, "replicates is 3"),
        ({"parameters": ["c"]}, "There is no free parameter 'c'; there are a, b"),
        ({"priors": {"a": (1, 1)}}, "A prior is for the posterior"),
        ({"kinds": ("posterior",), "priors": {"c": (1, 1)}}, "A prior names 'c'; free are a, b"),
        ({"kinds": ("posterior",), "priors": {"a": "about 3"}}, "write mean and standard deviation"),
        ({"kinds": ("posterior",), "priors": {"a": (1, 0)}}, "has to be above 0"),
    ],
)
def test_refusals(white, asked, words):
    with pytest.raises(SpecError, match=words):
        pf.compare_intervals(white[2], **asked)


def test_profiles_of_puromycin_are_those_of_r():
    # R 4, datasets::Puromycin (treated), confint(nls(rate ~ Vm*conc/(K + conc))), whose threshold is Student's t with
    # 10 degrees of freedom
    published = {"Vm": (197.30212848, 229.29006490), "K": (0.04692517, 0.08615995)}
    concentration = np.repeat([0.02, 0.06, 0.11, 0.22, 0.56, 1.10], 2)
    rate = np.array([76, 47, 97, 107, 123, 139, 159, 152, 191, 201, 207, 200.0])
    model = pf.equations(
        "y = Vm*u/(K + u)", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["Vm", "K"], name="enzyme", check=False
    )
    record = pf.from_arrays({"u": concentration, "y": rate}, period=1.0, units=ONE)
    answer = pf.fit(pf.Problem(model, record, {"Vm": (50.0, 500.0), "K": (0.001, 1.0)}), seed=1)
    found = pf.compare_intervals(answer, kinds=("profile",))
    for name, ends in published.items():
        assert (found.profiles[name].low, found.profiles[name].high) == pytest.approx(ends, rel=2e-3)


def test_what_no_kind_bounds_is_not_called_agreed_and_reasons_fit():
    def kind(name, low, high, *, open_=False):
        return {"kind": name, "low": low, "high": high, "open_low": open_, "open_high": open_}

    def told(*parameters, block=1, status="determined", scatters=False):
        rows = [
            {
                "name": n,
                "unit": "1",
                "value": 1.0,
                "standard_error": 0.1,
                "status": status,
                "scatters": scatters,
                "kinds": kinds,
            }
            for n, kinds in parameters
        ]
        bootstrap = {"block": {"y": block}, "blocks": {"y": 100}, "lost": 0, "replicates": 100}
        whole = {
            "name": "x",
            "level": 0.95,
            "seed": 1,
            "parameters": rows,
            "bootstrap": bootstrap,
            "posterior": None,
            "refused": {},
        }
        return [v["sentence"] for v in interval_sentences(ComparisonOfIntervals.model_validate(whole))]

    open_ = ("c", [kind("profile", 0.0, 9.0, open_=True), kind("bootstrap", 0.0, 9.0, open_=True)])
    narrow = ("k", [kind("profile", 0.0, 2.0), kind("bootstrap", 0.5, 1.5)])
    same = ("k", [kind("profile", 0.0, 2.0), kind("bootstrap", 0.1, 2.1)])
    assert told(open_) == ["No kind of interval sets an end of c within the bounds of the search."]
    assert told(same) == ["All kinds agree on k: ends of their intervals lie at most 10 % of half a width apart."]
    assert "slow part" in told(narrow, block=30)[0]
    assert "slow part" not in told(narrow)[0]
    assert "another parameter meets a bound of the search" in told(narrow, open_)[0]
    wide = ("k", [kind("profile", 0.0, 2.0) | {"inflation": 2.0}, kind("bootstrap", 0.5, 1.5)])
    assert "larger ones where the value is told" in told(wide)[0]
    assert "larger ones where the value is told" not in told(narrow)[0]
    # what makes the interval of the verdict longer is named where it is
    long, short = (("k", [kind("verdict", 1 - w, 1 + w), kind("profile", 0.0, 2.0)]) for w in (3.0, 0.4))
    beyond = ("k", [kind("verdict", -2.0, 4.0, open_=True), kind("profile", 0.0, 2.0)])
    assert "leave the bounds of the search" in told(beyond, status="weak")[0]
    assert "other answers of as little cost" in told(long, status="weak")[0]  # no bound is met
    assert "the profile follows and the verdict does not" in told(short, status="weak")[0]
    assert "allows for a scatter" in told(long, scatters=True)[0]
    assert "allows for a scatter" not in told(short, scatters=True)[0]
