"""Unseen samples that the answer cannot simulate: said in words, with the time; they made the verdict raise
TypeError."""

import numpy as np
import pytest

import plantfit as pf

T = 0.1 * np.arange(300)


def emptied(recordings=1):
    """A tank that is filled at first, and drained below its outlet in the last third: the root of a negative level."""
    u = np.where(T < 20.0, 0.05 + 0.1 * np.sin(T), -0.4)
    level = 1.0 + np.cumsum(np.r_[0.0, u[:-1]]) * 0.1
    found = {}
    for k in range(recordings):
        y = 2.0 * np.sqrt(np.maximum(level, 0.0)) + 0.01 * np.random.default_rng(k).standard_normal(300)
        seen = slice(None, 200 if recordings > 1 and k == 0 else None)
        found[f"run{k}"] = pf.Recording(
            T[seen], {"u": pf.Signal(u[seen], "1/s"), "y": pf.Signal(y[seen], "V")}, f"run{k}"
        )
    model = pf.equations(
        "x' = c*u\ny = k*sqrt(x)", inputs={"u": "1/s"}, states={"x": {"unit": "", "initial": 1.0}}, outputs={"y": "V"},
        parameters={"k": "V", "c": ""},
    )  # fmt: skip
    boxes = {"k": (0.1, 10.0), "c": (0.1, 5.0)}
    return pf.Problem(model, found, boxes, split=0.66 if recordings == 1 else None, validate=list(found)[1:])


@pytest.mark.parametrize("recordings", [1, 6])
def test_the_verdict_says_when_and_why(recordings, tmp_path):
    answer = pf.fit(emptied(recordings), budget=600)
    assert answer.values["k"] == pytest.approx(2.0, rel=0.01)
    said = [s for s in answer.findings["verdict"] if "cannot be simulated" in s["sentence"]]
    assert len(said) == 1  # of many recordings, too
    assert all(s["level"] == "bad" for s in said)
    lost = float(said[0]["sentence"].split("t = ")[1].split(" s")[0])
    level = 1.0 + np.cumsum(np.r_[0.0, np.where(T < 20.0, 0.05 + 0.1 * np.sin(T), -0.4)[:-1]]) * 0.1
    assert lost == pytest.approx(T[np.argmax(level < 0.0)], abs=0.3)
    assert np.isnan(answer.score()["y"])
    assert "it holds" not in str(answer.verdict)
    assert answer.report(tmp_path / "page.html").exists()
    assert "cannot be simulated" in repr(answer) or str(answer)


def test_a_command_ends_in_a_sentence(tmp_path, capsys, monkeypatch):
    from plantfit.cli.main import run_cli

    problem = emptied()
    pf.recording.to_csv(problem.experiments["run0"].recording, tmp_path / "run.csv")
    (tmp_path / "tank.toml").write_text(
        'name = "tank"\n[recording.run]\nfile = "run.csv"\nsplit = 0.66\n[model]\nequations = "x\' = c*u\\ny = '
        'k*sqrt(x)"\n'
        'inputs = ["u"]\noutputs = ["y"]\n[model.states]\nx = { initial = 1.0 }\n[parameters]\nk = { bounds = [0.1, '
        "10] }\n"
        "c = { bounds = [0.1, 5] }\n[search]\nbudget = 600\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["plantfit", "run", "tank.toml"])
    run_cli()
    assert "cannot be simulated: y is not a number from t = " in capsys.readouterr().out.replace("\n", " ")
