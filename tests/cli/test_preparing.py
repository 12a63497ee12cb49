"""While a study is made ready a terminal says so; logs and pipes get nothing of it."""

import io
import threading

import pytest
from rich.console import Console

from plantfit.cli.terminal import out


@pytest.mark.parametrize("terminal", [True, False])
def test_the_choice_of_steps_is_told_on_a_terminal_only_and_wiped_away(monkeypatch, terminal):
    written = io.StringIO()
    monkeypatch.setattr(out, "err", Console(file=written, force_terminal=terminal, width=100))
    with out.preparing("tank [1]"):
        pass
    said = written.getvalue()
    assert ("tank [1]: chooses how long the steps of its simulation are" in said) == terminal
    assert said.endswith("\x1b[1A\x1b[2K") == terminal  # the line is taken back
    assert terminal or not said


def test_a_log_is_told_of_what_takes_long_and_only_of_that(monkeypatch, capsys):
    monkeypatch.setattr(out, "err", Console(file=io.StringIO(), force_terminal=False))
    monkeypatch.setattr(out, "LOG_EVERY", 0.0)
    written = threading.Event()
    monkeypatch.setattr(out, "print", lambda *given, **named: (print(*given, **named), written.set()), raising=False)
    with out.doing("tank: works out what the data determine"):
        assert written.wait(60)
    assert capsys.readouterr().err == "tank: works out what the data determine ...\n"
    monkeypatch.setattr(out, "LOG_EVERY", 1e6)
    with out.doing("tank: works out what the data determine"):
        pass
    assert not capsys.readouterr().err
    assert not any(isinstance(t, threading.Timer) and not t.finished.is_set() for t in threading.enumerate())


@pytest.mark.parametrize("terminal", [True, False])
def test_an_error_of_the_preparation_goes_on(monkeypatch, terminal):
    monkeypatch.setattr(out, "err", Console(file=io.StringIO(), force_terminal=terminal))
    with pytest.raises(KeyboardInterrupt), out.preparing("tank"):
        raise KeyboardInterrupt
