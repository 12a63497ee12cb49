"""The recorder against the host-compiled firmware over pseudo-terminals, held to the firmware's own log of truth."""

import time
from itertools import pairwise

import numpy as np
import pytest
from faulty_line import FaultyLine
from firmware_host import SCALE, build, read_truth, running

from plantfit.errors import BoardError, RecordingError
from plantfit.recording import Recording, Signal, differentiate, fill_gaps, read_csv
from plantfit.recording.excitation import prbs, staircase
from plantfit.rig.board import record

WATCHDOG = 0.3


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return build(tmp_path_factory.mktemp("firmware"))


def held_to_truth(csv, truth):
    """Every row is a sample as the board made it or is marked; returns the share that came."""
    got = read_csv(csv)
    counter, gap = got["counter"].astype(int), got["gap"].astype(int)
    np.testing.assert_array_equal(np.diff(counter), 1)  # no sample is passed over without a row
    made = {int(s[0]): s for s in truth.samples}
    names = ["V", "angle", "pulse_period", "current"]
    values = np.stack([got[n] for n in names], axis=1)
    assert np.all(np.isnan(values[gap == 1]))
    true = np.array([made[c] for c in counter[gap == 0]])
    np.testing.assert_allclose(values[gap == 0], true[:, [2, 5, 6, 7]] * SCALE, rtol=1e-9)
    np.testing.assert_allclose(np.diff(got.t[gap == 0]), np.diff(true[:, 1]) * 1e-6, atol=1.1e-6)
    assert np.all(np.diff(got.t) > 0)
    return got, float(np.mean(gap == 0))


def played_in_order(truth, excitation, hold):
    """What the motor got is the excitation: every value in its turn; those around an interruption may come twice."""
    raw = np.rint(excitation["V"] / SCALE[0]).astype(int)
    playing = truth.samples[truth.samples[:, 3] >= 0]
    np.testing.assert_array_equal(playing[:, 2], raw[playing[:, 3]])
    assert np.all(truth.samples[truth.samples[:, 3] < 0, 2] == 0)
    assert set(playing[:, 3]) == set(range(len(raw)))
    index, times = np.unique(playing[:, 3], return_counts=True)
    return np.mean(times[index < len(raw)] == hold)


def test_a_clean_line_loses_nothing(program, tmp_path):
    excitation = prbs(8.0, 100, 1.5, hold=4, seed=1)
    with running(program, "--truth", tmp_path / "truth", "--watchdog", 2000) as port:
        seen = []
        told = record(port, tmp_path / "run.csv", excitation, watch=seen.append)
    truth = read_truth(tmp_path / "truth")
    got, share = held_to_truth(tmp_path / "run.csv", truth)
    assert share == 1.0
    assert told.samples == len(got) == len(truth.samples)
    assert told.complete
    assert told.stopped
    assert (told.lost, told.garbled, told.starved, told.watchdogs) == (0, 0, 0, 0)
    assert played_in_order(truth, excitation, 10) == 1.0
    assert not (tmp_path / "run.csv.part").exists()
    assert any("acknowledged the stop" in line for line in got.log)
    assert sum(len(p.latest) for p in seen) > 0


def test_the_simulated_motor_obeys_its_equations(program, tmp_path):
    """Steady speed and current against V = R i + K w, K i = C w + Tf, from the encoder's slope and from its period."""
    excitation = staircase(9.0, 10, 3.5, steps=2, both_signs=False)
    with running(program, "--watchdog", 2000) as port:
        record(port, tmp_path / "run.csv", excitation)
    r = read_csv(tmp_path / "run.csv")
    R, K, C, Tf = 2.8, 0.025, 1.2e-5, 4e-3
    edges = np.flatnonzero(np.diff(r["V"])) + 1
    for start, stop in list(pairwise(edges))[:3]:
        V = 0.98 * r["V"][start]
        w = (K * V / R - Tf) / (C + K * K / R)
        late = slice(stop - 100, stop)  # six time constants J R/K^2 after the step
        slope = np.polyfit(r.t[late], r["angle"][late], 1)[0]
        assert slope == pytest.approx(w, rel=0.01)
        assert 2 * np.pi / 500 / (np.median(r["pulse_period"][late]) * 1e-6) == pytest.approx(w, rel=0.02)  # 1 us of 83
        assert np.mean(r["current"][late]) == pytest.approx((V - K * slope) / R, abs=3e-3)


def test_a_recording_gives_the_motor_back(program, tmp_path):
    """R and K from V = R i + K w, by least squares over what was recorded, the first milliseconds after a step left
    out."""
    with running(program, "--watchdog", 2000) as port:
        record(port, tmp_path / "run.csv", prbs(9.0, 100, 2, hold=8, seed=5))
    r = differentiate(read_csv(tmp_path / "run.csv"), "angle", "w")
    V = 0.98 * np.roll(r["V"], 1)  # held while the sample's current flowed
    changed = np.flatnonzero(np.diff(V))
    settled = np.ones(len(V), dtype=bool)
    for k in changed:
        settled[max(0, k - 10) : k + 15] = False
    settled &= np.isfinite(r["w"]) & (V != 0)
    R, K = np.linalg.lstsq(np.stack([r["current"], r["w"]], axis=1)[settled], V[settled], rcond=None)[0]
    assert pytest.approx(2.8, rel=0.02) == R
    assert pytest.approx(0.025, rel=0.02) == K


def faulty(program, folder, excitation, *, flip, drop, events):
    with running(program, "--truth", folder / "truth", "--watchdog", int(1000 * WATCHDOG)) as board:
        line = FaultyLine(board, folder / "port", seed=3, flip=flip, drop=drop, events=events)
        try:
            began = time.process_time()
            told = record(str(folder / "port"), folder / "run.csv", excitation)
            seconds = time.process_time() - began
        finally:
            line.close()
        time.sleep(0.05)
    return told, line, read_truth(folder / "truth"), seconds


def stops_of(truth):
    """Lengths in s of the stretches in which the watchdog held the motor."""
    barked = truth.samples[:, 4] == 3
    assert np.all(truth.samples[barked, 2] == 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], barked, [False]]).astype(int))).reshape(-1, 2)
    return [(truth.samples[b - 1, 1] - truth.samples[a, 1]) * 1e-6 for a, b in edges]


def test_faults_never_make_a_wrong_sample(program, tmp_path):
    excitation = prbs(8.0, 100, 2.5, hold=5, seed=2)
    events = [(0.8, "stall", 0.9), (2.6, "unplug", 0.9)]
    told, line, truth, _ = faulty(program, tmp_path, excitation, flip=1.5e-4, drop=1.5e-4, events=events)
    assert line.flipped > 5
    assert line.dropped > 5
    got, share = held_to_truth(tmp_path / "run.csv", truth)
    assert told.lost == np.sum(got["gap"] == 1) > 0
    assert share > 0.5
    assert told.garbled > 5
    assert told.reconnects >= 2
    assert told.complete
    assert told.stopped
    assert told.watchdogs >= 2
    assert sum(s > 0.9 - WATCHDOG - 0.15 for s in stops_of(truth)) >= 2  # both times the motor stood until we were back
    assert truth.drives[-1, 1] == 0
    played_in_order(truth, excitation, 10)


@pytest.mark.slow
def test_a_minute_of_faults(program, tmp_path):
    excitation = prbs(8.0, 100, 60, hold=5, seed=2)
    events = [(10, "stall", 2.0), (20, "unplug", 3.0), (35, "stall", 0.25), (45, "unplug", 0.2)]
    told, line, truth, seconds = faulty(program, tmp_path, excitation, flip=1e-4, drop=1e-4, events=events)
    got, share = held_to_truth(tmp_path / "run.csv", truth)
    print(
        f"\n{told.samples} samples came, {told.lost} lost in {told.gaps} gaps ({100 * (1 - share):.2f} "
        f"%), {told.garbled} garbled here, {told.refused} on the board; {line.flipped} bits flipped, "
        f"{line.dropped} bytes dropped; {told.reconnects} reconnects, {told.watchdogs} watchdog stops, "
        f"{told.starved} starved; recorder {seconds:.1f} s of processor in {told.seconds:.0f} s"
    )
    assert told.samples > 55_000
    assert line.flipped > 150
    assert line.dropped > 150
    assert told.lost == np.sum(got["gap"] == 1)
    assert told.complete
    assert told.stopped
    assert told.reconnects >= 3
    assert sum(s > 2.0 - WATCHDOG - 0.2 for s in stops_of(truth)) >= 2
    assert truth.drives[-1, 1] == 0
    played_in_order(truth, excitation, 10)


def test_a_silent_machine_stops_the_motor(program, tmp_path):
    """Without the recorder the board stops by itself, and says so when the recording goes on."""
    excitation = Recording(np.arange(40) / 10, {"V": Signal(np.full(40, 6.0), "V")}, "constant")
    slept = []

    def sleepy(progress):
        if progress.played > 2 and not slept:
            slept.append(time.monotonic())
            time.sleep(0.9)

    def enough():
        return bool(slept) and time.monotonic() > slept[0] + 1.3

    with running(program, "--truth", tmp_path / "truth", "--watchdog", 300) as port:
        told = record(port, tmp_path / "run.csv", excitation, watch=sleepy, stopping=enough)
    truth = read_truth(tmp_path / "truth")
    assert told.watchdogs >= 1
    assert max(stops_of(truth)) > 0.9 - 0.3 - 0.15
    assert not told.complete
    assert truth.drives[-1, 1] == 0


def test_stopping_stops_the_motor_first(program, tmp_path):
    excitation = Recording(np.arange(100) / 10, {"V": Signal(np.full(100, 6.0), "V")}, "constant")
    until = time.monotonic() + 1.2
    with running(
        program, "--truth", tmp_path / "truth", "--watchdog", 5000
    ) as port:  # the watchdog is too slow to help
        told = record(port, tmp_path / "run.csv", excitation, stopping=lambda: time.monotonic() > until)
    truth = read_truth(tmp_path / "truth")
    assert told.stopped
    assert told.watchdogs == 0
    assert truth.drives[-1, 1] == 0
    assert truth.drives[-1, 0] <= truth.samples[-1, 1] + 50_000
    held_to_truth(tmp_path / "run.csv", truth)


def test_a_bug_in_the_caller_still_stops_the_motor_and_keeps_the_file(program, tmp_path):
    def broken(progress):
        if progress.samples > 300:
            raise ZeroDivisionError

    with running(program, "--truth", tmp_path / "truth", "--watchdog", 5000) as port:
        with pytest.raises(ZeroDivisionError):
            record(port, tmp_path / "run.csv", prbs(8.0, 100, 20, seed=1), watch=broken)
        time.sleep(0.05)
    truth = read_truth(tmp_path / "truth")
    assert truth.drives[-1, 1] == 0
    _, share = held_to_truth(tmp_path / "run.csv", truth)
    assert share > 0.9


def test_recording_without_an_excitation(program, tmp_path):
    with running(program) as port:
        told = record(port, tmp_path / "run.csv", duration=0.4, rate=200)
    r = read_csv(tmp_path / "run.csv")
    assert told.values == 0
    assert told.complete
    assert np.all(r["V"] == 0)
    np.testing.assert_allclose(np.diff(r.t), 0.005, atol=1e-9)


def test_samples_are_on_disk_within_a_second(program, tmp_path):
    seen = []

    def look(progress):
        now, part = time.monotonic(), tmp_path / "run.csv.part"  # before the look: a stalled machine is no fault
        size = part.read_bytes().count(b"\n") if part.exists() else 0
        seen.append((now, progress.samples, size))

    with running(program, "--watchdog", 3000) as port:
        record(port, tmp_path / "run.csv", duration=2.2, watch=look)
    for now, _, lines in seen:
        old = [samples for then, samples, _ in seen if then < now - 1.0]
        assert not old or lines > old[-1]
    assert any(now - seen[0][0] > 1.2 for now, _, _ in seen)


def test_a_board_that_is_reset_goes_on_after_a_marked_gap(program, tmp_path):
    link = tmp_path / "port"
    first = running(program, "--link", link, "--truth", tmp_path / "one")
    first.__enter__()
    second = []

    def swap(progress):
        if progress.samples > 500 and not second:
            first.__exit__(None, None, None)
            second.append(running(program, "--link", link, "--truth", tmp_path / "two"))
            second[0].__enter__()

    try:
        told = record(str(link), tmp_path / "run.csv", prbs(8.0, 100, 1.5, hold=5, seed=2), watch=swap)
    finally:
        second[0].__exit__(None, None, None)
    r = read_csv(tmp_path / "run.csv")
    assert told.resets == 1
    assert told.complete
    assert np.all(np.diff(r.t) > 0)
    gaps = np.flatnonzero(r["gap"] == 1)
    jump = gaps[np.argmax(np.diff(r.t)[gaps])]
    made = [{int(s[0]): s[2] * SCALE[0] for s in read_truth(tmp_path / n).samples} for n in ("one", "two")]
    for k in np.flatnonzero(r["gap"] == 0):
        assert r["V"][k] == pytest.approx(made[int(k > jump)][int(r["counter"][k])], rel=1e-9)
    assert fill_gaps(r, "V", 10.0, "previous")["V"].shape == r.t.shape


def test_a_board_that_stays_away_ends_the_recording(program, tmp_path):
    link = tmp_path / "port"
    board = running(program, "--link", link)
    board.__enter__()
    gone = []

    def pull(progress):
        if progress.samples > 300 and not gone:
            gone.append(board.__exit__(None, None, None))

    with pytest.raises(BoardError, match=r"did not come back within 0\.6 s.*run\.csv"):
        record(str(link), tmp_path / "run.csv", prbs(8.0, 100, 5, seed=1), watch=pull, reconnect=0.6)
    assert len(read_csv(tmp_path / "run.csv")) > 300


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: {"excitation": prbs(13.0, 100, 1)}, r"13 V at 0 s.*up to 12 V|up to 12 V"),
        (lambda: {"excitation": prbs(6.0, 300, 1)}, "whole number of samples"),
        (lambda: {"rate": 300}, "1000 divided by a whole number"),
        (lambda: {"baud": 115200}, "--rate up to"),
    ],
)
def test_what_the_board_cannot_do_is_refused_before_it_moves(program, tmp_path, make, words):
    with (
        running(program, "--truth", tmp_path / "truth") as port,
        pytest.raises((BoardError, RecordingError), match=words),
    ):
        record(port, tmp_path / "run.csv", **make())
    assert (tmp_path / "truth").read_text() == ""
    assert list(tmp_path.iterdir()) == [tmp_path / "truth"]
