"""Diagnosis on a sample of benchmarks/diagnosis.py: planted faults are named with their size, clean records are left
alone."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, write

from plantfit.errors import ModelError
from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.spec import load, with_additions
from plantfit.trust.diagnosis import changed, diagnose, diagnosis_record, effects


def diagnosed(place, changed_record=None, **options):
    problem = load(place).problem
    if changed_record is not None:
        problem = problem.with_recordings({n: changed_record(e.recording) for n, e in problem.experiments.items()})
    answer = fit(problem, budget=1000)
    return diagnose(answer.problem, answer.best.x, **options)


@pytest.mark.parametrize(
    ("plant", "fault", "signal"),
    [
        ("first", "dead_time", "u"),
        ("first", "sensor_high", "y"),
        ("second", "coulomb", "v"),
        pytest.param("motor", "drift", "y", marks=pytest.mark.slow),
        ("tanks", "lag", "u"),
    ],
)
@pytest.mark.further(1)
def test_a_planted_fault_is_named_with_its_size(plant, fault, signal, tmp_path):
    d = diagnosed(write(PLANTS[plant], fault, 0.02, 5, tmp_path))
    first = d.rounds[0].found
    assert [(t.extension.kind, t.extension.signal) for t in first] == [(fault, signal)]
    size = PLANTS[plant].faults[fault]
    value, error, later = first[0].value, first[0].standard_error, first[0].unseen_rmse
    assert value is not None
    assert error is not None
    assert later is not None
    assert abs(value - size) < 4 * error + 0.05 * size
    sentence = diagnosis_record(d)["verdict"][0]
    assert sentence["level"] == "warning"
    assert "likely missing" in sentence["sentence"]
    assert later[1] < 0.9 * later[0]


@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.further(1)
def test_a_clean_record_is_left_alone(seed, tmp_path):
    d = diagnosed(write(PLANTS["first"], "clean", 0.02, seed, tmp_path))
    assert not d.found
    said = diagnosis_record(d)["verdict"]
    assert [v["level"] for v in said] == ["good"]
    assert said[0]["figures"]["explained"] < 0.05
    assert not changed(d)


@pytest.mark.thorough
def test_coloured_noise_is_not_taken_for_a_fault(tmp_path):
    """A slow noise, as large as some faults, that nothing in the catalogue made."""

    def noisy(recording):
        rng = np.random.default_rng(3)
        noise = lfilter([1.0], [1.0, -0.95], rng.normal(size=len(recording)))
        y = recording["y"] + 0.1 * np.std(recording["y"]) * noise / np.std(noise)
        return Recording(
            recording.t, {**recording.signals, "y": Signal(y, recording.signals["y"].unit)}, recording.name
        )

    d = diagnosed(write(PLANTS["first"], "clean", 0.005, 0, tmp_path), noisy)
    assert not d.found


@pytest.mark.thorough
def test_outliers_are_named_and_do_not_hide_a_dead_time(tmp_path):
    def spiked(recording):
        y, rng = recording["y"].copy(), np.random.default_rng(0)
        at = rng.choice(len(y), 12, replace=False)
        y[at] += 3 * np.std(y)
        return Recording(
            recording.t, {**recording.signals, "y": Signal(y, recording.signals["y"].unit)}, recording.name
        )

    d = diagnosed(write(PLANTS["first"], "dead_time", 0.01, 1, tmp_path), spiked)
    assert d.outliers.named
    assert 10 <= d.outliers.counts["y"][0] <= 14
    assert d.found[0].extension.kind == "dead_time"
    assert "outliers" in diagnosis_record(d)["verdict"][0]["sentence"]


@pytest.mark.thorough
def test_two_faults_are_named_one_after_the_other_and_the_file_runs(tmp_path):
    place = write(PLANTS["first"], "dead_time", 0.01, 2, tmp_path)

    def drifting(recording):
        y = recording["y"] + 0.2 * recording.t
        return Recording(
            recording.t, {**recording.signals, "y": Signal(y, recording.signals["y"].unit)}, recording.name
        )

    study = load(place)
    d = diagnosed(place, drifting)
    assert {t.extension.kind for t in d.found} == {"dead_time", "drift"}
    assert d.exchanged == ()
    made = with_additions(study.text, study.path, changed(d))
    (tmp_path / "new.toml").write_text(made)
    problem = load(tmp_path / "new.toml").problem
    assert set(problem.space.names) == {"K", "tau", "dead_time_u", "drift_y"}


@pytest.mark.thorough
def test_what_a_linear_record_cannot_tell_apart_is_named_as_a_pair(tmp_path):
    """Before a linear plant at rest a lag of the input is a lag of the sensor."""
    plant = replace(PLANTS["first"], period=0.02, held=60, samples=900)
    d = diagnosed(write(plant, "lag", 0.03, 3, tmp_path))
    kinds = {t.extension.kind for t in d.rounds[0].found}
    assert kinds & {"lag", "sensor_lag"}
    if len(kinds) > 1:
        assert "cannot tell which" in diagnosis_record(d)["verdict"][0]["sentence"]


def test_one_addition_alone_can_be_asked_for(tmp_path):
    place = write(PLANTS["first"], "clean", 0.02, 1, tmp_path)
    d = diagnosed(place, only="backlash of u")
    assert [t.extension.name for t in d.rounds[0].trials] == ["backlash of u"]
    with pytest.raises(ModelError, match="dead time of u"):
        diagnosed(place, only="dead tme of u")


def test_effects_on_signals_are_their_closed_forms():
    t = np.arange(50) * 0.1
    u = np.where(t >= 1.0 - 1e-9, 2.0, 0.0)
    assert np.allclose(effects.late(t, u, 0.3, held=True), np.where(t >= 1.3 - 1e-9, 2.0, 0.0))
    assert effects.late(t, u, 0.25, held=True)[12] == pytest.approx(1.0)  # half of the interval
    lagged = effects.lagged(t, u, 0.5, held=True)
    a, b = t[20] - 1.0, t[21] - 1.0
    mean = 2.0 - 2.0 * 0.5 * (np.exp(-a / 0.5) - np.exp(-b / 0.5)) / 0.1
    assert lagged[20] == pytest.approx(mean)
    ramp = effects.behind(t, t[:, None], 0.5)[:, 0]
    assert np.allclose(ramp, t - 0.5 + 0.5 * np.exp(-t / 0.5))
    uneven = np.sort(np.r_[t, t[:-1] + 0.03])
    assert np.allclose(effects.behind(uneven, uneven[:, None], 0.5)[:, 0], uneven - 0.5 + 0.5 * np.exp(-uneven / 0.5))
    assert np.allclose(effects.played(np.array([0.0, 1.0, 2.0, 1.5, 0.0]), 0.6), [0.0, 0.4, 1.4, 1.4, 0.6])
    assert np.allclose(effects.dead_zone(np.array([-2.0, 0.3, 1.0]), 0.5), [-1.5, 0.0, 0.5])


@pytest.mark.thorough
def test_a_cause_that_the_catalogue_lacks_is_not_called_very_likely(tmp_path):
    """A tank that empties by the root of its level, fitted as a linear one: a dead zone of the inflow explains much,
    and is false."""
    draw = np.random.default_rng(5)
    period, n, level, levels = 0.5, 1200, 1.0, []
    inflow = np.repeat(draw.uniform(0.5, 3.0, n // 40), 40)
    for k in range(n):
        levels.append(level)
        for _ in range(20):
            level += period / 20 * (inflow[k] - 1.3 * np.sqrt(max(level, 0.0))) / 2.0
    measured = np.array(levels) + draw.normal(0.0, 0.02, n)
    record = Recording(np.arange(n) * period, {"q": Signal(inflow, "L/s"), "h": Signal(measured, "dm")}, "a")
    model = equations(
        "x' = a*q - b*x; h = x", inputs={"q": "L/s"}, states={"x": {"unit": "dm", "initial": "h"}}, outputs={"h": "dm"},
        parameters={"a": {"bounds": (0.001, 100.0), "unit": "dm/L"}, "b": {"bounds": (0.001, 10.0), "unit": "1/s"}},
    )  # fmt: skip
    answer = fit(Problem(model, record, split=0.6), budget=1000)
    said = " ".join(v["sentence"] for v in diagnosis_record(diagnose(answer.problem, answer.best.x))["verdict"])
    assert "something else is missing" in said
    assert "or it stands for something that is not among the additions" in said
    assert "very likely" not in said
