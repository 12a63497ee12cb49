"""The steam chamber's study with the errors of its instruments, on a record of the virtual rig."""

import shutil
from importlib.resources import files

import numpy as np
import pytest

import plantfit as pf
from plantfit.rig import SteamChamberRig


def test_the_span_of_the_instruments_and_the_valve_scale_the_static_gain(tmp_path):
    SteamChamberRig().record(40, seed=1).save(tmp_path)
    shutil.copy(str(files("plantfit.cases.steam").joinpath("instruments.toml")), tmp_path)
    study = pf.load(tmp_path / "instruments.toml")
    answer = pf.fit(study.problem, errors=study.errors, seed=1, budget=800)
    rows = {p["name"]: p for p in answer.findings["parameters"]}
    k, parts = rows["k"]["value"], rows["k"]["uncertainty"]["sources"]
    assert parts["transducer"] == pytest.approx(0.002 * k / np.sqrt(6), rel=1e-3)
    assert parts["input card"] == pytest.approx(0.006 * k / np.sqrt(6), rel=1e-3)
    assert parts["valve"] == pytest.approx(0.005 * k / np.sqrt(3), rel=1e-3)
    assert parts["camera"] < 0.01 * rows["k"]["uncertainty"]["combined"]
    assert rows["Td"]["uncertainty"]["combined"] == pytest.approx(0.04 / np.sqrt(3))
    said = [v["sentence"] for v in answer.findings["verdict"] if "stated errors the interval of k" in v["sentence"]]
    assert len(said) == 1
    assert "4.3 times as wide, 0.426 to 0.433 bar/%, most of it from the gain of u (valve)" in said[0]
