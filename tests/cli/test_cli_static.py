"""The commands on a static model: a characteristic in rows of no order."""

import json

import numpy as np
import pytest
from cli_call import call

STUDY = """
name = "head"
[model]
equations = "H = H0*w^2 - a*Q^2"
inputs = { Q = "m^3/h", w = "1" }
outputs = { H = "m" }
[parameters]
H0 = { bounds = [1, 100], unit = "m" }
a = { bounds = [0, 1], unit = "m/(m^3/h)^2" }
[recording.r]
file = "head.csv"
period = 1.0
units = { Q = "m^3/h", w = "1", H = "m" }
"""


@pytest.mark.parametrize("fault", [0.0, 1.0])
@pytest.mark.thorough
def test_a_run_names_the_part_and_diagnose_writes_it(tmp_path, capsys, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    flow, speed = rng.uniform(0, 50, 80), rng.uniform(0.5, 1, 80)
    head = 30 * speed**2 - 0.006 * flow**2 - 0.1 * fault * flow * speed + rng.normal(0, 0.1, 80)
    (tmp_path / "head.toml").write_text(STUDY)
    rows = np.column_stack([flow, speed, head])
    np.savetxt(tmp_path / "head.csv", rows, delimiter=",", header="Q,w,H", comments="")
    said = call(capsys, monkeypatch, "run", "head.toml", "--json")
    verdict = " ".join(s["sentence"] for s in json.loads(said.out)["verdict"])
    assert ("A part of H by Q times w" in verdict) == bool(fault)
    assert ("The residuals of H follow" in verdict) == bool(fault)
    told = json.loads(call(capsys, monkeypatch, "diagnose", "head.toml", "--json").out)
    if not fault:
        assert "file" not in told
        return
    assert told["rmse"] == pytest.approx(0.1, rel=0.3)
    assert told["values"]["product_H_with_Q_and_w"] == pytest.approx(-0.1, abs=0.01)
    said = call(capsys, monkeypatch, "run", told["file"], "--json", "--no-diagnose")
    assert said.code == 0
    assert "residuals of H are white" in said.out
    refused = call(capsys, monkeypatch, "run", "head.toml", "--try", "slow drift of H")
    assert refused.code != 0  # rows in no order have no drift
    assert "There is no 'slow drift of H' to try." in refused.err
