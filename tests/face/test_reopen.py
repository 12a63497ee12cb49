"""Studies in a store as answers: the same as on the day they were fitted."""

import json
import subprocess
import sys

import numpy as np
import pytest
from face_plants import heated, heater_model, lasting, write_study

import plantfit as pf
from plantfit.errors import RecordingError, SearchError, StoreError
from plantfit.study import begin

PLAN = {"method": "least_squares", "runs": 2, "budget": 400, "seed": 3}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A store with the heater, fitted from Python (1) and by the command (2), and a bench that was written in Python
    (3)."""
    place = tmp_path_factory.mktemp("stored")
    write_study(place)
    return place


@pytest.fixture(scope="module")
def fitted(folder):
    return pf.fit(pf.load(folder / "heater.toml").problem, **PLAN, store=folder / "lab.db")


@pytest.fixture(scope="module")
def run(folder, fitted):
    """What `plantfit run --json` said about the same study."""
    words = ["run", "heater.toml", "--store", "lab.db", "--json", "--out", "heater.html"]
    told = subprocess.run(
        [sys.executable, "-m", "plantfit.cli.start", *words], cwd=folder, capture_output=True, text=True
    )
    if not told.stdout:
        code = f"import sys; sys.argv = ['plantfit', *{words!r}]; from plantfit.cli.start import run; run()"
        told = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    return json.loads(told.stdout)


@pytest.fixture(scope="module")
def bench(folder, run):
    problem = pf.Problem(heater_model(), heated(np.arange(0.0, 240.0, 2.0)), name="bench")
    return problem, pf.fit(problem, **{**PLAN, "runs": 1}, store=pf.Store.open(folder / "lab.db"))


def alike(one, other):
    assert one.values == other.values
    assert json.dumps(lasting(one.findings)) == json.dumps(lasting(other.findings))
    for name in one.problem.experiments:
        np.testing.assert_array_equal(one.predict(name)["T"], other.predict(name)["T"])


def test_a_study_fitted_with_a_store_is_opened_as_it_was(folder, fitted, run):
    opened = pf.open_study(1, folder / "lab.db")
    made = fitted.findings["reproduction"]
    made["command"] = opened.command  # the store does not keep what a program called itself
    alike(fitted, opened)
    assert opened.command == "plantfit run heater.toml"  # the plan is that of the file
    assert made["spec"] == (folder / "heater.toml").read_text()


def test_a_store_changes_no_bit_of_a_fit(folder, fitted):
    assert pf.fit(pf.load(folder / "heater.toml").problem, **PLAN).values == fitted.values


def test_a_study_of_the_command_line_is_opened_as_it_was(folder, fitted, run):
    opened = pf.open_study("heater", folder / "lab.db")  # the newest of this name
    assert {p["name"]: p["value"] for p in run["parameters"]} == opened.values
    assert {p["name"]: p["standard_error"] for p in run["parameters"]} == opened.standard_errors
    kept = {k: v for k, v in lasting(opened.findings).items() if k != "recordings"}
    said = {k: v for k, v in lasting(run).items() if k not in ("recordings", "report")}
    for r in (*kept["runs"], *said["runs"]):
        r.pop("seconds")
    assert json.loads(json.dumps(kept)) == said
    assert opened.values == fitted.values


def test_the_place_of_a_store_is_that_of_the_commands(folder, bench, monkeypatch, tmp_path):
    monkeypatch.setenv("PLANTFIT_STORE", str(folder / "lab.db"))
    with pytest.raises(StoreError, match=r"lab\.db holds no study 'xyz'"):
        pf.open_study("xyz")
    monkeypatch.delenv("PLANTFIT_STORE")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StoreError, match=r"plantfit\.db"):
        pf.open_study("heater")
    assert not (tmp_path / "plantfit.db").exists()


def test_near_names_are_told_and_far_ones_answered_with_those_there_are(folder, bench):
    with pytest.raises(StoreError, match=r"holds no study 'heatre'; did you mean 'heater'\?$"):
        pf.open_study("heatre", folder / "lab.db")
    with pytest.raises(StoreError, match=r"holds no study 'xyz'; it has 'heater', 'bench'\.$"):
        pf.open_study("xyz", folder / "lab.db")
    with pytest.raises(StoreError, match=r"has no study 9; it has the studies \[1, 2, 3\]"):
        pf.open_study(9, folder / "lab.db")
    pf.Store.open(folder / "empty.db")
    with pytest.raises(StoreError, match=r"empty\.db holds no study yet"):
        pf.open_study("heater", folder / "empty.db")


def test_a_problem_of_python_is_given_again(folder, bench):
    problem, answer = bench
    with pytest.raises(StoreError, match=r"made from Python without a study file.*pf\.open_study\(3, problem=\.\.\.\)"):
        pf.open_study("bench", folder / "lab.db")
    alike(answer, pf.open_study("bench", folder / "lab.db", problem=problem))


def test_another_problem_is_refused(folder, bench):
    other = pf.Problem(heater_model(), heated(np.arange(0.0, 240.0, 2.0), seed=9), name="bench")
    with pytest.raises(StoreError, match="Study 3 began with another problem"):
        pf.open_study("bench", folder / "lab.db", problem=other)


def test_recordings_that_changed_or_went_are_told(folder, run, tmp_path):
    text = (folder / "heater.csv").read_text()
    try:
        (folder / "heater.csv").write_text(text.replace("\n4,50,", "\n4,49,"))
        with pytest.raises(StoreError, match="Study 1 began with another problem"):
            pf.open_study(1, folder / "lab.db")
        (folder / "heater.csv").unlink()
        with pytest.raises(RecordingError, match=r"heater\.csv"):
            pf.open_study(1, folder / "lab.db")
    finally:
        (folder / "heater.csv").write_text(text)


def test_a_study_without_a_finished_run_has_no_answer(tmp_path):
    problem = pf.Problem(heater_model(), heated(np.arange(0.0, 60.0, 2.0)), name="early", substeps=1)
    store = pf.Store.open(tmp_path / "s.db")
    begin(
        pf.Plan("early"),
        pf.objective_of(problem),
        store,
        coordinates=problem.space.names,
        to_physical=problem.space.physical,
    )
    with pytest.raises(StoreError, match=r"Study 1 in .*s\.db has no finished run yet; go on with `plantfit resume 1`"):
        pf.open_study("early", store, problem=problem)


def test_what_a_store_cannot_keep_is_refused(folder, fitted):
    problem = pf.load(folder / "heater.toml").problem
    with pytest.raises(SearchError, match="A store keeps a method by its name"):
        pf.fit(problem, pf.methods.make("cmaes"), store=folder / "lab.db")
    with pytest.raises(SearchError, match=r"heater\.toml states other errors or draws"):
        pf.fit(problem, errors=(), draws=7, store=folder / "lab.db")


def test_a_changed_problem_is_no_longer_that_of_its_file(folder):
    problem = pf.load(folder / "heater.toml").problem
    assert problem.study_file is not None
    assert problem.study_file.text == (folder / "heater.toml").read_text()
    assert problem.with_scales({"T": 2.0}).study_file is None
