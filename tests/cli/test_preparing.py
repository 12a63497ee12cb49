"""While a study is made ready a terminal says so; logs and pipes get nothing of it."""

import io

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


@pytest.mark.parametrize("terminal", [True, False])
def test_an_error_of_the_preparation_goes_on(monkeypatch, terminal):
    monkeypatch.setattr(out, "err", Console(file=io.StringIO(), force_terminal=terminal))
    with pytest.raises(KeyboardInterrupt), out.preparing("tank"):
        raise KeyboardInterrupt
