"""The firmware compiled for this machine, running with its simulated motor, and its own log of what it made."""

import contextlib
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
# drive and channels, as hal_host.c declares them
SCALE = np.array([0.0470588235294, 0.00314159265359, 1.0, 0.00244140625])


def build(folder: Path) -> Path:
    """The program; skips the test where there is no compiler."""
    if shutil.which("gcc") is None or shutil.which("make") is None:
        pytest.skip("gcc or make is not on this machine: the firmware cannot be compiled for the host")
    subprocess.run(["make", "-C", FIRMWARE, f"BUILD={folder}", "CC=gcc"], check=True, capture_output=True, timeout=120)
    return folder / "motor_host"


@contextlib.contextmanager
def running(program: Path, *words):
    """The port of a running board."""
    process = subprocess.Popen([program, *map(str, words)], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield next(line for line in process.stdout if line.startswith("/")).strip()
    finally:
        process.terminate()
        process.wait(10)


@dataclass(frozen=True)
class Truth:
    """Samples (n, 8): counter, us, drive, index, state, raw channels; drives (m, 2): us, raw."""

    samples: np.ndarray
    drives: np.ndarray


def read_truth(file: Path) -> Truth:
    lines = file.read_text().splitlines()
    samples = [[int(v) for v in line.split("*")[0].split(",")[1:]] for line in lines if line.startswith("D,")]
    drives = [[int(v) for v in line.split(",")[1:]] for line in lines if line.startswith("M,")]
    return Truth(np.array(samples), np.array(drives))
