"""`plantfit compare-records` on recordings of plants whose truth is known."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from cli_call import call

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.records_alike import recording

import plantfit as pf

SPEC = """name = "oven"
{recordings}
[model]
equations = "x' = (K*u - x)/tau; y = x"
inputs = {{ u = "V" }}
states = {{ x = {{ unit = "K", initial = 0 }} }}
outputs = {{ y = "K" }}
[parameters]
K = {{ unit = "K/V", bounds = [0.1, 100] }}
tau = {{ unit = "s", bounds = [0.01, 10], scale = "log" }}
[search]
budget = 400
"""


def study(folder, lags):
    rng = np.random.default_rng(3)
    for name, lag in lags.items():
        r = recording(rng, name, lag=lag)
        np.savetxt(
            folder / f"{name}.csv", np.column_stack([r.t, r["u"], r["y"]]), delimiter=",", header="t,u,y", comments=""
        )
    tables = "\n".join(f'[recording.{n}]\nfile = "{n}.csv"\ntime = "t"' for n in lags)
    (folder / "oven.toml").write_text(SPEC.format(recordings=tables))


@pytest.mark.thorough
def test_a_changed_recording_is_named_with_units_a_page_and_json(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, {"may": 0.6, "june": 0.6, "july": 0.9})
    said = call(capsys, monkeypatch, "compare-records", "oven.toml", "--json")
    assert said.code == 0, said.err
    record = said.record("compare-records")
    assert record["agree"] is False
    assert [a["recording"] for a in record["apart"]] == ["july"]
    assert record["apart"][0]["moved"][0]["name"] == "tau"
    assert record["apart"][0]["moved"][0]["unit"] == "s"
    assert "july no longer fits the other recordings: tau is 0.9" in (tmp_path / "oven-records.html").read_text()

    again = call(capsys, monkeypatch, "compare-records", "oven.toml", "--out", "other.html")
    assert "study 1 has its answer" in again.err
    assert "x july no longer fits the other recordings: tau is 0.9" in again.out
    assert "tau [s]" in again.out
    assert "RMSE, own values [K]" in again.out
    assert (tmp_path / "other.html").exists()
    stored = json.loads(call(capsys, monkeypatch, "compare-records", "1", "--json").out)
    assert stored["parameters"] == record["parameters"]


@pytest.mark.thorough
def test_recordings_that_agree_are_said_to(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, {"may": 0.6, "june": 0.6})
    said = call(capsys, monkeypatch, "compare-records", "oven.toml")
    assert said.code == 0, said.err
    assert "+ The recordings agree on all parameters (2 recordings; least p 0." in said.out
    assert "no longer fits" not in said.out


SCATTERS = "Recordings of this plant scatter in K, tau: the bands are those of the plant in another recording."


@pytest.mark.parametrize("july", [0.6, 0.75])
@pytest.mark.further(1)
def test_bands_say_that_they_are_for_another_recording(tmp_path, capsys, monkeypatch, july):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, {"may": 0.6, "june": 0.6, "july": july})
    assert call(capsys, monkeypatch, "run", "oven.toml", "--no-diagnose").code == 0
    said = call(capsys, monkeypatch, "predict", "oven.toml", "--bands").out
    assert (SCATTERS in said) == ("scatter" in said) == (july > 0.6)
    if july == 0.6:
        return
    told = json.loads(call(capsys, monkeypatch, "predict", "oven.toml", "--bands", "--json").out)
    assert ("tau" in told["bands"]["scatters"]) == (july > 0.6)


@pytest.mark.slow
@pytest.mark.parametrize("july", [0.6, 0.75])
def test_a_controller_is_tuned_for_another_recording(tmp_path, monkeypatch, july):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, {"may": 0.6, "june": 0.6, "july": july})
    answer = pf.fit(pf.load("oven.toml").problem, budget=400)
    design = pf.tune(answer, budget=10, plants=20, upper=5.0, lower=-5.0)
    sentences = [v["sentence"] for v in design.verdict if v["sentence"].startswith("Recordings scatter in ")]
    assert len(sentences) == (july > 0.6)
    assert not sentences or sentences[0].endswith("plants are those of another recording, within 95 % of each.")
    lags = design.drawn.values[:, list(design.drawn.names).index("tau")]
    assert (lags.max() > 0.72) == (july > 0.6)


def test_what_cannot_be_compared_is_said_before_anything_is_fitted(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, {"may": 0.6})
    said = call(capsys, monkeypatch, "compare-records", "oven.toml")
    assert said.code == 3
    assert (
        "'oven' fits one recording, 'may', and there is nothing to compare it with; add another [recording.NAME]"
        in said.err
    )
    assert "Traceback" not in said.err
    assert call(capsys, monkeypatch, "compare-records", "none.toml").code == 7
    assert call(capsys, monkeypatch, "compare-records", "oven", "--store", "none.db").code == 10
    said = call(capsys, monkeypatch, "list", "--json")
    assert json.loads(said.out) in ([], {"studies": []})
