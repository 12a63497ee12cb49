"""Ctrl-C in a command that keeps nothing by itself: one sentence, exit code 130, no traceback."""

import os
import signal
import subprocess
import sys
import time

import pytest

from plantfit.cli.terminal.interrupts import SENTENCE, stoppable, watched


@pytest.mark.parametrize("command", [("demo", "gearmotor"), ("methods",)], ids=" ".join)
def test_a_stopped_command_says_so(command, tmp_path):
    begin = f"import os, sys; sys.argv = ['plantfit', *{command!r}]; from plantfit.cli.main import run_cli"
    if command[0] == "demo":
        wait = "print('ready', flush=True); run_cli()"
    else:  # the signal comes while the command runs, wherever that is
        wait = (
            "import plantfit.cli.commands.reference.catalogue as c; "
            "c.methods = lambda *given: os.kill(os.getpid(), 2); run_cli()"
        )
    process = subprocess.Popen(
        [sys.executable, "-c", f"{begin}; {wait}"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert process.stdout is not None
    if command[0] == "demo":
        while "gearmotor:" not in process.stdout.readline():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=300)
    assert process.returncode == 130, error
    assert "stopped by ctrl-c" in error.lower()
    assert "Traceback" not in error
    assert len(error.strip().splitlines()) == 1


BUSY = """
import numpy as np
def compute():  # C code that lets other threads run, but not the signal handlers of Python
    print("computing", flush=True)
    np.linalg.svd(np.random.default_rng(0).normal(size=(6000, 6000)))
"""
SWALLOWED = """
import sys
def compute():  # an exception that a callback raises is lost, as in parts of jax
    class Noisy:
        def __del__(self):
            print("computing", flush=True)
            import time
            time.sleep(60)
    for _ in range(100):
        Noisy()
"""


def started(code, tmp_path, command="methods"):
    begin = f"import sys; sys.argv = ['plantfit', {command!r}]\n"
    begin += "import plantfit.cli.commands.reference.catalogue as c\nc.methods = lambda *given: work()\n"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{begin}{code}\nfrom plantfit.cli.start import run\nrun()"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert process.stdout is not None
    line = b""
    while b"computing" not in line or not line.endswith(
        b"\n"
    ):  # byte by byte: what a buffer took, `communicate` would not see
        byte = os.read(process.stdout.fileno(), 1)
        assert byte, process.communicate()
        line += byte
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("code", [BUSY, SWALLOWED], ids=["in C", "swallowed"])
def test_a_signal_before_the_search_ends_whatever_runs_and_is_called_by_its_name(code, number, tmp_path):
    process = started(code + "\nwork = compute", tmp_path)
    time.sleep(0.2)  # into the computation
    process.send_signal(number)
    _, error = process.communicate(timeout=50)  # of 60 s or more that it would take
    said = SENTENCE.format(cause="Ctrl-C" if number == signal.SIGINT else "the signal SIGTERM")
    assert (process.returncode, error) == (130, f"plantfit: {said}\n")


IN_A_PART = """
from plantfit.cli.terminal.interrupts import stoppable
def work():
    with stoppable("Stopping.", lambda: "Ended; go on with X.") as stop:
        compute()
    raise SystemExit(0)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_in_a_search_is_acknowledged_while_c_code_runs_and_a_second_ends_at_once(number, tmp_path):
    process = started(BUSY + IN_A_PART, tmp_path)
    assert process.stderr is not None
    time.sleep(0.2)
    process.send_signal(number)
    assert process.stderr.readline() == "Stopping.\n"
    assert process.poll() is None  # it computes on
    process.send_signal(number)
    _, error = process.communicate(timeout=50)
    assert (process.returncode, error) == (130, "plantfit: Ended; go on with X.\n")


@pytest.mark.slow
def test_xla_compiles(tmp_path):
    code = """
import plantfit.runtime
import jax, jax.numpy as jnp
def compute():
    def heavy(x, n):
        for k in range(60):
            x = jnp.sin(x) * k + jnp.roll(x, k + n) @ jnp.ones((8, 8))
        return x
    print("computing", flush=True)
    for n in range(300):  # most of the time is XLA's
        jax.jit(heavy, static_argnums=1).lower(jnp.ones((8, 8)), n).compile()
"""
    process = started(code + IN_A_PART, tmp_path)
    assert process.stderr is not None
    process.send_signal(signal.SIGINT)
    assert process.stderr.readline() == "Stopping.\n"
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=100)
    assert (process.returncode, error) == (130, "plantfit: Ended; go on with X.\n")


def test_a_machine_is_left_in_a_safe_state(tmp_path):
    code = """
from plantfit.cli.terminal.interrupts import stoppable
def work():
    import time
    try:
        with stoppable("Stopping.", lambda: "late", cleans_up=True) as stop:
            print("computing", flush=True)
            while True:
                time.sleep(0.01)
    except KeyboardInterrupt:
        time.sleep(0.5)
        print("motor stopped", flush=True)
        raise
"""
    process = started(code, tmp_path)
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None
    assert process.stderr.readline() == "Stopping.\n"
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=50)
    assert (process.returncode, out) == (130, "motor stopped\n")
    assert error.count("\n") == 1


def test_two_signals_while_the_main_thread_cannot_look_are_two(tmp_path):
    code = """
import hashlib
from plantfit.cli.terminal.interrupts import stoppable
def work():
    import time
    try:
        with stoppable("Stopping.", lambda: "late", cleans_up=True) as stop:
            print("computing", flush=True)
            hashlib.pbkdf2_hmac("sha256", b"", b"", 3_000_000)  # about a second in C, which lets other threads run
            while True:
                time.sleep(0.01)
    except KeyboardInterrupt:
        time.sleep(0.5)
        print("motor stopped", flush=True)
        raise
"""
    process = started(code, tmp_path)
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None
    assert process.stderr.readline() == "Stopping.\n"
    for _ in range(3):  # the third does not disturb what the second began
        process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=50)
    assert (process.returncode, out) == (130, "motor stopped\n")


def test_nothing_is_left_behind():
    before = [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
    with watched(), stoppable() as stop:
        assert signal.getsignal(signal.SIGINT) not in before
        assert not stop()
    assert [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)] == before
    assert signal.set_wakeup_fd(-1) == -1


def test_a_late_ctrl_c_does_not_end_in_a_traceback(tmp_path):
    """The command has said and saved everything; libraries still clean up at exit."""
    at_exit = (
        "import atexit, time\natexit.register(lambda: (print('computing', flush=True), time.sleep(2.0), "
        "print('cleaned up', flush=True)))\n"
    )
    process = started(at_exit + "work = lambda: None", tmp_path)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    said, error = process.communicate(timeout=600)
    assert (process.returncode, error) == (0, "")
    assert "cleaned up" in said


def test_what_has_to_happen_at_the_end_of_a_process_happens(tmp_path):
    """The last search for cycles is left out, which costs neither functions of `atexit` nor temporary folders nor
    the exit code."""
    code = f"""
import atexit, gc, tempfile
def work():
    global folder
    folder = tempfile.TemporaryDirectory(dir={str(tmp_path)!r})
    folder.itself = folder  # a cycle
    atexit.register(lambda: print("ended", gc.get_freeze_count() > 1000))
    print("computing", gc.isenabled(), gc.get_threshold()[0] > 700, flush=True)
    raise SystemExit(3)
"""
    process = started(code, tmp_path)
    out, error = process.communicate(timeout=50)
    assert (process.returncode, out, error) == (3, "ended True\n", "")
    assert list(tmp_path.iterdir()) == []
