"""`plantfit diagnose` that is stopped by Ctrl-C tells what was tried until then; a slow drift by `run --try`; what does
not hold on unseen data is no next step."""

import json
import os
import re
import signal
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

import numpy as np
import pytest
from benchmarks.diagnosis import PLANTS, simulate, write, written
from cli_call import call

from plantfit.trust.diagnosis import rounds


@pytest.mark.thorough
def test_what_was_tried_is_told_and_written(tmp_path, capsys, monkeypatch):
    place = write(PLANTS["first"], "dead_time", 0.01, 3, tmp_path)
    place.write_text(place.read_text() + "[search]\nbudget = 600\n")
    monkeypatch.chdir(tmp_path)
    real, tried = rounds.tried, []

    def interrupted(carrier, base, e, *rest):
        tried.append(e.name)
        if e.kind == "dead_time" and len(tried) > 1:
            os.kill(os.getpid(), signal.SIGINT)
        return real(carrier, base, e, *rest)

    monkeypatch.setattr(rounds, "tried", interrupted)
    said = call(capsys, monkeypatch, "diagnose", "study.toml", "--out", "new.toml")
    assert said.code == 0, said.err
    assert "Stopping; what was tried until now is told." in said.err
    assert "A dead time of" in said.out
    assert "dead_time" in (tmp_path / "new.toml").read_text()
    told = re.search(
        r"It was stopped: (\d+) of (\d+) additions to the model were tried until then", " ".join(said.out.split())
    )
    assert told
    assert int(told[1]) == len(tried) < int(told[2])
    assert "likely missing" not in said.out


@pytest.mark.thorough
def test_a_slow_drift_is_added_by_run(tmp_path, capsys, monkeypatch):
    place = write(PLANTS["first"], "clean", 0.01, 3, tmp_path)
    place.write_text(place.read_text() + "[search]\nbudget = 600\n")
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "run", "study.toml", "--no-diagnose", "--try", "slow drift of y")
    assert said.code == 0, said.err
    assert "slow_drift_y: smoothed" in said.out
    assert 'smooth = "reml"' in (tmp_path / "first-with-slow-drift-of-y.toml").read_text()
    wrong = call(capsys, monkeypatch, "run", "study.toml", "--try", "slow drift of x")
    assert wrong.code != 0
    assert "There is no 'slow drift of x' to try. Did you mean 'slow drift of y'" in " ".join(wrong.err.split())


@pytest.mark.parametrize("ends", [True, False])
def test_what_does_not_hold_on_unseen_data_is_written_and_not_the_next_step(ends, tmp_path, capsys, monkeypatch):
    """A drift that ends where the unseen part begins, and one that stays there as it was."""
    made = simulate(PLANTS["first"], "clean", 0.01, 3)
    share = np.arange(len(made.y)) / (0.7 * len(made.y))
    drift = 0.075 * np.ptp(made.y) * (1.0 - np.sin(3.0 * np.pi * np.minimum(share, 1.0) + np.pi / 2))
    place = written(PLANTS["first"], replace(made, y=made.y + np.where(ends & (share >= 1.0), 0.0, drift)), tmp_path)
    place.write_text(place.read_text() + "[search]\nbudget = 600\n")
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "diagnose", "study.toml", "--try", "slow drift of y", "--out", "new.toml")
    assert said.code == 0, said.err
    assert (tmp_path / "new.toml").is_file()
    warned = "it does not hold there, and may stand for something else." in " ".join(said.out.split())
    assert warned == ends
    assert ("Next: plantfit run new.toml" in said.out) == (not ends)
    told = json.loads(
        call(capsys, monkeypatch, "diagnose", "study.toml", "--try", "slow drift of y", "--out", "b.toml", "--json").out
    )
    assert (told["unseen_rmse"] > told["unseen_rmse_without"]) == ends
