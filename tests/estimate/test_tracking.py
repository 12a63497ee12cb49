"""A study's filter on line: a healthy plant stays quiet at the stated rate, a changed one is named, and rows come as
they are written."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
import wandering_plants as lag

import plantfit as pf
from plantfit.errors import RecordingError, SearchError
from plantfit.estimate.watch.causes import causes
from plantfit.estimate.watch.changes import Calibration, Changes
from plantfit.folders import code_folder
from plantfit.native import kept_programs
from plantfit.recording.readers.formats.text.growing import GrowingTable
from plantfit.tracking import Alarm

import jax

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def tracker():
    return pf.track(lag.problem(lag.record(31, 500)), false_alarm=0.01)


@pytest.mark.skipif(code_folder("programs") is None, reason="no cache folder, so that nothing is kept")
def test_another_tracker_of_the_same_study_compiles_nothing(tracker, monkeypatch):
    record = lag.record(400, 200)
    first = [dict(r) for r in fed(tracker, record).rows]
    made, before = [], kept_programs._made
    monkeypatch.setattr(kept_programs, "_made", lambda f, k, name, *a: made.append(name) or before(f, k, name, *a))
    again = pf.track(lag.problem(lag.record(31, 500)), false_alarm=0.01)
    assert fed(again, record).rows == first
    assert not [name for name in made if name.startswith("watch")]


def fed(tracker, recording, pieces=1):
    tracker.restart()
    for part in np.array_split(np.arange(len(recording)), pieces):
        signals = {n: pf.Signal(s.values[part], s.unit) for n, s in recording.signals.items()}
        tracker.feed(pf.Recording(recording.t[part], signals, recording.name))
    tracker.finish()
    return tracker


def quiet_test(alpha, runs, looks, seed, drift=0.0):
    """Share of runs in which scores drawn from their own law raise an alarm: d = 2, information of a real filter's
    size."""
    rng, count = np.random.default_rng(seed), 0
    information = np.array([[30.0, 10.0], [10.0, 20.0]])
    root = np.linalg.cholesky(information)
    known = np.array([[1.0, 0.3], [0.3, 1.0]])
    for _ in range(runs):
        test = Changes(known, np.array([True, True]), Calibration(np.ones(2), 1.0, 1.0, 1e6), alpha)
        error = np.linalg.cholesky(known) @ rng.standard_normal(2) + [drift, 0.0]
        for k in range(looks):
            scores = root @ rng.standard_normal(2) + information @ error
            if test.look(k, k + 1.0, scores, information, float(rng.chisquare(20)), 20) is not None:
                count += 1
                break
    return count / runs


def test_the_false_alarm_rate_is_the_stated_one_at_most():
    rate = quiet_test(0.2, 300, 60, 1)
    assert 0.01 < rate < 0.2 + 3 * np.sqrt(0.2 * 0.8 / 300)
    assert quiet_test(0.01, 300, 60, 2) <= 0.02
    assert quiet_test(0.01, 100, 60, 3, drift=6.0) > 0.9  # six standard errors of the study


def test_the_shares_of_all_looks_add_up_to_the_stated_rate():
    from plantfit.estimate.watch.changes import SUM

    n = np.arange(2.0, 2e6)
    rest = 1.0 / np.log(2e6)  # of the integral beyond
    assert np.sum(1 / (n * np.log(n) ** 2)) + rest == pytest.approx(SUM, abs=1e-4)


@pytest.mark.parametrize("seeds", [8, pytest.param(20, marks=pytest.mark.slow)])
def test_a_healthy_plant_raises_no_alarm_and_is_followed(tracker, seeds):
    count = 0
    for seed in range(seeds):
        count += bool(fed(tracker, lag.record(400 + seed, 1500, hold=(1, 15)[seed % 2])).alarms)
    assert count <= 1
    last = tracker.rows[-1]
    for name, value in lag.TRUTH.items():
        assert abs(last[name] - value) < 5 * last[f"{name}_sd"]
        assert 0 < last[f"{name}_sd"] < 0.2 * value
    assert 0.6 < np.mean([row["nis"] for row in tracker.rows]) < 1.5
    fed(tracker, lag.record(400, 1500))
    assert "No alarm" in tracker.sentence
    assert tracker.to_frame().height == len(tracker.rows) == 1500 // tracker.length


@pytest.mark.parametrize(("name", "factor"), [("K", 1.3), ("tau", 2.2), ("K", 0.7)])
def test_a_changed_parameter_is_seen_named_and_followed(tracker, name, factor):
    named, t = [], 500 * lag.PERIOD
    for seed in range(5):
        then = lag.TRUTH | {name: lag.TRUTH[name] * factor}
        done = fed(tracker, lag.record(600 + seed, 2500, then, after=500))
        assert done.alarms, seed
        alarm = done.alarms[0]
        assert alarm.t > t
        named.append(alarm.parameter)
        assert (alarm.to_value > alarm.from_value) == (factor > 1)
        assert f"{name} has left what the study knows" in alarm.sentence or alarm.parameter != name
        last = done.rows[-1]
        assert abs(last[name] - then[name]) < 5 * last[f"{name}_sd"]
    assert named.count(name) >= 4


def test_a_sensor_that_gets_worse_is_told_as_no_parameter(tracker):
    good, bad = lag.record(700, 1500), lag.record(700, 1500)
    y = bad["y"].copy()
    y[700:] += 0.3 * np.random.default_rng(1).standard_normal(800)
    done = fed(tracker, pf.Recording(good.t, {**good.signals, "y": pf.Signal(y, "K")}, "bad"))
    assert done.alarms[0].parameter is None
    assert "times as large as the study expects" in done.alarms[0].sentence
    assert done.alarms[0].t > 700 * lag.PERIOD
    assert done.alarms[0].told is None


def test_pieces_give_the_rows_of_the_whole(tracker):
    recording = lag.record(800, 307)
    whole = list(fed(tracker, recording).rows)
    parts = fed(tracker, recording, pieces=40).rows
    assert len(whole) == len(parts)
    for a, b in zip(whole, parts, strict=True):
        assert a == pytest.approx(b, rel=1e-12)


def test_the_tracked_states_are_those_of_the_filter_on_line(tracker):
    """Another way to the same numbers: `ekf(...).online()`, sample by sample, with the same prior, drift and noise."""
    from plantfit.estimate import Noise, ekf

    recording = lag.record(801, 200)
    done = fed(tracker, recording)
    f = tracker.filter
    noise = Noise(tracker.noise.process, tracker.noise.measurement, {"x": float(f.root[0, 0])})
    prior, drift = (dict(zip(["K", "tau"], v.tolist(), strict=True)) for v in (f.prior, f.drift))
    at = dict(zip(["K", "tau"], tracker.values.tolist(), strict=True))
    online = ekf(tracker.problem, noise, ["K", "tau"], at=at, prior=prior, drift=drift).online()
    for t, u, y in zip(recording.t, recording["u"], recording["y"], strict=True):
        now = online.update(float(t), {"u": float(u)}, {"y": float(y)})
    last = done.rows[-1]
    assert last["x"] == pytest.approx(now.states["x"], rel=1e-9)  # pyrefly: ignore[unbound-name]  (of the last sample)
    assert last["x_sd"] == pytest.approx(now.sd["x"], rel=1e-9)
    assert last["K"] == pytest.approx(now.parameters["K"], rel=1e-9)


def test_slopes_are_those_of_finite_differences(tracker):
    """What a parameter does to the innovations, against two filters held at other values."""
    recording = lag.record(802, tracker.length)
    t, u, y = tracker._arrays(recording)
    f = tracker.filter
    f.reset()
    block, before, program = f.run(t, u, y), f.values.copy(), f._advance
    for j in range(2):
        white = []
        for sign in (1, -1):
            f.values = before + sign * 1e-4 * f.axes[j]
            f.reset()
            f._advance = jax.jit(f._advanced)  # the one that is kept holds the values that it was made with
            white.append(f.run(t, u, y).white)
        # the whitening depends on the parameters too, but hardly: the prediction does
        differences = (white[0] - white[1]) / 2e-4
        f.values = before
        assert block.slopes[:, :, j] == pytest.approx(differences, abs=0.05 * np.max(np.abs(differences)))
    f._advance = program
    f.reset()


@pytest.fixture(scope="module")
def late():
    """A tracker of a plant with a dead time of 6.6 samples."""
    return pf.track(lag.problem(lag.record(41, 500, lag.LATE, before=lag.LATE), late=True), false_alarm=0.01)


@pytest.mark.parametrize("seeds", [4, pytest.param(10, marks=pytest.mark.slow)])
def test_a_plant_with_a_dead_time_is_tracked_and_the_dead_time_watched(late, seeds):
    assert late.watched == ["K", "tau", "L"]
    count = sum(bool(fed(late, lag.record(400 + s, 1000, lag.LATE, hold=(4, 15)[s % 2])).alarms) for s in range(seeds))
    assert count <= 1
    first = late.rows[0]["t"]
    # what came before is not known for one dead time
    assert first - late.length * lag.PERIOD == pytest.approx(0.3, abs=0.051)
    assert "L" not in late.rows[0]
    assert 0.6 < np.mean([row["nis"] for row in late.rows]) < 1.5
    # a step of the input five samples late is like a slower plant to a filter whose process noise forgets within a few
    # samples
    for name, change, told in (("L", 0.25, {"tau", "L"}), ("K", 0.6, {"K"})):
        then = lag.LATE | {name: lag.LATE[name] + change}
        alarms = [fed(late, lag.record(600 + s, 2000, then, after=500, before=lag.LATE)).alarms for s in range(3)]
        assert all(a and a[0].t > 500 * lag.PERIOD for a in alarms), name
        assert sum(a[0].parameter in told and a[0].to_value > a[0].from_value for a in alarms) >= 2


def test_slopes_by_a_dead_time_are_those_of_finite_differences(late):
    t, u, y = late._arrays(lag.record(42, late.length + 10, lag.LATE, hold=3))
    f = late.filter

    def run(by):
        f.rows.dead_times = dead + by
        f.reset()
        f.rows.remember(t[:10], u[:10])
        return f.run(t[10:], u[10:], y[10:])

    dead, place = f.rows.dead_times, late.watched.index("L")
    block, step = run(0.0), 1e-6
    differences = (run(step).white - run(-step).white) / (2 * step) * late.size[place]
    run(0.0)
    assert np.max(np.abs(differences)) > 0.1 * np.max(np.abs(block.slopes[:, :, 0]))
    assert block.slopes[:, :, place] == pytest.approx(differences, abs=1e-5 * np.max(np.abs(differences)))


def test_pieces_of_a_plant_with_a_dead_time_give_the_rows_of_the_whole(late):
    recording = lag.record(800, 307, lag.LATE)
    whole = list(fed(late, recording).rows)
    parts = fed(late, recording, pieces=60).rows
    assert len(whole) == len(parts)
    for a, b in zip(whole, parts, strict=True):
        assert a == pytest.approx(b, rel=1e-12)


def test_a_record_shorter_than_the_dead_time_has_no_rows(late):
    assert fed(late, lag.record(1, 5, lag.LATE)).rows == []
    assert "No alarm" in late.sentence


def test_what_cannot_be_tracked_is_told(tracker):
    tracker.restart()
    r = lag.record(1, 50)
    with pytest.raises(RecordingError, match=r"has none of the outputs \['y'\]"):
        tracker.feed(pf.Recording(r.t, {"u": r.signals["u"]}, "new"))
    nothing = pf.Signal(np.full(50, np.nan), "V")
    with pytest.raises(RecordingError, match=r"input 'u' has no value in any of its 50 rows"):
        tracker.feed(pf.Recording(r.t, {**r.signals, "u": nothing}, "new"))
    tracker.feed(r)
    with pytest.raises(RecordingError, match="came after one at"):
        tracker.feed(r)
    for wrong in (0.0, 1.0):
        with pytest.raises(SearchError, match="false_alarm"):
            pf.track(lag.problem(r), false_alarm=wrong)


def test_rows_without_an_input_hold_it_and_missing_outputs_are_skipped(tracker):
    recording = lag.record(803, 200)
    gap = recording["u"].copy()
    gap[100:104] = np.nan  # within a hold of 15 samples: nothing is lost but four measurements
    y = recording["y"].copy()
    y[100:104] = np.nan
    fed(tracker, pf.Recording(recording.t, {"u": pf.Signal(gap, "V"), "y": recording.signals["y"]}, "gap"))
    left = dict(tracker.rows[-1])
    assert "196 samples, 4 rows without an input left out" in tracker.sentence
    fed(tracker, pf.Recording(recording.t, {"u": recording.signals["u"], "y": pf.Signal(y, "K")}, "gap"))
    skipped = tracker.rows[-1]
    for name in ("x", "K", "tau", "K_sd"):
        # one step of five periods, or five with tangents of their own
        assert left[name] == pytest.approx(skipped[name], rel=1e-4)


# -- which parameter it was --------------------------------------------------------------------------

OVEN = {"K": 0.8, "tau": 240.0, "Td": 22.0, "T0": 21.0}
SAMPLE = 5.0


def oven_record(seed, n, then=None, after=0):
    """A heated chamber: power u in percent acts Td late, and heat goes to surroundings at T0; Euler in 50 steps a
    sample. `then` holds from sample `after` on."""
    rng = np.random.default_rng(seed)
    u, h = rng.uniform(0.0, 100.0, n // 60 + 1).repeat(60)[:n], SAMPLE / 50
    x = np.full(n, OVEN["T0"])
    for k in range(n - 1):
        p = OVEN if then is None or k < after else OVEN | then
        now = x[k]
        for j in range(50):
            late = u[max(int((k * SAMPLE + (j + 0.5) * h - p["Td"]) // SAMPLE), 0)]
            now += h * (p["K"] * late - (now - p["T0"])) / p["tau"]
        x[k + 1] = now
    return pf.from_arrays(
        period=SAMPLE,
        signals={"u": (u, "percent"), "T": (x + 0.1 * rng.standard_normal(n), "degC")},
        name="oven",
    )


@pytest.fixture(scope="module")
def oven():
    model = pf.equations(
        "T' = (K*delay(u, Td) - (T - T0))/tau",
        inputs={"u": "percent"},
        states={"T": {"unit": "degC", "initial": "T0"}},
        outputs={"T": "degC"},
        parameters={
            "K": {"bounds": (0.1, 10.0), "unit": "K/percent", "scale": "log"},
            "tau": {"bounds": (20.0, 2000.0), "unit": "s", "scale": "log"},
            "Td": {"bounds": (0.0, 100.0), "unit": "s"},
            "T0": {"bounds": (0.0, 50.0), "unit": "degC"},
        },
    )
    return pf.track(pf.Problem(model, oven_record(1, 720)))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("T0", 5.0),
        ("Td", -10.0),
        ("K", -0.3),
        ("tau", 80.0),
        *(pytest.param(*p, marks=pytest.mark.slow) for p in (("T0", -5.0), ("T0", 15.0), ("Td", 15.0), ("K", 0.08))),
    ],
)
def test_the_changed_parameter_is_told_from_the_others(oven, name, change):
    """A first block of a few samples shows a ramp, which each of the four makes: the alarm names all that explain it,
    and the samples that follow tell which it was."""
    alone = 0
    for seed in range(3):
        recording = oven_record(300 + seed, 560, {name: OVEN[name] + change}, 217 + 13 * seed)
        oven.restart()
        raised = oven.feed(recording)
        first, last = raised[0], oven.alarms[0]
        assert name in (first.parameter, *first.alike) or first.parameter is None
        assert name in (last.parameter, *last.alike)
        assert last.t == first.t > SAMPLE * (217 + 13 * seed)
        if first.alike:
            assert "the samples so far do not tell which" in first.sentence
            assert f"{first.alike[-1]} explains it" in first.sentence
        if last.alike:
            continue
        alone += 1
        assert f"{name} has left what the study knows" in last.sentence
        assert (last.to_value - last.from_value) / change == pytest.approx(1.0, abs=0.45)
        if first.alike:
            assert len(raised) == 2
            assert last.told > last.t
            assert f"; samples up to {last.told:.6g} s tell it" in last.sentence
    assert alone >= 2


def test_causes_that_explain_alike_are_all_named_and_others_are_not():
    rng = np.random.default_rng(2)
    n, times = 60, np.array([0.0, 20.0])
    ramp, wave = np.clip(np.arange(n) - 20.0, 0.0, None) / 40, np.sin(np.arange(n))
    shapes = np.stack([ramp, 1.02 * ramp, wave], axis=-1)
    slopes = np.stack([shapes * 0.7, shapes])[:, :, None, :]
    white = (-20.0 * ramp + 0.1 * rng.standard_normal(n))[:, None]
    room = np.full(3, -np.inf), np.full(3, np.inf)
    found = causes(white, slopes, times, [0, 1, 2], room, 1.0, 0.0)
    assert sorted(found.places) == [0, 1]
    assert found.clear
    # a parameter that cannot grow explains nothing
    assert causes(white, slopes, times, [0, 1, 2], (room[0], np.array([0.0, np.inf, np.inf])), 1.0, 0.0).places == (1,)
    noise = 5.0 * rng.standard_normal(n)[:, None]
    assert not causes(noise, slopes, times, [0, 1, 2], room, 1.0, 0.0).clear


# -- a file that grows ------------------------------------------------------------------------------


class Pipe:
    """What has been written since the last look."""

    def __init__(self):
        self.bytes = b""

    def read(self):
        now, self.bytes = self.bytes, b""
        return now


def grown(text, cuts, read=pf.read_csv):
    """Recordings of a text that comes in pieces."""
    pipe = Pipe()
    table, found, at = GrowingTable(pipe, read), [], 0
    for cut in [*cuts, len(text)]:
        pipe.bytes, at = text[at:cut].encode(), cut
        found.append(table.poll())
    found.append(table.poll(last=True))
    return [f for f in found if f is not None]


@pytest.mark.parametrize("seed", range(4))
def test_rows_in_pieces_are_the_rows_of_the_file(tmp_path, seed):
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(300) + 0.02 * rng.random(300)
    header = ["t [s],u [V]\n", "# a logger\nt [s],u [V]\n", "t [s];u [V]\n", "time,u [V]\n"][seed]
    mark, comma = ("," if seed != 2 else ";"), ("." if seed != 2 else ",")
    rows = [f"{a:.4f}{mark}{b:.5f}\n".replace(".", comma) for a, b in zip(t, rng.standard_normal(300), strict=True)]
    if seed == 3:  # clock times, which the reader counts from the first row
        rows = [f"2026-03-01T10:{int(a // 60):02d}:{a % 60:07.4f},{k}\n" for k, a in enumerate(t)]
    text = header + "".join(rows)
    (tmp_path / "whole.csv").write_text(text)
    whole = pf.read_csv(tmp_path / "whole.csv")
    parts = grown(text.rstrip("\n"), sorted(rng.integers(0, len(text), 12)))
    assert len(parts) > 3
    assert np.concatenate([p.t for p in parts]) == pytest.approx(whole.t, abs=1e-6)
    assert np.array_equal(np.concatenate([p["u"] for p in parts]), whole["u"])


def test_a_time_that_goes_back_and_a_row_that_is_none_are_told():
    head = "t,u\n" + "".join(f"{k},{k}\n" for k in range(20))
    with pytest.raises(RecordingError):
        grown(head + "3,1\n4,1\n", [len(head)])
    with pytest.raises(RecordingError):
        grown(head + "20,broken\n21,1\n", [len(head)])


def test_a_file_is_followed_while_it_is_written(tmp_path, tracker):
    from plantfit.cli.commands.bench.track import _File, _grown

    recording, file = lag.record(900, 240), tmp_path / "new.csv"
    lag.save(recording, tmp_path / "whole.csv")
    lines = (tmp_path / "whole.csv").read_text().splitlines(keepends=True)
    file.write_text(lines[0])

    def write():
        with Path(file).open("a") as f:
            for k in range(1, len(lines), 40):
                f.write("".join(lines[k : k + 40]))
                f.flush()
                time.sleep(0.05)

    writer = threading.Thread(target=write)
    writer.start()
    with file.open("rb") as stream:
        parts = list(_grown(_File(stream), pf.read_csv, "new", 2.0, lambda: False))
    writer.join()
    assert np.concatenate([p.t for p in parts]) == pytest.approx(recording.t, abs=1e-8)
    tracker.restart()
    for p in parts:
        tracker.feed(p)
    tracker.finish()
    in_pieces = list(tracker.rows)
    whole = fed(tracker, pf.read_csv(tmp_path / "whole.csv")).rows
    assert [r["t"] for r in in_pieces] == pytest.approx([r["t"] for r in whole])
    assert in_pieces[-1]["K"] == pytest.approx(whole[-1]["K"], rel=1e-9)


def test_the_file_of_a_running_recorder_is_followed_over_gaps(tmp_path, tracker):
    """What `plantfit record` writes: OUT.part with a log above the header, empty rows where samples were lost, a new
    name at the end."""
    from plantfit.cli.commands.bench.track import _source
    from plantfit.rig.board.part_file import PartFile, part_of

    recording = lag.record(901, 200)
    cells = zip(recording.t, recording["u"], recording["y"], strict=True)
    rows = [f"{t:.6f},{u:.10g},{y:.10g},{k},0" for k, (t, u, y) in enumerate(cells)]
    for k in (120, 121):
        rows[k] = f"{recording.t[k]:.6f},,,,1"
    out = tmp_path / "run.csv"
    part = PartFile(out, "t [s],u [V],y [K],counter,gap", ["Recorded from board 'bench'."])

    def write():
        for k in range(0, 200, 50):
            part.add(rows[k : k + 50])
            time.sleep(0.3)
        part.finish(["Recorded."])

    while not part_of(out).exists():
        time.sleep(0.01)
    writer = threading.Thread(target=write)
    writer.start()
    tracker.restart()
    for piece in _source(str(part_of(out)), pf.read_csv, True, 2.5, lambda: False):
        tracker.feed(piece)
    tracker.finish()
    writer.join()
    assert "198 samples, 2 rows without an input left out" in tracker.sentence
    assert out.exists()
    live = dict(tracker.rows[-1])
    assert live == pytest.approx(fed(tracker, pf.read_csv(out)).rows[-1], rel=1e-9)


@pytest.mark.parametrize(("unit", "told"), [("degC", "about 26 degC in place of 21 degC ("), ("s", "21 s, +24 % (")])
def test_a_change_is_a_share_of_what_has_a_zero(unit, told):
    alarm = Alarm(1100.0, 1000.0, "x", unit, 21.0, 26.0, (), 3.0, 1e-9, 1e-4)
    assert told in alarm.sentence
