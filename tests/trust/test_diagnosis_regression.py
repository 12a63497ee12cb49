"""What a regression lacks is found by its columns: friction of which the truth is known, and nothing where nothing
is missing."""

import tomllib

import numpy as np
import pytest
from axis_records import MASS, VISCOUS, record, study

from plantfit import Problem, fit
from plantfit.errors import ModelError, SpecError
from plantfit.models.extensions.terms import slid
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared
from plantfit.report import render_html
from plantfit.spec import before_filter, load, with_additions
from plantfit.trust.diagnosis import asked_changes, change_of, changed, diagnose, diagnosis_record
from plantfit.trust.diagnosis.treatment import addition_lines


def axis():
    return LinearModel(
        "axis", {"force": "N"}, (Declared("M", "kg", (0.1, 50.0)), Declared("Fv", "N*s/m", (0.0, 50.0))),
        lambda s: np.stack([s["a"], s["v"]], axis=-1), {"q": "m", "v": "m/s", "a": "m/s^2"},
    )  # fmt: skip


FAULTS = {
    "coulomb": (lambda q, v: 1.7 * np.sign(v), 1.7, "force with v over"),
    "presliding": (lambda q, v: 1.7 * slid(q, 0.01), 1.7, "force with q over"),
    "quadratic": (lambda q, v: 2.9 * v * np.abs(v), 2.9, "force with v"),
    "offset": (lambda q, v: -0.8 + 0 * v, -0.8, "force"),
    "stribeck": (lambda q, v: 1.2 * np.exp(-((v / 0.1) ** 2)) * np.sign(v), 1.2, "force with v over"),
    "change": (lambda q, v: 5.0 * q * v, 5.0, "Fv with q"),
}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.further(2)
def test_what_is_missing_is_named_with_its_size(fault, seed):
    missing, truth, key = FAULTS[fault]
    answer = fit(Problem(axis(), record(seed, missing), split=0.7))
    assert abs(answer.values["M"] - MASS) + abs(answer.values["Fv"] - VISCOUS) > 0.005
    d = diagnose(answer.problem, answer.best.x)
    named = [t.extension for t in d.rounds[0].found]
    assert any(e.kind == fault and e.signal.startswith(key) for e in named), [e.name for e in named]
    own = next(t for t in d.rounds[0].found if t.extension.kind == fault)
    # a scale that was tried is not that of the plant
    assert own.value == pytest.approx(truth, rel={"stribeck": 0.4, "presliding": 0.1}.get(fault, 0.03))
    assert len([r for r in d.rounds if r.found]) == 1 or fault in ("stribeck", "presliding")
    values = d.answer_values()
    assert values["M"] == pytest.approx(MASS, rel=0.05)
    assert any("very likely missing" in said["sentence"] for said in diagnosis_record(d)["verdict"])


@pytest.mark.thorough
def test_nothing_is_named_where_nothing_is_missing():
    named = []
    for seed in range(30):
        answer = fit(Problem(axis(), record(seed, lambda q, v: 0 * v), split=0.7))
        named += [t.extension.name for r in diagnose(answer.problem, answer.best.x).rounds for t in r.found]
    assert len(named) <= 1, named


@pytest.mark.parametrize("filtered", [False, True])
def test_the_study_file_with_what_was_found_gives_the_truth(tmp_path, filtered):
    """Columns are made of the signals before these are filtered, so that the law stays true."""
    made = study(tmp_path, 5, lambda q, v: 0.5 + 2.9 * v * np.abs(v), filtered)
    answer = fit(made.problem)
    d = diagnose(answer.problem, answer.best.x, regression=before_filter(made))
    assert [c.signal for c in changed(d)] == ["force with velocity"]
    (tmp_path / "new.toml").write_text(with_additions(made.text, made.path, changed(d)))
    end = fit(load(tmp_path / "new.toml").problem)
    assert end.values["quadratic_force_with_velocity"] == pytest.approx(2.9, rel=0.02)
    assert end.values["M"] == pytest.approx(MASS, rel=0.01)
    assert end.values["Fv"] == pytest.approx(VISCOUS, rel=0.03)
    assert end.values["offset"] == pytest.approx(0.5, abs=0.02)


def test_one_alone_is_tried_by_its_name(tmp_path):
    made = study(tmp_path, 5, lambda q, v: 0 * v, False)
    answer = fit(made.problem)
    d = diagnose(answer.problem, answer.best.x, only="drag by the square on force with velocity")
    c = change_of(d, d.rounds[0].trials[0])
    assert (c.kind, c.signal, c.parameter) == ("quadratic", "force with velocity", "quadratic_force_with_velocity")
    with pytest.raises(ModelError, match="There is no 'dead time of force' to try"):
        diagnose(answer.problem, answer.best.x, only="dead time of force")


def test_signals_that_a_filter_took_away_are_asked_for(tmp_path):
    answer = fit(study(tmp_path, 5, lambda q, v: 0 * v, True).problem)
    with pytest.raises(ModelError, match="filtered before the fit"):
        diagnose(answer.problem, answer.best.x)


def test_a_table_of_instruments_has_no_diagnosis(tmp_path):
    study(tmp_path, 5, lambda q, v: 0 * v, False)
    text = (
        (tmp_path / "axis.toml")
        .read_text()
        .replace('velocity = "velocity", acceleration = "acceleration"', 'velocity = "velocity"')
    )
    text = text.replace('velocity = "m/s", acceleration = "m/s^2"', 'velocity = "m/s"')
    text += (
        '[regression]\nmethod = "least squares"\nderivatives = { velocity = ["acceleration", "jerk"] }\nband = 10.0\n'
    )
    (tmp_path / "axis.toml").write_text(text)
    with pytest.raises(SpecError, match="solved in closed form"):
        before_filter(load(tmp_path / "axis.toml"))


@pytest.mark.thorough
def test_a_run_tries_what_is_missing_where_much_is_left(tmp_path):
    """And nothing where the residual is noise; of filtered columns it says what is needed."""
    bent, white = (
        study(tmp_path, 5, lambda q, v: 2.9 * v * np.abs(v), False),
        study(tmp_path, 5, lambda q, v: 0 * v, False),
    )
    answer = fit(bent.problem)
    answer.diagnose()
    assert answer.findings["diagnosis"]["rounds"][0]["found"] == ["drag by the square on force with velocity"]
    assert "was not tried" not in answer.verdict
    assert "What may be missing</h2>" in render_html(answer.findings)
    filtered = study(tmp_path, 5, lambda q, v: 2.9 * v * np.abs(v), True)
    answer = fit(filtered.problem)
    answer.diagnose()
    assert answer.findings["diagnosis"]["state"] == "left"
    assert "give regression=plantfit.spec.before_filter(study)" in answer.verdict
    assert "What may be missing</h2>" not in render_html(answer.findings)  # the verdict has said all
    answer.diagnose(regression=before_filter(filtered))
    assert answer.findings["diagnosis"]["rounds"][0]["found"] == ["drag by the square on force with velocity"]
    quiet = fit(white.problem)
    assert quiet.diagnose() is None
    assert "was not tried" not in quiet.verdict


@pytest.mark.parametrize("derived", [True, False])
def test_a_small_addition_beside_differentiated_columns_may_stand_for_their_errors(tmp_path, derived):
    """Friction of 8 mN beside noise of 20 mN: a tenth of what is left."""
    made = study(tmp_path, 5, lambda q, v: 0.5 + 0.008 * np.sign(v), False)
    assert made.problem.differentiated == ("acceleration",)
    answer = fit(made.problem)
    answer.problem.differentiated = made.problem.differentiated if derived else ()
    d = diagnose(answer.problem, answer.best.x, regression=before_filter(made))
    said = next(s["sentence"] for s in diagnosis_record(d)["verdict"] if "explains" in s["sentence"])
    assert ("for the errors of acceleration in the columns" in said) == derived
    assert ("possibly missing" in said) == derived


def test_two_scales_of_one_pair_are_two_parameters(tmp_path):
    """The lines to write are TOML, and each parameter has its own start."""
    made = study(tmp_path, 5, lambda q, v: 0.5 + 1.5 * np.sign(v), False)
    answer = fit(made.problem)
    names = [f"dry friction on force with velocity over {s}" for s in ("0.01", "0.0001")]
    d = diagnose(answer.problem, answer.best.x, regression=before_filter(made), only=names)
    asked = asked_changes(d)
    assert [c.parameter for c in asked] == ["coulomb_force_with_velocity", "coulomb_force_with_velocity_2"]
    (tmp_path / "new.toml").write_text(with_additions(made.text, made.path, asked))
    space = load(tmp_path / "new.toml").problem.space
    assert [space.parameters[c.parameter].start for c in asked] == pytest.approx([c.start for c in asked])
    tomllib.loads("\n".join(addition_lines(asked)))
