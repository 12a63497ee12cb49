"""NIS and NEES: right noise passes as often as promised, wrong noise is named."""

import dataclasses

import kalman_plants as plants
import numpy as np
import pytest

from plantfit import Problem
from plantfit.errors import RecordingError, SpaceError
from plantfit.estimate import Noise, kalman_filter, nees, nees_test, nis_test, ukf
from plantfit.estimate.filters.consistency import chi_squared_test

RUNS = 60


@pytest.fixture(scope="module")
def runs():
    """Runs of the true filter over records of their own, with the true states."""
    records = [plants.motor_record(500 + k, 150) for k in range(RUNS)]
    ready = kalman_filter(Problem(plants.robot_motor(), records[0][0]), plants.NOISE, at=plants.TRUTH)
    return [(ready.run(r), {"i": x[:, 0], "w": x[:, 1]}) for r, x in records]


def test_nis_of_the_true_filter_fails_in_5_of_100(runs):
    passed = sum(nis_test(run).consistent for run, _ in runs)
    assert RUNS - 8 <= passed <= RUNS  # 8 or more failures of 60 happen once in 90 times
    assert np.mean([run.nis.mean() for run, _ in runs]) == pytest.approx(2.0, abs=0.05)


def test_nees_of_the_true_filter_is_chi_squared_at_every_time(runs):
    values = np.array([nees(run, truth) for run, truth in runs])
    low, high = (
        chi_squared_test(values[:, 0], np.full(RUNS, 2)).low,
        chi_squared_test(values[:, 0], np.full(RUNS, 2)).high,
    )
    inside = (values.mean(axis=0) > low) & (values.mean(axis=0) < high)
    assert np.mean(inside) > 0.88
    assert nees_test([v[-1:] for v in values], 2).consistent
    assert nees_test(list(values), 2).p_value > 1e-3
    one = np.array([nees(run, {"w": truth["w"]}) for run, truth in runs])
    assert np.mean(one) == pytest.approx(1.0, abs=0.08)


def test_wrong_noise_is_said_to_be_wrong(runs):
    run = runs[0][0]
    sure = dataclasses.replace(run, told={**run.told, "white": 2.0 * run.told["white"]})
    verdict = nis_test(sure)
    assert not verdict.consistent
    assert verdict.p_value < 1e-6
    assert "too sure" in verdict.sentence
    record, x = plants.motor_record(900, 150)
    noise = Noise(
        {n: 3 * v for n, v in plants.PROCESS.items()}, {n: 3 * v for n, v in plants.MEASUREMENT.items()}, plants.INITIAL
    )
    careful = kalman_filter(Problem(plants.robot_motor(), record), noise, at=plants.TRUTH).run()
    verdict = nis_test(careful)
    assert "too careful" in verdict.sentence
    assert "3 times" in verdict.sentence
    assert np.mean(nees(careful, {"i": x[:, 0], "w": x[:, 1]})) < 0.5
    with pytest.raises(RecordingError, match="earlier start"):
        nis_test(run, start=1e9)
    with pytest.raises(SpaceError, match="'x'"):
        nees(run, {"x": 1.0})
    with pytest.raises(RecordingError, match="too few"):
        nees_test([run.nis], 2)


def test_joint_parameters_are_as_sure_as_they_should_be():
    """The errors of a tank's two constants at the end of 30 records are hardly larger than a joint filter says."""
    records = [plants.tank_record(300 + k, 120, fine=20)[0] for k in range(30)]
    ready = ukf(
        Problem(plants.tank(), records[0], substeps=2), plants.TANK_NOISE, ["k", "area"], at={"k": 0.62, "area": 2.5}
    )
    values = [nees(ready.run(record), plants.TANK)[-1:] for record in records]
    assert nees_test(values, 2).mean < 3.2
