"""Errors inside plantfit: one sentence, exit code 70, and a log with the traceback and without passwords."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from cli_call import call

import plantfit.cli.commands.reference.catalogue as catalogue
from plantfit.cli.terminal.failures import shortened
from plantfit.errors import PlantfitWarning, SearchError


@pytest.fixture
def failing(monkeypatch, tmp_path):
    monkeypatch.setenv("PLANTFIT_CACHE", str(tmp_path / "cache"))

    def fail_with(error):
        def work(*given):
            raise error

        monkeypatch.setattr(catalogue, "methods", work)

    return fail_with


ERRORS = [
    ValueError("line 1\nline 2"),
    KeyError("k"),
    RecursionError(),
    AssertionError(),
    ZeroDivisionError("x" * 9000),
]
ERRORS += [TypeError("\ud800")]


@pytest.mark.parametrize("error", ERRORS)
def test_one_sentence_and_a_log(error, failing, capsys, monkeypatch, tmp_path):
    failing(error)
    said = call(capsys, monkeypatch, "methods")
    assert said.code == 70
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert type(error).__name__ in said.err
    assert len(said.err) < 1200
    (log,) = (tmp_path / "cache" / "logs").iterdir()
    assert str(log) in said.err
    assert "Traceback" in log.read_text()
    assert re.search(r"jaxlib \d", log.read_text())
    if os.name == "posix":
        assert log.stat().st_mode & 0o077 == 0


def test_no_password_in_the_log(failing, capsys, monkeypatch, tmp_path):
    url = "postgresql://me:hunter2@h/x?password=hunter3"
    failing(ValueError(f"cannot use {url} or hunter2"))
    monkeypatch.setenv("PLANTFIT_STORE", url)
    said = call(capsys, monkeypatch, "methods", "--json")
    (log,) = (tmp_path / "cache" / "logs").iterdir()
    assert "hunter" not in said.err + log.read_text()


def test_a_log_has_a_place_without_a_cache(failing, capsys, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PLANTFIT_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    failing(ValueError("x"))
    said = call(capsys, monkeypatch, "methods")
    (log,) = tmp_path.glob("plantfit-*.log")
    assert str(log) in said.err
    log.unlink()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    assert "no log of it could be written" in call(capsys, monkeypatch, "methods").err


def test_other_ends(failing, capsys, monkeypatch):
    for error, code, told in (
        (MemoryError(), 12, "memory"),
        (OSError(28, "No space", "f"), 12, "'f'"),
        (SearchError("x" * 86_000), 8, "characters"),
    ):
        failing(error)
        said = call(capsys, monkeypatch, "methods")
        assert (said.code, told in said.err, said.err.count("\n")) == (code, True, 1)
        assert len(said.err) < 2000


def test_warnings_of_plantfit_are_sentences_and_those_of_libraries_are_silent(capsys, monkeypatch):
    def work(*given):
        warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)
        warnings.warn("A sentence.", PlantfitWarning, stacklevel=1)

    monkeypatch.setattr(catalogue, "methods", work)
    assert call(capsys, monkeypatch, "methods").err == "plantfit: A sentence.\n"


@pytest.mark.thorough
def test_a_reader_that_leaves_and_a_terminal_without_umlauts(tmp_path):
    run = "import sys; sys.argv = ['plantfit', *{words!r}]; from plantfit.cli.start import run; run()"
    told = subprocess.run(
        [sys.executable, "-c", run.format(words=["check", "Wärme\u2192.toml"])],
        capture_output=True, env={**os.environ, "PYTHONIOENCODING": "ascii"}, cwd=tmp_path,
    )  # fmt: skip
    assert told.returncode == 7
    assert b"There is no study file 'W\\xe4rme\\u2192.toml'" in told.stderr
    code = run.format(words=["methods"])
    left = subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -c "{code}" | head -c 1'], capture_output=True, text=True, cwd=tmp_path
    )
    assert left.stderr == ""


def test_shortened():
    assert shortened("short") == "short"
    assert len(shortened("x" * 10**6)) < 1600
    assert Path(__file__).name in shortened("a" * 9000 + Path(__file__).name)
