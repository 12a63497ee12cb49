"""The heat exchanger, the heater board and the thermal plant: real data against figures of separate programs."""

from types import SimpleNamespace

import numpy as np
import pytest

from plantfit.cases import demos
from plantfit.cases.exchanger.demo import after_steps
from plantfit.cases.exchanger.sections import settled
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, residual, rms
from plantfit.cases.thermal.demo import _span
from plantfit.recording.record import Recording, Signal
from plantfit.spec import load
from plantfit.trust.validate.dead_time import dead_time
from plantfit.trust.validate.level_responses import level_responses


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plants")


@pytest.mark.thorough
def test_heater_dead_time_is_that_of_a_separate_program(folder):
    answer = fit_file(unpack("heater", folder / "heater") / "first_order.toml", method="least_squares")
    found = dead_time(answer.problem, answer)
    assert rms(residual(answer, "y")) <= 0.3815
    assert found.determined
    assert found.interval[0] < 14.2 < found.interval[1]
    assert answer.values["K"] == pytest.approx(0.3607, rel=2e-3)
    assert answer.values["tau"] == pytest.approx(138.1, rel=2e-3)


@pytest.mark.slow
def test_dead_time_of_the_thermal_plant_is_not_told(folder):
    """Its residuals drift: they are worth four independent samples, for four parameters."""
    answer = fit_file(unpack("thermal", folder / "thermal") / "thermal.toml", method="least_squares")
    found = dead_time(answer.problem, answer)
    assert not found.determined
    assert found.sentence.startswith("The recording does not tell the dead time L")
    assert found.interval[0] == 0.0
    assert found.interval[1] > 0.522  # the authors' value is inside
    assert answer.values["K"] == pytest.approx(1.158, rel=0.02)
    assert answer.values["tau"] == pytest.approx(35.4, rel=0.05)


@pytest.mark.parametrize(
    ("lower", "upper", "said"),
    [(False, False, "1.5 (1 to 2)"), (True, False, "1.5 (below 2)"), (False, True, "1.5 (above 1)"),
     (True, True, "1.5 (not told)")],
)  # fmt: skip
def test_a_bound_of_the_search_is_no_end_of_an_interval(lower, upper, said):
    assert _span(SimpleNamespace(value=1.5, low=1.0, high=2.0, at_lower=lower, at_upper=upper)) == said  # pyrefly: ignore[bad-argument-type]


def test_steps_of_the_exchanger_that_tell_nothing_are_those_above_1_5(folder):
    problem = load(unpack("exchanger", folder / "exchanger") / "linear.toml").problem
    found = level_responses(problem.experiments["january"].recording, "u", "y")
    assert len(found) == 12
    assert not any(f.told for f in found if f.level > 1.5)
    assert all(f.told for f in found if f.level in (0.55, 0.7, 1.0, 1.15))
    assert len(settled(problem.experiments["june_stairs"].recording)) == 31


def test_error_after_steps_begins_at_zero():
    t = np.arange(0.0, 400.0, 2.0)
    record = Recording(
        t, {"u": Signal(np.where(t < 200, 1.0, 2.0)), "y": Signal(np.where(t < 200, 5.0, 8.0), "degC")}, "made"
    )
    np.testing.assert_allclose(after_steps(None, "made", record), -3.0)


def value(record, name):
    return next(f["value"] for f in record["figures"] if f["name"] == name)


def reference(record, name):
    return next(f["reference"] for f in record["figures"] if f["name"] == name)


@pytest.mark.slow
def test_exchanger_one_table_model_and_the_recordings_left_out(folder):
    record = demos()["exchanger"][1]()(folder / "exchanger_demo")
    assert value(record, "staircase of January, one table model") <= 0.5
    assert value(record, "staircase, a model for each level") == pytest.approx(0.365, abs=0.01)
    for name in (
        "june_stairs",
        "june_prbs",
    ):  # fitted within June, the table carries further; January's does not, and that is said
        unseen, other = f"models of June, on {name}, unseen half: table", f"models of January, on {name}, unseen: table"
        assert value(record, unseen) < reference(record, unseen)
        assert value(record, other) > reference(record, other)
    after = "models of January, on june_stairs, change after a step: table"
    assert value(record, after) < 0.6 * reference(record, after)
    assert any("loses to the linear model" in s for s in record["sentences"])
    rows = record["sections"][1]["tables"][0]["rows"]
    assert [r[-1] for r in rows if float(r[0].split(" to ")[1]) > 1.5] == ["neither gain nor dead time"] * 5


@pytest.mark.slow
def test_heater_intervals_hold_the_reference_values_and_errors_are_no_larger(folder):
    record = demos()["heater"][1]()(folder / "heater_demo")
    assert value(record, "first_order: RMSE") <= 0.3815
    assert value(record, "second_order: RMSE") <= 0.3135
    rows = record["sections"][0]["tables"][0]["rows"]
    assert len(rows) == 7
    assert all(row[-1] == "yes" for row in rows)
    assert value(record, "two heaters, y1: RMSE on the unseen half") < 1.8
    assert value(record, "two heaters, y2: RMSE on the unseen half") < 1.6


@pytest.mark.slow
def test_thermal_plant_says_that_drift_dominates(folder):
    record = demos()["thermal"][1]()(folder / "thermal_demo")
    assert value(record, "constant offset: RMSE") < 0.616
    assert value(record, "slow drift: RMSE") < 0.3
    assert any(
        s.startswith("However the surroundings are taken, the dead time cannot be told") for s in record["sentences"]
    )
