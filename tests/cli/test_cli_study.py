"""The commands of a study, in the order in which a user types them."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from cli_call import SPEC, call, heater

import plantfit as pf


@pytest.fixture
def folder(tmp_path, monkeypatch):
    heater(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.thorough
def test_check_run_list_report_predict(folder, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "check", "heater.toml", "--verify", "--json")
    record = json.loads(said.out)
    assert said.code == 0
    assert record["recordings"]["bench"]["fitted"] == 280
    assert [v["output"] for v in record["verify"]] == ["T"]
    assert record["verify"][0]["max_error"] < 0.05

    said = call(capsys, monkeypatch, "run", "heater.toml")
    assert said.code == 0, said.err
    assert "determine 4 of 4 parameters" in said.out
    assert (folder / "heater.html").stat().st_size > 6e5

    said = call(capsys, monkeypatch, "list", "--json")
    assert [(s["id"], s["name"], s["state"]) for s in json.loads(said.out)] == [(1, "heater", "done")]

    said = call(capsys, monkeypatch, "report", "1", "--json", "--out", "again.html")
    findings = json.loads(said.out)
    assert (folder / "again.html").exists()
    truth = {"K": 0.8, "T0": 21.0, "tau": 40.0, "L": 3.4}
    for p in findings["parameters"]:
        assert abs(p["value"] - truth[p["name"]]) < 4 * p["standard_error"], p

    said = call(capsys, monkeypatch, "predict", "heater.toml", "--json")
    assert json.loads(said.out)["rmse"]["T"] < 0.06
    assert (folder / "predicted.csv").read_text().startswith("t [s],")
    plain = pf.read_csv(folder / "predicted.csv")["T_simulated"]
    banded = json.loads(call(capsys, monkeypatch, "predict", "heater.toml", "--bands", "--json").out)
    assert banded["bands"]["level"] == 0.95
    assert banded["bands"]["held"]["T"] == pytest.approx(0.95, abs=0.035)  # 400 readings
    assert "T_low [degC],T_high [degC],T_read_low [degC],T_read_high [degC]" in (folder / "predicted.csv").read_text()
    table = pf.read_csv(folder / "predicted.csv")
    np.testing.assert_allclose(plain, table["T_simulated"], atol=1e-3)  # both from the start that the fit found
    assert np.all(table["T_simulated"] >= table["T_low"] - 1e-6)
    assert np.all(table["T_simulated"] <= table["T_high"] + 1e-6)
    refused = call(capsys, monkeypatch, "predict", "heater.toml", "--bands", "--set", "K=0.4")
    assert (
        refused.err
        == "plantfit: --bands are made for the parameters of the study; they cannot be used with --set, so leave one "
        "of the two out.\n"
    )
    far = call(capsys, monkeypatch, "predict", "heater.toml", "--set", "K=0.4", "--json")
    assert json.loads(far.out)["rmse"]["T"] > 5

    # what the file says by now is simulated, and not the model of the study in the store
    (folder / "heater.toml").write_text(SPEC.replace("K*delay", "0.5*K*delay"))
    half = call(capsys, monkeypatch, "predict", "heater.toml", "--json")
    assert json.loads(half.out)["rmse"]["T"] > 5


@pytest.mark.thorough
def test_a_recording_that_measures_nothing_is_predicted(folder, capsys, monkeypatch, recwarn):
    spec = SPEC.replace('initial = "T"', "initial = 24.0")
    (folder / "heater.toml").write_text(spec)
    assert call(capsys, monkeypatch, "run", "heater.toml", "--no-diagnose").code == 0
    plan = "t [s],u [%]\n" + "".join(f"{t},{60 if t > 20 else 30}\n" for t in range(0, 200, 4))
    (folder / "plan.csv").write_text(plan)
    planned = '[recording.plan]\nfile = "plan.csv"\ntime = "t [s]"\nsignals = { u = "u [%]" }\nunmeasured = ["T"]\n'
    (folder / "plan.toml").write_text(spec.replace("[model]", planned + "[model]", 1))
    said = call(capsys, monkeypatch, "predict", "plan.toml", "--recording", "plan", "--bands")
    assert said.out.startswith("T: not measured in plan\nWritten"), said.out
    found = json.loads(
        call(capsys, monkeypatch, "predict", "plan.toml", "--recording", "plan", "--bands", "--json").out
    )
    assert found["rmse"] == {"T": None}
    assert found["bands"]["held"] == {"T": None}
    table = pf.read_csv(folder / "predicted.csv")
    assert 65.0 < table["T_low"][-1] < table["T_simulated"][-1] < table["T_high"][-1] < 71.0
    said = call(capsys, monkeypatch, "predict", "plan.toml", "--bands")
    assert "degC over 400 samples of bench" in said.out
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]


@pytest.mark.thorough
def test_check_verifies_at_values_and_refines_to_a_tolerance(folder, capsys, monkeypatch):
    at = ("--at", "tau=12", "--at", "L=2.7")
    said = call(capsys, monkeypatch, "check", "heater.toml", "--verify", *at, "--json")
    coarse = json.loads(said.out)["verify"][0]
    said = call(
        capsys,
        monkeypatch,
        "check",
        "heater.toml",
        "--verify",
        *at,
        "--tolerance",
        str(coarse["max_error"] / 3),
        "--json",
    )
    fine = json.loads(said.out)["verify"][0]
    assert fine["max_error"] < coarse["max_error"] / 3
    assert fine["substeps"] > coarse["substeps"]
    said = call(capsys, monkeypatch, "check", "heater.toml", "--verify", *at)
    assert "at tau=12, L=2.7" in said.out
    assert "against scipy LSODA, rtol 1e-9: bench, T within" in " ".join(said.out.split())


@pytest.mark.parametrize(
    ("at", "said"),
    [("tua=3", "no free parameter 'tua'"), ("tau=many", "write NAME=NUMBER"), ("tau=-5", "outside its bounds")],
)
def test_check_refuses_values_in_one_sentence(folder, capsys, monkeypatch, at, said):
    answer = call(capsys, monkeypatch, "check", "heater.toml", "--verify", "--at", at)
    assert answer.code != 0
    assert said in " ".join(answer.err.split())
    assert "Traceback" not in answer.err


@pytest.mark.thorough
def test_a_static_curve_counts_in_the_same_fit(folder, capsys, monkeypatch):
    (folder / "curve.csv").write_text("u [%],T [degC]\n" + "\n".join(f"{u},{21 + 0.8 * u}" for u in range(0, 60, 5)))
    text = (folder / "heater.toml").read_text()
    extra = (
        '\n[recording.curve]\nfile = "curve.csv"\nperiod = 1.0\nsteady = true\nsignals = { u = "u [%]", T = "T '
        '[degC]" }\n'
    )
    (folder / "both.toml").write_text(text + extra)
    said = call(capsys, monkeypatch, "run", "both.toml", "--no-diagnose", "--json")
    assert said.code == 0, said.err
    found = {p["name"]: p for p in json.loads(said.out)["parameters"]}
    assert abs(found["K"]["value"] - 0.8) < 0.002
    assert {s["recording"] for s in json.loads(said.out)["scores"]} == {"bench", "curve"}


@pytest.mark.parametrize("order", ["drawn", "sorted"])
def test_rows_at_rest_need_no_times(tmp_path, order):
    """Numbers from 0 stand for them; a record over time without them is refused."""
    u = np.random.default_rng(2).uniform(-5.0, 5.0, 30)
    u = np.sort(u) if order == "sorted" else u
    np.savetxt(tmp_path / "curve.csv", np.column_stack([u, 0.8 * u]), delimiter=",", header="u,w", comments="")
    text = (
        'name = "curve"\n[model]\nequations = "x\' = (K*u - x)/2\\nw = x"\ninputs = ["u"]\noutputs = ["w"]\n'
        'states = ["x"]\n[parameters]\nK = { bounds = [0.1, 5] }\n[recording.r]\nfile = "curve.csv"\n'
    )
    (tmp_path / "rest.toml").write_text(text + "steady = true\n")
    record = pf.load(tmp_path / "rest.toml").problem.experiments["r"].recording
    np.testing.assert_array_equal(record.t, np.arange(30.0))
    np.testing.assert_allclose(record["u"], u)
    (tmp_path / "moving.toml").write_text(text)
    with pytest.raises(pf.PlantfitError, match="no column looks like time"):
        pf.load(tmp_path / "moving.toml")


@pytest.mark.thorough
def test_init_writes_a_study_that_runs(folder, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "init", "heater.csv", "--out", "new.toml")
    assert said.code == 0, said.err
    assert call(capsys, monkeypatch, "init", "heater.csv", "--out", "new.toml").code == 7  # never overwrites
    said = call(capsys, monkeypatch, "run", "new.toml", "--no-diagnose", "--json")
    assert said.code == 0, said.err
    scores = {s["part"]: s["fit_percent"] for s in json.loads(said.out)["scores"]}
    assert scores["fit"] > 95
    assert scores["validation"] > 95


WRONG = {
    "missing file": (("heater.csv", "other.csv"), 3, "other.csv"),
    "wrong column": (('"u [%]"', '"v [%]"'), 3, "no column 'v [%]'"),
    "unknown key": (("split = 0.7", "splt = 0.7"), 7, "did you mean 'split'"),
    "unknown symbol": (("K*delay", "Q*delay"), 5, "'Q'"),
    "unknown call": (("delay(u, L)", "dead(u, L)"), 5, "'dead'"),
    "reversed bounds": (("[0.01, 10.0]", "[10.0, 0.01]"), 6, "reversed bounds"),
    "unit that does not fit": (('unit = "degC/%"', 'unit = "bar"'), 5, "different kinds of quantity"),
    "unit that does not exist": (('unit = "degC/%"', 'unit = "flurbs"'), 4, "flurbs"),
    "zero budget": (("seed = 3", "seed = 3\nbudget = 0"), 7, "heater.toml, [search]: Study 'heater': budget is 0"),
    "unknown method": (("seed = 3", 'methods = ["psoo"]'), 7, "heater.toml, [search]: There is no method 'psoo'"),
    "unknown setting": (
        ("seed = 3", 'methods = ["pso"]\nsettings = { pso = { size = 9 } }'),
        7,
        "[search]: Method 'pso' has no setting 'size'",
    ),
    "setting out of range": (
        ("seed = 3", 'methods = ["pso"]\nsettings = { pso = { population = 1 } }'),
        7,
        "'population' of method 'pso' is 1",
    ),
    "broken TOML": (("[model]", "[model"), 7, "not valid TOML"),
    "both kinds of model": (("[model]", '[model]\nkind = "dc_motor"'), 7, "it can have only one"),
    "log bounds at zero": (("bounds = [1.0, 500.0]", "bounds = [0.0, 500.0]"), 6, "above 0"),
    "string for a number": (("split = 0.7", 'split = "most"'), 7, "split"),
}


@pytest.mark.parametrize("case", WRONG)
def test_one_sentence_and_an_exit_code(case, folder, capsys, monkeypatch):
    (old, new), code, part = WRONG[case]
    assert old in SPEC
    (folder / "heater.toml").write_text(SPEC.replace(old, new, 1))
    said = call(capsys, monkeypatch, "run", "heater.toml")
    assert said.code == code, said.err
    assert part in said.err
    assert said.err.startswith("plantfit: ")
    assert "Traceback" not in said.err
    assert said.out == ""


DATA = {
    "text in a number column": (("\n5,", "\nfive,"), 3, "'five'"),
    "time running backwards": (("\n5,", "\n1,"), 3, "time"),
    "missing input": (("\n5,50,", "\n5,,"), 9, "missing at sample 5"),
}


@pytest.mark.parametrize("case", DATA)
def test_a_bad_recording_is_named_with_its_place(case, folder, capsys, monkeypatch):
    (old, new), code, part = DATA[case]
    text = (folder / "heater.csv").read_text()
    assert old in text
    (folder / "heater.csv").write_text(text.replace(old, new, 1))
    said = call(capsys, monkeypatch, "run", "heater.toml")
    assert said.code == code, said.err
    assert part in said.err
    assert "Traceback" not in said.err


def test_a_missing_output_sample_is_left_out(folder, capsys, monkeypatch):
    lines = (folder / "heater.csv").read_text().splitlines()
    lines[50] = ",".join([*lines[50].split(",")[:2], ""])
    (folder / "heater.csv").write_text("\n".join(lines))
    said = call(capsys, monkeypatch, "run", "heater.toml", "--json")
    assert said.code == 0, said.err
    assert next(s["n"] for s in json.loads(said.out)["scores"] if s["part"] == "fit") == 279


def test_no_store_and_no_study(folder, capsys, monkeypatch):
    assert call(capsys, monkeypatch, "report").code == 10
    (folder / "broken.db").write_text("not a database at all, not even close to one")
    said = call(capsys, monkeypatch, "list", "--store", "broken.db")
    assert said.code == 10
    assert "broken.db" in said.err


@pytest.mark.thorough
def test_ctrl_c_saves_and_resume_ends_with_the_same_bits(folder, capsys, monkeypatch):
    more = SPEC.replace("seed = 3", 'seed = 3\nmethods = ["pso"]\nruns = 12\nbudget = 200000')
    (folder / "heater.toml").write_text(more)
    child = subprocess.Popen(
        [sys.executable, "-c", "from plantfit.cli.main import run_cli; run_cli()", "run", "heater.toml"],
        stderr=subprocess.PIPE,
        text=True,
    )
    from plantfit.study import Store

    until = time.monotonic() + 90
    while time.monotonic() < until and child.poll() is None:
        time.sleep(0.05)
        if (folder / "plantfit.db").exists() and Store.open("plantfit.db").studies():
            break  # the search takes several seconds from here on
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=600)
    assert child.returncode == 130, err
    assert "plantfit resume 1" in err
    assert call(capsys, monkeypatch, "resume").code == 0
    assert call(capsys, monkeypatch, "run", "heater.toml", "--store", "whole.db").code == 0
    one, two = Store.open("plantfit.db").runs(1), Store.open("whole.db").runs(1)
    assert len(one) == len(two) == 12
    for a, b in zip(one, two, strict=True):
        assert (a.method, a.run, a.cost, a.evaluations) == (b.method, b.run, b.cost, b.evaluations)
        assert a.x.tobytes() == b.x.tobytes()


def test_ctrl_c_after_the_search_says_how_to_go_on(folder, capsys, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("plantfit.reopen.answer_of", stopped)
        said = call(capsys, monkeypatch, "run", "heater.toml", "--store", "own.db")
    assert said.code == 130
    assert said.err.endswith(
        "Stopped by Ctrl-C. All runs of study 1 are kept; `plantfit report 1 --store own.db` works out what they are "
        "worth.\n"
    )
    assert call(capsys, monkeypatch, "report", "1", "--store", "own.db").code == 0


def test_catalogues(capsys, monkeypatch):
    names = [m["name"] for m in json.loads(call(capsys, monkeypatch, "methods", "--json").out)]
    assert {"auto", "pso", "cmaes", "lbfgsb", "least_squares"} <= set(names)
    models = json.loads(call(capsys, monkeypatch, "models", "--json").out)
    assert {"dc_motor", "drive", "first_order"} <= {m["name"] for m in models}
    assert "Kt" in call(capsys, monkeypatch, "models", "dc_motor").out


def test_check_says_what_the_records_can_determine(folder, capsys, monkeypatch):
    """The heater's four are told apart; with its gain written as a product of two the product is named, and what to
    hold."""
    said = call(capsys, monkeypatch, "check", "heater.toml")
    assert "These records can tell all 4 parameters apart" in " ".join(said.out.split())
    text = (folder / "heater.toml").read_text().replace("K*delay", "K*c*delay")
    (folder / "product.toml").write_text(text + "\n[parameters.c]\nbounds = [0.5, 2.0]\n")
    said = call(capsys, monkeypatch, "check", "product.toml")
    assert said.code == 0, said.err
    assert "These records can determine 4 of 5 at best: " in " ".join(said.out.split())
    assert "K*c. Hold or measure one of K and c." in " ".join(said.out.split())
    found = json.loads(call(capsys, monkeypatch, "check", "product.toml", "--json").out)["identifiable"]
    assert (found["rank"], found["of"], found["together"], found["fix"]) == (4, 5, ["K*c"], [["K"], ["c"]])


@pytest.mark.thorough
def test_check_sees_an_output_in_another_unit(folder, capsys, monkeypatch):
    """The heater's temperature in mK beside a model in K."""
    assert "random points of the bounds does" not in " ".join(
        call(capsys, monkeypatch, "check", "heater.toml").out.split()
    )
    # a state that begins at a recorded value is near it for a while whatever its unit
    text = (folder / "heater.toml").read_text().replace('initial = "T"', 'initial = "T0"')
    header, *rows = (folder / "heater.csv").read_text().splitlines()
    rows = [",".join((t, u, str(1e3 * float(y)))) for t, u, y in (r.split(",") for r in rows)]
    (folder / "mK.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "mK.toml").write_text(text.replace("heater.csv", "mK.csv"))
    said = call(capsys, monkeypatch, "check", "mK.toml")
    assert said.code == 0, said.err
    assert "does the model's T move as much as the recorded one" in " ".join(said.out.split())
    found = json.loads(call(capsys, monkeypatch, "check", "mK.toml", "--json").out)["data"]
    assert [look["kind"] for look in found if look["signal"] == "T"].count("reach") == 1
