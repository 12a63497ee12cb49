"""Ctrl-C in a command that keeps nothing by itself: one sentence, exit code 130, no traceback."""

import os
import signal
import subprocess
import sys

import pytest


@pytest.mark.parametrize("command", [("demo", "gearmotor"), ("methods",)], ids=" ".join)
def test_a_stopped_command_says_so(command, tmp_path):
    begin = f"import os, sys; sys.argv = ['plantfit', *{command!r}]; from plantfit.cli.main import run_cli"
    if command[0] == "demo":
        wait = "print('ready', flush=True); run_cli()"
    else:  # the signal comes while the command runs, wherever that is
        wait = "import plantfit.cli.catalogue as c; c.methods = lambda *given: os.kill(os.getpid(), 2); run_cli()"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{begin}; {wait}"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env={**os.environ, "PYTHONUNBUFFERED": "1"},
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
