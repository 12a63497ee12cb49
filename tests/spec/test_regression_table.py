"""The table [regression] of a study file: against a drive whose constants are known, and what is said of mistakes."""

from functools import cache

import numpy as np
import pytest

import plantfit as pf
from plantfit.errors import ModelError, PlantfitError, SearchError, SpecError
from plantfit.models.parts.as_regression import as_regression
from plantfit.recording import from_arrays, to_csv
from plantfit.rig.offered import record_rig

H = 1e-3
TRUE = {"M": 2.0, "Fv": 8.0, "offset": 0.7}

STUDY = """\
name = "own"
[recording.run]
file = "run.csv"
{recording}
[model]
equations = "F = M*a + Fv*v + offset"
inputs = {{ a = "m/s^2", v = "m/s" }}
outputs = {{ F = "N" }}
[parameters.M]
unit = "kg"
bounds = [0.1, 100]
[parameters.Fv]
unit = "N*s/m"
bounds = [0.1, 100]
[parameters.offset]
unit = "N"
bounds = [-10, 10]
{more}
[regression]
{regression}
"""
TABLE = """\
reference = { q = "q_ref" }
derivatives = { q = ["v", "a"] }
held = ["u"]
smoothing = 40
band = 8
targets = { F = "k*u" }
constants = { k = "2.5 N/V" }
"""


@cache
def drive(seed, error=2e-4, noise=0.02, seconds=12.0):
    """A mass whose controller reads a noisy sensor (`error` m rms): force 2.5 N/V, exact steps of the linear plant
    under a held voltage."""
    rng, n = np.random.default_rng(seed), int(seconds / H)
    t = np.arange(n) * H
    ref = 0.02 * np.sin(2 * np.pi * 0.3 * t) + 0.004 * np.sin(2 * np.pi * 0.9 * t + 1)
    rate = np.gradient(ref, H)
    pole = TRUE["Fv"] / TRUE["M"]
    keep = np.exp(-pole * H)
    x, v = ref[0], rate[0]
    q, u = np.empty(n), np.empty(n)
    before, slope = None, rate[0]
    for k in range(n):
        q[k] = x + error * rng.standard_normal()
        slope = 0.9 * slope + 0.1 * ((q[k] - before) / H if before is not None else slope)
        before = q[k]
        u[k] = (600 * (ref[k] - q[k]) + 25 * (rate[k] - slope)) / 2.5
        final = (2.5 * u[k] - TRUE["offset"]) / TRUE["Fv"]
        x += final * H + (v - final) * (1 - keep) / pole
        v = final + (v - final) * keep
    seen = u + noise * rng.standard_normal(n)
    return from_arrays(t, signals={"q": (q, "m"), "u": (seen, "V"), "q_ref": (ref, "m")}, name="run")


def written(folder, seed=0, regression=TABLE, recording="", more=""):
    to_csv(drive(seed), folder / "run.csv")
    path = folder / "own.toml"
    path.write_text(STUDY.format(recording=recording, regression=regression, more=more), "utf-8")
    return path


@pytest.mark.thorough
def test_intervals_of_own_equations_hold_the_truth_where_least_squares_misses_it(tmp_path):
    held, plain, off = [], [], []
    for seed in range(100, 125):
        found = pf.regress(written(tmp_path, seed))
        truth = np.array([TRUE[n] for n in found.best.names])
        assert found.bias is not None
        held.append((found.best.low <= truth) & (truth <= found.best.high))
        plain.append((found.least_squares.low <= truth) & (truth <= found.least_squares.high))
        off.append(found.bias.p_value)
    assert np.sum(held, axis=0).min() >= 20, np.mean(held, axis=0)  # of 25 at 95 %: fewer once in 1000
    assert np.mean(held) >= 0.88
    assert np.mean(plain, axis=0)[0] < 0.5, (
        "the mass by least squares must be missed, or no instruments are needed here"
    )
    assert np.median(off) < 1e-3


@pytest.mark.thorough
def test_a_free_joint_with_friction_does_not_draw_coefficients_to_zero(tmp_path):
    """Its torque is zero, which zero coefficients explain exactly: weights by residuals led there in a third of
    these records."""
    inside = []
    for seed in range(2000, 2008):
        made = record_rig("pendubot", {"l1": 0.25, "Fc1": 5e-3}, seed=seed)
        found = pf.regress(made.save(tmp_path / "run.csv", study=True, force=True)["study"])
        truth = np.array([made.truth["determined"][n]["value"] for n in found.best.names])
        inside.append((found.best.low <= truth) & (truth <= found.best.high))
        assert found.values["b5"] == pytest.approx(0.015, rel=0.3)
    assert np.sum(inside, axis=0).min() >= 5  # of 8 at 95 %: fewer once in 2700


def test_a_held_coefficient_is_subtracted_and_the_others_follow(tmp_path):
    text = '[parameters.Fv]\nunit = "N*s/m"\nbounds = [0.1, 100]\n'
    path = written(tmp_path)
    path.write_text(path.read_text("utf-8").replace(text, '[parameters.Fv]\nunit = "N*s/m"\nvalue = 8.0\n'), "utf-8")
    found = pf.regress(path)
    assert found.held == {"Fv": 8.0}
    assert found.best.names == ("M", "offset")
    assert found.values["M"] == pytest.approx(2.0, rel=0.01)
    assert found.record["held"] == {"Fv": 8.0}


def test_unseen_samples_are_explained_and_not_fitted(tmp_path):
    found = pf.regress(written(tmp_path, recording="split = 0.6"))
    whole = pf.regress(written(tmp_path))
    assert found.rows < 0.7 * whole.rows
    assert found.rmse["validation"]["F"] < 2 * found.rmse["fit"]["F"]
    assert "validation" not in whole.rmse


def test_two_recordings_give_one_estimate_with_a_smaller_error(tmp_path):
    to_csv(drive(1), tmp_path / "two.csv")
    one = pf.regress(written(tmp_path))
    both = pf.regress(written(tmp_path, recording='[recording.two]\nfile = "two.csv"'))
    assert both.rows == 2 * one.rows
    assert np.all(both.best.standard_error < 0.9 * one.best.standard_error)
    truth = np.array([TRUE[n] for n in both.best.names])
    assert np.all(np.abs(both.best.values - truth) < 4 * both.best.standard_error)


def test_units_of_columns_and_targets_are_followed(tmp_path):
    record = drive(3)
    path = written(tmp_path, 3)
    expected = pf.regress(path).values
    scaled = {"q": (1e3 * record["q"], "mm"), "u": (1e3 * record["u"], "mV"), "q_ref": (1e3 * record["q_ref"], "mm")}
    to_csv(from_arrays(record.t, signals=scaled, name="run"), tmp_path / "run.csv")
    path.write_text(path.read_text("utf-8").replace("2.5 N/V", "2.5e-3 N/mV"), "utf-8")
    assert pf.regress(path).values == pytest.approx(expected, rel=1e-6)


def test_a_fit_by_search_is_refused(tmp_path):
    study = pf.load(written(tmp_path))
    with pytest.raises(SearchError, match="solve it by plantfit"):
        pf.fit(study.problem)
    path = tmp_path / "plain.toml"
    path.write_text(
        study.text.split("[regression]")[0]
        .replace('inputs = { a = "m/s^2"', 'inputs = { q = "m/s^2"')
        .replace("M*a", "M*q"),
        "utf-8",
    )
    with pytest.raises(PlantfitError):
        pf.regress(path)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('reference = { q = "q_ref" }\n', "", "instrumental variables need reference"),
        ('"q_ref"', '"q"', "is a measured signal and has the errors of the columns"),
        ('"q_ref"', '"q_raf"', "Did you mean 'q_ref'"),
        ('{ q = "q_ref" }', '{ p = "q_ref" }', "reference names 'p', which is not in derivatives"),
        (
            'derivatives = { q = ["v", "a"] }',
            'derivatives = { q = ["v", "w"] }',
            "the model reads 'a', which is neither recorded nor",
        ),
        ('derivatives = { q = ["v", "a"] }', 'derivatives = { q = ["v"] }', "derivatives.q"),
        ('["v", "a"]', '["v", "q"]', "names 'q' twice"),
        ('held = ["u"]', 'held = ["U"]', "held names 'U'.*Did you mean 'u'"),
        ("targets = { F", "targets = { G", "targets names 'G', which is not an output"),
        ("k*u", "k*z", "'z'"),
        ("k*u", "k*", "targets"),
        ("2.5 N/V", "2.5 N/A", "targets"),
        ('targets = { F = "k*u" }\n', "", "'F' is an output, but recording 'run' has no such signal"),
        ("band = 8", "band = -8", "band"),
        ("band = 8\n", "", "'regression.band' is missing"),
        ("band = 8", "band = 450", "band = 450 Hz at a period of 0.001 s"),
        ("smoothing = 40", "smoothing = 4000", r"\[regression\].*4000"),
        ("smoothing", "smothing", "did you mean 'smoothing'"),
        ("band = 8", 'band = 8\nmethod = "instruments"', "method"),
        (
            "band = 8",
            'band = 8\nmethod = "least squares"',
            "reference is for instrumental variables, but method is least squares",
        ),
    ],
)
def test_mistakes_are_told_with_the_key(tmp_path, old, new, sentence):
    assert old in TABLE
    with pytest.raises(PlantfitError, match=sentence) as said:
        pf.load(written(tmp_path, regression=TABLE.replace(old, new)))
    assert str(said.value).startswith("own.toml")


def test_a_reference_that_is_the_measurement_under_another_name_is_no_instrument(tmp_path):
    path = written(tmp_path)
    record = drive(0)
    to_csv(from_arrays(record.t, signals={n: (record[m], record.signals[m].unit) for n,
                                          m in (("q", "q"), ("u", "u"), ("q_ref", "q"))}),
           tmp_path / "run.csv")  # fmt: skip
    with pytest.raises(SpecError, match="has the same samples as 'q', so it has the same errors"):
        pf.load(path)


def test_a_filter_said_twice_and_parameters_that_a_regression_has_not(tmp_path):
    path = written(tmp_path)
    path.write_text(
        path.read_text("utf-8").replace("[parameters.M]", "filter_alike = { cutoff = 5 }\n[parameters.M]"), "utf-8"
    )
    with pytest.raises(SpecError, match="leave filter_alike out"):
        pf.load(path)
    path = written(tmp_path, more='[uncertainty.x]\nof = "F"\nkind = "gain"\nlimit = 1\nunit = "%"')
    with pytest.raises(SpecError, match="a regression cannot use stated errors of instruments"):
        pf.load(path)
    path = written(tmp_path)
    path.write_text(
        path.read_text("utf-8").replace("[parameters.M]\n", "[parameters.M]\nper_recording = true\n"), "utf-8"
    )
    with pytest.raises(SearchError, match="a regression has one number for all recordings"):
        pf.regress(path)
    path.write_text(
        'name = "x"\n[recording.run]\nfile = "run.csv"\n[model]\nkind = "drive"\n[regression]\nband = 5\n', "utf-8"
    )
    with pytest.raises(PlantfitError, match="is simulated"):
        pf.load(path)


def own(text, *parameters):
    return pf.equations(
        text, inputs={"a": None, "v": None}, outputs={"F": None}, parameters=list(parameters) or ["M", "Fv"]
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("F = M*a + Fv^2*v", "not linear"),
        ("F = M*Fv*a*v", "not linear"),
        ("F = M*a + Fv*v + 1", "the part that is known"),
    ],
)
def test_equations_that_are_no_regression(text, sentence):
    model = own(text)
    with pytest.raises(ModelError, match=sentence):
        as_regression(model).columns({"a": np.linspace(1, 2, 5), "v": np.linspace(1, 3, 5)})


def test_equations_as_columns_are_those_written(tmp_path):
    model = as_regression(own("F = M*a + Fc*smooth_sign(v, 0.1)", "M", "Fc"))
    a, v = np.linspace(1, 2, 5), np.linspace(-1, 3, 5)
    np.testing.assert_allclose(model.columns({"a": a, "v": v}), np.stack([a, np.tanh(v / 0.1)], axis=1), rtol=1e-14)
    with pytest.raises(ModelError, match="has states"):
        as_regression(pf.equations("x' = -k*x; y = x", states=["x"], outputs=["y"], parameters=["k"]))
