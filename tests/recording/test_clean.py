"""Cleaning steps against closed forms; study files and their page know every step."""

import inspect
import re
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError, UnitError
from plantfit.recording import Recording, Signal, clean
from plantfit.recording.clean.outliers import step_without
from plantfit.recording.clean.sampling import usual_period
from plantfit.spec.recordings import CLEANING

DT = 0.01
T = np.arange(2000) * DT
NAN = np.nan


def record(values, unit="rad", t=T):
    return rec.from_arrays(t, signals={"q": (values, unit)})


def test_the_usual_period_is_that_of_the_clock_before_its_times_were_rounded():
    """Of minutes with seven digits most steps are 10.0002 s, and of a binary clock each is what it is; gaps do not
    count."""
    minutes = np.array([float(f"{v:.7g}") for v in np.arange(400) / 6]) * 60
    assert np.median(np.diff(minutes)) != pytest.approx(10.0, rel=1e-6)
    assert usual_period(record(0 * minutes, t=minutes)) == 10.0
    binary = np.arange(300) / 8192
    assert usual_period(record(0 * binary, t=binary)) == 1 / 8192
    gaps = np.r_[np.arange(100) * 0.5, 80 + np.arange(100) * 0.5]
    assert usual_period(record(0 * gaps, t=gaps)) == 0.5
    board = np.round(np.arange(500) * 20.4) / 1000  # whole milliseconds
    assert usual_period(record(0 * board, t=board)) == pytest.approx(0.0204, rel=1e-3)


def test_outliers_found_and_nothing_else():
    values = np.sin(T)
    values[[5, 700, 1999]] += [3, -3, 3]
    r = rec.drop_outliers(record(values), "q")
    assert np.flatnonzero(np.isnan(r["q"])).tolist() == [5, 700, 1999]
    assert r.log[-1].startswith("3 outliers")


@pytest.mark.parametrize(("gain", "offset"), [(1e-6, 0.0), (1.0, 1e3), (-50.0, 7.0)])
def test_outliers_do_not_depend_on_scale_and_offset(gain, offset):
    values = np.random.default_rng(0).standard_normal(2000)
    values[::97] *= 20
    first, second = (
        np.isnan(rec.drop_outliers(record(v), "q", threshold=5)["q"]) for v in (values, gain * values + offset)
    )
    np.testing.assert_array_equal(first, second)
    assert first.any()


def test_quantised_signal_keeps_its_steps():
    values = np.round(np.sin(T) * 20) / 20
    assert not np.isnan(rec.drop_outliers(record(values), "q")["q"]).any()


def test_gaps():
    line = 3 * T[:12]
    broken = line.copy()
    broken[[0, 3, 4, 7, 8, 9, 11]] = NAN
    r = rec.fill_gaps(record(broken, t=T[:12]), "q", longest=0.03)
    assert np.flatnonzero(np.isnan(r["q"])).tolist() == [0, 7, 8, 9, 11]
    np.testing.assert_allclose(r["q"][1:7], line[1:7], atol=1e-15)
    assert r.log[-1].startswith("2 missing samples")
    assert rec.fill_gaps(record(broken, t=T[:12]), "q", 0.03, "previous")["q"][4] == line[2]


def test_all_missing_stays_missing():
    r = rec.from_arrays(T[:4], signals={"q": [1, NAN, NAN, NAN]})
    assert np.isnan(rec.fill_gaps(r, "q", 1.0)["q"][1:]).all()


@pytest.mark.parametrize(("frequency", "gain"), [(0.5, 1.0), (5.0, 0.5), (40.0, 0.0)])
def test_zero_phase_lowpass_gain(frequency, gain):
    wave = np.sin(2 * np.pi * frequency * T)
    r = rec.lowpass(record(wave), "q", cutoff=5.0)
    middle = slice(500, 1500)
    np.testing.assert_allclose(r["q"][middle], gain * wave[middle], atol=5e-3)


def test_causal_lowpass_starts_at_rest_and_does_not_look_ahead():
    step = np.where(T < 10, 2.0, 5.0)
    r = rec.lowpass(record(step), "q", cutoff=3.0, causal=True)
    np.testing.assert_allclose(r["q"][T < 10], 2.0, atol=1e-12)
    assert r["q"][-1] == pytest.approx(5.0, abs=1e-9)


@pytest.mark.parametrize(
    ("method", "settings", "tolerance"),
    [
        ("savgol", {}, 1e-5),
        ("central", {}, 2e-4),
        ("butterworth", {"cutoff": 20.0, "order": 2}, 2e-3),
        ("spline", {"smoothing": 1e-6}, 1e-3),
    ],
)
@pytest.mark.parametrize("shift", [0.0, 100.0])
def test_derivative_of_a_sine(method, settings, tolerance, shift):
    r = rec.differentiate(record(np.sin(2 * T) + shift, t=T + shift), "q", name="qd", method=method, **settings)
    np.testing.assert_allclose(r["qd"][20:-20], 2 * np.cos(2 * T)[20:-20], atol=tolerance)
    assert r.signals["qd"].unit == "rad/s"


def test_derivative_keeps_gaps():
    values = T**2
    values[1000:1010] = NAN
    r = rec.differentiate(record(values), "q")
    assert np.isnan(r["qd"][1000:1010]).all()
    np.testing.assert_allclose(r["qd"][:1000], 2 * T[:1000], atol=1e-9)


def test_resample_line_exactly_and_hold_inputs():
    t = np.array([0, 1, 2, 3, 4.0])
    r = rec.from_arrays(t, signals={"u": [0, 1, 0, 0, 2], "y": 2 * t})
    fine = rec.resample(r, 0.5, method={"u": "previous"})
    np.testing.assert_allclose(fine["y"], 2 * fine.t)
    np.testing.assert_array_equal(fine["u"], [0, 0, 1, 1, 0, 0, 0, 0, 2])


def test_resample_slower_does_not_alias():
    slow, fast = np.sin(2 * np.pi * 0.5 * T), np.sin(2 * np.pi * 9.5 * T)
    r = rec.resample(record(slow + fast), 0.1)
    inside = slice(20, -20)
    np.testing.assert_allclose(r["q"][inside], np.sin(2 * np.pi * 0.5 * r.t)[inside], atol=1e-2)
    np.testing.assert_allclose(rec.decimate(record(slow + fast), 10)["q"], r["q"], atol=1e-9)


def test_resample_invents_nothing_across_a_hole():
    t = np.concatenate([T[:50], T[150:200]])
    r = rec.resample(record(t, t=t), DT)
    assert np.isnan(r["q"][50:150]).all()
    assert np.isfinite(r["q"][:50]).all()
    assert np.isfinite(rec.resample(record(t, t=t), DT, longest=np.inf)["q"]).all()


def test_offsets_gains_units_and_time():
    r = record(5 + 3 * T, "deg")
    np.testing.assert_allclose(rec.detrend(r, "q", "linear")["q"], 0, atol=1e-9)
    assert abs(rec.detrend(r, "q")["q"].mean()) < 1e-12
    np.testing.assert_allclose(rec.subtract(r, "q", 5.0)["q"], 3 * T, atol=1e-12)
    assert rec.scale(r, "q", 2.0, "V").signals["q"].unit == "V"
    np.testing.assert_allclose(rec.convert_units(r, {"q": "rad"})["q"], np.deg2rad(5 + 3 * T))
    assert rec.shift_time(rec.cut(r, 1.0, 2.0)).t[0] == 0
    assert len(rec.cut(r, 1.0, 2.0)) == 101
    train, valid = rec.split(r, 0.7)
    assert (len(train), len(valid)) == (1400, 600)
    np.testing.assert_array_equal(np.concatenate([train["q"], valid["q"]]), r["q"])


def test_subtract_a_signal_in_another_unit():
    r = rec.from_arrays(T[:3], signals={"a": ([10, 20, 30.0], "degC"), "b": ([283.15, 283.15, 283.15], "K")})
    np.testing.assert_allclose(rec.subtract(r, "a", "b")["a"], [0, 10, 20], atol=1e-10)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (lambda r: rec.drop_outliers(r, "q", window=10), "odd"),
        (lambda r: rec.drop_outliers(r, "p"), "no signal 'p'"),
        (lambda r: rec.lowpass(r, "q", 50.0), "below half the sampling rate"),
        (lambda r: rec.lowpass(r, "q", -1.0), "above 0"),
        (lambda r: rec.fill_gaps(r, "q", 0), "above 0"),
        (lambda r: rec.differentiate(r, "q", method="butterworth"), "needs cutoff"),
        (lambda r: rec.differentiate(r, "q", name="q"), "already has"),
        (lambda r: rec.differentiate(r, "q", window=11, order=11), "order"),
        (lambda r: rec.resample(r, 0.1, "nearest"), "'linear' or 'previous'"),  # pyrefly: ignore[bad-argument-type]
        (lambda r: rec.resample(r, 1e-12), "longer period"),
        (lambda r: rec.decimate(r, 1), "at least 2"),
        (lambda r: rec.cut(r, 30, 40), "no samples"),
        (lambda r: rec.split(r, 1.5), "between 0 and 1"),
        (lambda r: rec.scale(r, "q", NAN), "finite"),
        (lambda r: rec.lowpass(rec.from_arrays([0, 1, 5.0], signals={"q": [1, 2, 3]}), "q", 0.1), "resample"),
    ],
)  # fmt: skip
def test_wrong_arguments(step, message):
    with pytest.raises(RecordingError, match=message):
        step(record(np.sin(T)))


def test_converting_an_unknown_unit():
    with pytest.raises(UnitError, match="no unit"):
        rec.convert_units(rec.from_arrays(T, signals={"q": T}), {"q": "V"})


def test_samples_are_dropped_by_their_times():
    t = 0.1 * np.arange(50)
    made = Recording(t, {"q": Signal(np.sin(t), "m")}, "r")
    dropped = rec.drop_samples(made, "q", [0.3, 2.51, 0.3])
    assert np.flatnonzero(np.isnan(dropped["q"])).tolist() == [3, 25]
    assert "2 samples of 'q' dropped by their times." in dropped.log[-1]
    wrong: list[Any] = [[], "abc", [np.nan]]
    for times in wrong:
        with pytest.raises(RecordingError, match="give times of samples in seconds"):
            rec.drop_samples(made, "q", times)
    with pytest.raises(RecordingError, match=r"no sample at 7 s; the recording has 0 to 4\.9 s"):
        rec.drop_samples(made, "q", [7.0])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("slope", [0.0, 30.0])
def test_the_step_that_is_proposed_takes_the_marked_samples_and_no_others(seed, slope):
    """On a slope a running median does not see spikes: they are named by their times."""
    rng, t = np.random.default_rng(seed), 0.05 * np.arange(600)
    values = np.sin(t) + 0.01 * rng.standard_normal(600) + slope * np.abs(np.sin(0.3 * t))
    marked = np.zeros(600, dtype=bool)
    marked[rng.choice(np.arange(5, 595), 12, replace=False)] = True
    values[marked] += rng.choice([-1.0, 1.0], 12) * (1.0 if slope else 3.0)
    step, taken = step_without("q", values, t, marked)
    assert taken == 12
    options = {k: v for k, v in step.items() if k not in ("step", "signal")}
    cleaned = getattr(rec, step["step"])(Recording(t, {"q": Signal(values, "m")}, "r"), "q", **options)
    np.testing.assert_array_equal(np.isnan(cleaned["q"]), marked)
    if slope:
        assert step["step"] == "drop_samples"


def test_of_many_marked_samples_it_is_the_nearest_step_and_says_how_many_it_takes():
    rng, t = np.random.default_rng(1), 0.05 * np.arange(9000)
    values = 30.0 * np.abs(np.sin(0.3 * t)) + 0.01 * rng.standard_normal(9000)
    marked = np.zeros(9000, dtype=bool)
    marked[::60] = True
    values[marked] += 1.0
    step, taken = step_without("q", values, t, marked)
    assert step["step"] == "drop_outliers"
    assert taken < 150


@pytest.mark.parametrize("factor", [3, 10, 100, 500])
def test_a_coarser_grid_keeps_a_line_up_to_both_ends(factor):
    t = np.arange(10_001) * 0.001
    made = rec.decimate(rec.from_arrays(t, signals={"x": 3.0 * t + 1.0}), factor)
    # of a step of the new grid
    np.testing.assert_allclose(made["x"], 3.0 * made.t + 1.0, rtol=0, atol=3.0 * 2e-3 * 0.001 * factor)


@pytest.mark.parametrize(("cutoff", "order"), [(0.2, 2), (1.0, 1), (1.0, 4), (20.0, 2)])
def test_a_zero_phase_lowpass_keeps_a_line_and_its_slope_up_to_both_ends(cutoff, order):
    t = np.arange(10_001) * 0.001
    r = rec.from_arrays(t, signals={"x": 3.0 * t + 1.0})
    np.testing.assert_allclose(rec.lowpass(r, "x", cutoff, order=order)["x"], r["x"], rtol=0, atol=2e-4 / cutoff)
    slope = rec.differentiate(r, "x", "v", method="butterworth", cutoff=cutoff, order=order)["v"]
    np.testing.assert_allclose(slope, 3.0, rtol=0, atol=5e-3)


def test_stretches_are_dropped():
    t = 0.1 * np.arange(50)
    made = Recording(t, {"q": Signal(np.sin(t), "m")}, "r")
    dropped = rec.drop_samples(made, "q", between=[[0.3, 0.5], [4.8, 9.0]])
    assert np.flatnonzero(np.isnan(dropped["q"])).tolist() == [3, 4, 5, 48, 49]
    assert "5 samples of 'q' dropped in 2 stretches of time." in dropped.log[-1]
    both = rec.drop_samples(made, "q", [1.0], [[0.3, 0.5]])
    assert np.flatnonzero(np.isnan(both["q"])).tolist() == [3, 4, 5, 10]
    wrong: list[Any] = [[[0.31, 0.32]], [[7.0, 8.0]], [0.3, 0.5], [["a", "b"]], [[0.5]]]
    for between in wrong:
        with pytest.raises(RecordingError, match=r"give pairs \[start, stop\] in seconds that hold samples"):
            rec.drop_samples(made, "q", between=between)


NO_STEPS = {
    "with_signal": "puts the values of a step into a recording",
    "with_new": "puts a new signal into a recording",
}
"""Functions from a recording to a recording that study files do not take, with the reason."""


def steps_of_code():
    """Names of public functions from a recording to one recording: those of `recording/clean/` and those that Python
    users call."""
    modules = [import_module(f"plantfit.recording.clean.{m.name}") for m in iter_modules(clean.__path__)]
    own = {
        n: f
        for m in modules
        for n, f in vars(m).items()
        if inspect.isfunction(f) and f.__module__ == m.__name__ and n[0] != "_"
    }
    functions = own | {n: f for n in rec.__all__ if inspect.isfunction(f := getattr(rec, n))}
    takes = {n: [p.annotation for p in inspect.signature(f).parameters.values()][:1] for n, f in functions.items()}
    return {
        n
        for n, f in functions.items()
        if takes[n] == [Recording] and inspect.signature(f).return_annotation is Recording
    }


def test_study_files_take_every_cleaning_step():
    steps = steps_of_code()
    assert len(steps) > 20
    missing = sorted(steps - set(CLEANING) - set(NO_STEPS))
    assert missing == [], (
        f"add {missing} to CLEANING in src/plantfit/spec/recordings.py, or to NO_STEPS here with the reason"
    )
    unknown = [name for name in CLEANING if name not in rec.__all__]
    assert unknown == [], f"add {unknown} to the three lists of src/plantfit/recording/__init__.py"


def test_the_page_on_recordings_has_a_row_for_every_cleaning_step():
    page = (Path(__file__).resolve().parents[2] / "docs" / "recordings.md").read_text("utf-8")
    rows = " ".join(
        re.findall(r"^\| (`[^|]*) \|", page.split("| step | what it does |")[1].split("\n\n")[0], re.MULTILINE)
    )
    missing = [name for name in CLEANING if not re.search(rf"`{name}[(`]", rows)]
    assert missing == [], f"add a row for {missing} to the table of steps in docs/recordings.md"
