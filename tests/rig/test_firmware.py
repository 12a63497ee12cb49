"""The firmware by its protocol alone: checksums, commands that are wrong or repeated, noise; and compiled for real
boards."""

import contextlib
import os
import select
import shutil
import subprocess
import time
import tty

import numpy as np
import pytest
from firmware_host import FIRMWARE, build, read_truth, running

from plantfit.recording import read_csv
from plantfit.recording.excitation import prbs
from plantfit.rig.board import record
from plantfit.rig.board.protocol import Lines, decode, encode


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return build(tmp_path_factory.mktemp("firmware"))


class Host:
    """A bare conversation with a board."""

    def __init__(self, port):
        self.fd = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.fd)
        self.lines, self.waiting = Lines(), []

    def say(self, *fields):
        self.write(encode(*fields))

    def write(self, data, seconds=10.0):
        """All of it, taking in what the board says meanwhile: on a busy machine a pseudo terminal is full for a
        while."""
        until = time.monotonic() + seconds
        while data:
            assert time.monotonic() < until, f"{len(data)} bytes could not be written within {seconds} s"
            readable, writable, _ = select.select([self.fd], [self.fd], [], 0.1)
            with contextlib.suppress(BlockingIOError):
                if readable:
                    self.waiting += self.lines.feed(os.read(self.fd, 4096))
                if writable:
                    data = data[os.write(self.fd, data) :]

    def hear(self, kinds, seconds=3.0):
        """The next line whose first field is one of `kinds`."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            while self.waiting:
                fields = self.waiting.pop(0)
                if fields[0] in kinds:
                    return fields
            time.sleep(0.002)
            with contextlib.suppress(BlockingIOError):
                self.waiting += self.lines.feed(os.read(self.fd, 4096))
        raise AssertionError(f"no {kinds} within {seconds} s")


@pytest.fixture
def board(program, tmp_path):
    with running(program, "--truth", tmp_path / "truth", "--watchdog", 1000) as port:
        host = Host(port)
        yield host
        os.close(host.fd)


def test_checksums_are_crc32():
    assert encode("123456789") == b"123456789*CBF43926\n"  # the check value of CRC-32/ISO-HDLC
    assert decode(b"123456789*CBF43926") == ["123456789"]
    for k in range(18):
        for bit in range(8):
            line = bytearray(b"123456789*CBF43926")
            line[k] ^= 1 << bit
            assert decode(bytes(line)) is None


def test_hello_says_what_the_board_is(board):
    board.say("H", 1)
    told = [board.hear("HAC") for _ in range(5)]
    assert told[0][:3] == ["H", "1", "simulated motor"]
    assert told[0][5:] == ["1000", "1000", "512", "3"]
    assert told[1] == ["A", "V", "V", "0.0470588235294", "255"]
    assert [c[1:4] for c in told[2:]] == [["0", "angle", "rad"], ["1", "pulse_period", "us"], ["2", "current", "A"]]


def test_another_version_is_told(board):
    board.say("H", 7)
    assert board.hear("EH") == ["E", "protocol version"]
    assert board.hear("H")[1] == "1"


@pytest.mark.parametrize(
    "fields",
    [("S", 1, 0, 1, 5, 0), ("S", 1, 1, 0, 5, 0), ("S", 1, 1, 1, 5, 6), ("S", 1), ("S", -1, 1, 1, 1, 0), ("Q",)],
)
def test_wrong_commands_are_refused(board, fields):
    board.say(*fields)
    assert board.hear("EK")[0] == "E"


def test_values_are_played_once_within_the_limit(board, tmp_path):
    board.say("S", 5, 1, 3, 4, 0)
    first = board.hear("K")
    assert first[:3] == ["K", "S", "5"]
    board.say("S", 5, 1, 3, 4, 0)  # repeated: only acknowledged
    assert board.hear("K")[:3] == ["K", "S", "5"]
    board.say("U", 5, 1, 7, 7)  # out of turn
    assert board.hear("K") == ["K", "U", "5", "0"]
    board.say("U", 4, 0, 9, 9)  # of another session
    board.say("U", 5, 0, 10, 300, -300)
    assert board.hear("K") == ["K", "U", "5", "3"]
    board.say("U", 5, 1, 99, 99, 40)  # overlaps: only the new one counts
    assert board.hear("K") == ["K", "U", "5", "4"]
    while board.hear("D")[5] != "2":
        board.say("W")
    board.say("X", 5)
    assert board.hear("K")[:3] == ["K", "X", "5"]
    time.sleep(0.05)


def test_what_was_played(program, tmp_path):
    with running(program, "--truth", tmp_path / "truth", "--watchdog", 1000) as port:
        host = Host(port)
        test_values_are_played_once_within_the_limit(host, tmp_path)
        os.close(host.fd)
    truth = read_truth(tmp_path / "truth")
    playing = truth.samples[truth.samples[:, 4] == 1]
    np.testing.assert_array_equal(playing[:, 2], np.repeat([10, 255, -255, 40], 3))
    np.testing.assert_array_equal(playing[:, 3], np.repeat([0, 1, 2, 3], 3))
    np.testing.assert_array_equal(truth.drives[:, 1], [10, 255, -255, 40, 0])


def test_noise_never_moves_the_motor(program, tmp_path):
    rng = np.random.default_rng(5)
    with running(program, "--truth", tmp_path / "truth") as port:
        host = Host(port)
        for _ in range(40):
            host.write(rng.integers(0, 256, 2000, dtype=np.uint8).tobytes())
            line = bytearray(encode("S", 1, 1, 1, 1, 0) + encode("U", 1, 0, 255))
            line[int(rng.integers(0, len(line)))] ^= 1 << int(rng.integers(0, 8))  # one of the two is always garbled
            host.write(b"\n" + bytes(line))
            time.sleep(0.002)
            host.write(b"\n" + encode("X", 1))
        host.say("H", 1)
        assert host.hear("H")[1] == "1"  # alive
        host.say("S", 2, 1, 1, 1, 0)
        host.say("U", 2, 0, 255)
        while host.hear("D")[5] != "2":
            pass
        os.close(host.fd)
    assert list(read_truth(tmp_path / "truth").drives[:, 1]) == [255, 0]  # the good lines at the end and nothing before


@pytest.mark.parametrize("target", ["stm32", "arduino"])
def test_boards_compile(target, tmp_path):
    compiler = {"stm32": "arm-none-eabi-gcc", "arduino": "avr-g++"}[target]
    if shutil.which(compiler) is None or (
        target == "arduino" and not os.path.isdir("/usr/share/arduino/hardware/arduino/avr")
    ):
        pytest.skip(f"{compiler} or its core is not on this machine: the firmware for {target} is not compiled")
    done = subprocess.run(
        ["make", "-C", FIRMWARE, target, f"BUILD={tmp_path}"], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_arduino_program_records_on_a_simulated_processor(tmp_path):
    """The Uno's own binary in real time: every sample of 200 a second comes, and the PWM register follows the
    excitation."""
    if shutil.which("avr-g++") is None or not os.path.isdir("/usr/include/simavr"):
        pytest.skip("avr-g++ or simavr is not on this machine: the Arduino's program is not run")
    subprocess.run(
        ["make", "-C", FIRMWARE, "simavr", f"BUILD={tmp_path}"], check=True, capture_output=True, timeout=200
    )
    excitation = prbs(8.0, 50, 4, hold=4, seed=1)
    with running(tmp_path / "uno_simavr", tmp_path / "uno.elf", tmp_path / "truth") as port:
        told = record(port, tmp_path / "run.csv", excitation)
    assert told.complete
    assert told.stopped
    assert told.lost <= 0.1 * told.samples  # none where the simulation keeps up with time
    got = read_csv(tmp_path / "run.csv")
    steps = np.diff(got.t)
    assert np.mean(steps) == pytest.approx(0.005, rel=1e-3)
    assert np.std(steps) < 1.2e-3  # a sample waits while a command is read; its stamp says so
    pwm = np.array([[int(v) for v in line.split(",")[1:]] for line in (tmp_path / "truth").read_text().split()])
    assert set(pwm[:, 1]) == {0, 170 * 400 // 255}  # 8 V of 12 V
    assert pwm[-1, 1] == 0
