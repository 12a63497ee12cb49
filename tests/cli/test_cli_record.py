"""`plantfit record` as a user runs it: Ctrl-C, a full disk, ports that are none, boards that speak otherwise."""

import contextlib
import errno
import json
import os
import pty
import resource
import signal
import subprocess
import sys
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest
from cli_call import call

sys.path.append(str(Path(__file__).resolve().parents[1] / "rig"))
from firmware_host import build, read_truth, running

from plantfit.cli.terminal.live_plot import Traces, headline, sparkline
from plantfit.recording import Recording, Signal, read_csv, to_csv
from plantfit.recording.excitation import prbs
from plantfit.rig.board import link, recorder
from plantfit.rig.board.protocol import Board, Channel, Drive, Sample, encode
from plantfit.rig.board.recorded import Progress


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return build(tmp_path_factory.mktemp("firmware"))


@pytest.fixture
def serial_line():
    """A port that a test answers for: master to write to, name for the recorder."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_a_recording_from_excitation_to_table(capsys, monkeypatch, program, tmp_path):
    to_csv(prbs(6.0, 100, 1, hold=4, seed=1), tmp_path / "excite.csv")
    with running(program, "--watchdog", 3000) as port:
        said = call(
            capsys,
            monkeypatch,
            "record",
            "--port",
            port,
            "--excitation",
            tmp_path / "excite.csv",
            "--out",
            tmp_path / "run.csv",
            "--json",
        )
    assert said.code == 0, said.err
    told = json.loads(said.out)
    assert told["lost"] == 0
    assert told["stopped"] is True
    assert told["played"] == told["values"] == 100
    assert len(read_csv(tmp_path / "run.csv")) == told["samples"]
    said = call(capsys, monkeypatch, "init", tmp_path / "run.csv", "--json")
    # not the counter, not the gaps
    assert (json.loads(said.out)["input"], json.loads(said.out)["output"]) == ("V", "current")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_stops_the_motor_first(capsys, monkeypatch, program, tmp_path, number):
    to_csv(Recording(np.arange(600) / 10, {"V": Signal(np.full(600, 6.0), "V")}), tmp_path / "excite.csv")

    def press():
        until = time.monotonic() + 30
        while not (tmp_path / "run.csv.part").exists() and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(0.8)
        os.kill(os.getpid(), number)

    with running(
        program, "--truth", tmp_path / "truth", "--watchdog", 20000
    ) as port:  # the watchdog is too slow to help
        threading.Thread(target=press, daemon=True).start()
        words = ("--port", port, "--excitation", tmp_path / "excite.csv", "--out", tmp_path / "run.csv")
        said = call(capsys, monkeypatch, "record", *words)
    truth = read_truth(tmp_path / "truth")
    assert said.code == 130
    assert "Stopping the motor" in said.err
    assert "of 600 values" in said.err
    assert len(truth.drives) == 2  # on, off
    assert truth.drives[-1, 1] == 0
    assert len(read_csv(tmp_path / "run.csv")) == len(truth.samples)


def test_a_full_disk_stops_the_motor_and_keeps_what_came(capsys, monkeypatch, program, tmp_path):
    to_csv(Recording(np.arange(600) / 10, {"V": Signal(np.full(600, 6.0), "V")}), tmp_path / "excite.csv")
    words = ("--excitation", tmp_path / "excite.csv", "--out", tmp_path / "run.csv")
    with running(program, "--truth", tmp_path / "truth", "--watchdog", 20000) as port:
        old = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, old[1]))  # as a disk with 30 kB left
        try:
            said = call(capsys, monkeypatch, "record", "--port", port, *words)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert said.code == 3
    assert "could not be continued" in said.err
    assert said.err.count("\n") == 1
    assert read_truth(tmp_path / "truth").drives[-1, 1] == 0
    assert len(read_csv(tmp_path / "run.csv.part")) > 300


def said_by(capsys, monkeypatch, tmp_path, port, *words):
    monkeypatch.setattr(recorder, "GREET_SECONDS", 0.7)
    said = call(capsys, monkeypatch, "record", "--port", port, "--out", tmp_path / "run.csv", *words)
    assert said.err.count("\n") == 1
    assert not list(tmp_path.glob("run.csv*"))
    return said.code, said.err


def test_no_such_port(capsys, monkeypatch, tmp_path):
    code, err = said_by(capsys, monkeypatch, tmp_path, "/dev/ttyNOPE7")
    assert code == 13
    assert "There is no port /dev/ttyNOPE7" in err


def test_a_file_is_no_port(capsys, monkeypatch, tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    code, err = said_by(capsys, monkeypatch, tmp_path, tmp_path / "notes.txt")
    assert code == 13
    assert "is not a serial port" in err


def test_no_permission(capsys, monkeypatch, tmp_path, serial_line):
    import serial

    def refused(*args, **kwargs):
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refused)  # root, who runs tests in containers, is never refused
    code, err = said_by(capsys, monkeypatch, tmp_path, serial_line[1])
    assert code == 13
    assert "dialout" in err


def test_a_port_in_use(capsys, monkeypatch, tmp_path, serial_line):
    other = link.Link(serial_line[1], 115200)
    code, err = said_by(capsys, monkeypatch, tmp_path, serial_line[1])
    other.close()
    assert code == 13
    assert "in use by another program" in err


def test_a_silent_board(capsys, monkeypatch, tmp_path, serial_line):
    code, err = said_by(capsys, monkeypatch, tmp_path, serial_line[1])
    assert code == 13
    assert "does not answer" in err


def answering(master, text):
    """Write `text` to the recorder again and again until the returned function is called."""
    ended = threading.Event()

    def run():
        with contextlib.suppress(OSError):  # the fixture may close the line first
            while not ended.wait(0.02):
                os.write(master, text)
                os.read(master, 1)  # its greeting: keeps the terminal from filling

    os.set_blocking(master, True)
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return ended.set


def test_wrong_baud_is_garbage(capsys, monkeypatch, tmp_path, serial_line):
    noise = np.random.default_rng(1).integers(0, 256, 300, dtype=np.uint8).tobytes()
    stop = answering(serial_line[0], noise + b"\n")
    code, err = said_by(capsys, monkeypatch, tmp_path, serial_line[1], "--baud", "115200")
    stop()
    assert code == 13
    assert "no line of the protocol at 115200 baud" in err


def test_another_version(capsys, monkeypatch, tmp_path, serial_line):
    stop = answering(serial_line[0], encode("H", 2, "future", "whatever"))
    code, err = said_by(capsys, monkeypatch, tmp_path, serial_line[1])
    stop()
    assert code == 13
    assert "speaks version 2" in err


@pytest.mark.parametrize(
    ("ticks", "drive", "words"),
    [
        (0, ("V", "V", "0.05", 255), "0 ticks a second"),
        (1000, ("V", "V", "0", 255), "scale 0"),
        (1000, ("V", "zorkmid", "0.05", 255), "'zorkmid'"),
        (1000, ("motor voltage", "V", "0.05", 255), "a plain name"),
        (1000, ("V", "V", "much", 255), "which the protocol does not know"),
    ],
)
def test_a_board_that_declares_nonsense(capsys, monkeypatch, tmp_path, serial_line, ticks, drive, words):
    stop = answering(serial_line[0], encode("H", 1, "odd", "1", 7, ticks, 300, 512, 0) + encode("A", *drive))
    code, err = said_by(capsys, monkeypatch, tmp_path, serial_line[1])
    stop()
    assert code == 13
    assert words in err


@pytest.mark.parametrize("option", ["--rate", "--duration", "--baud"])
def test_numbers_that_cannot_be(capsys, monkeypatch, tmp_path, option):
    code, err = said_by(capsys, monkeypatch, tmp_path, "/dev/null", option, "0")
    assert code == 3
    assert "above 0" in err


def test_nothing_is_overwritten(capsys, monkeypatch, tmp_path):
    (tmp_path / "run.csv").write_text("precious")
    said = call(capsys, monkeypatch, "record", "--port", "/dev/null", "--out", tmp_path / "run.csv")
    assert said.code == 3
    assert "--force" in said.err
    assert (tmp_path / "run.csv").read_text() == "precious"
    said = call(capsys, monkeypatch, "record", "--port", "/dev/null", "--out", tmp_path / "nowhere" / "run.csv")
    assert "does not exist" in said.err


def test_pyserial_is_asked_for(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "serial", None)
    code, err = said_by(capsys, monkeypatch, tmp_path, "/dev/ttyUSB0")
    assert code == 11
    assert "plantfit[board]" in err


def test_sparklines_and_traces():
    assert sparkline([0.0, 7.0, float("nan"), 3.5]) == "▁█ ▅"
    assert sparkline([2.0, 2.0]) == "▄▄"
    board = Board("b", "1", 1, 1000, 0.3, 512, Drive("V", "V", 0.5, 255), (Channel("w", "rad/s", 2.0, 1.0),))
    traces = Traces()
    for k in range(1, 41):
        latest = (Sample(k, k, k, k, 1, (k,)),) if k != 20 else ()
        p = Progress(board, 0.25 * k, k, 0, 0, 0, k != 20, k, 80, latest)
        traces.add(p)
    first, second = traces.lines(board)
    assert first.endswith("20 V")  # 40 * 0.5
    assert second.endswith("81 rad/s")
    assert len(traces.slots) == 40
    assert None in traces.slots
    assert headline(p).startswith("10.0 s, 40 samples")  # pyrefly: ignore[unbound-name]  (the last of 40)
    assert "50 %" in headline(p)


def test_recording_loads_no_jax():
    code = "import sys, plantfit.cli.commands.bench.record, plantfit.rig.board; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=600).returncode == 0
