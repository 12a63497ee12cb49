"""What is said of a regression's coefficients that a few rows decide."""

import numpy as np
import pytest

from plantfit.estimate.regressed import regress
from plantfit.models.library.drive import drive_regression
from plantfit.problem import Problem
from plantfit.recording import Recording
from plantfit.recording.record import Signal
from plantfit.report.sections.regression import sentences_of


def record_of(burst: bool, seed: int) -> dict:
    """Force of a drive at a velocity that goes to and fro; it is accelerated throughout, or for four samples only."""
    t, rng = 0.01 * np.arange(400), np.random.default_rng(seed)
    velocity = np.sin(2 * t)
    acceleration = np.where((t >= 1.0) & (t < 1.035), 8.0, 0.0) if burst else 8.0 * np.cos(15 * t)
    force = 2.0 * acceleration + 5.0 * velocity + 1.0 * np.sign(velocity) + 0.3 + rng.normal(0.0, 0.5, 400)
    signals = {"acceleration": (acceleration, "m/s^2"), "velocity": (velocity, "m/s"), "force": (force, "N")}
    recording = Recording(t, {n: Signal(*v) for n, v in signals.items()}, "run")
    return regress(Problem(drive_regression(), recording)).record | {"outputs": {"force": "N"}, "apart": []}


@pytest.mark.parametrize("seed", range(10))
def test_what_few_rows_decide_is_named(seed):
    said = [v["sentence"] for v in sentences_of(record_of(True, seed))]
    (few,) = [s for s in said if "decide" in s]
    assert few.startswith("Few of the 400 rows decide M (about ")
    assert " and " not in few.split(";")[0]
    assert "about 1 independent errors" not in few
    assert not [s for s in (v["sentence"] for v in sentences_of(record_of(False, seed))) if "decide" in s]
