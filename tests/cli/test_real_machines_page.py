"""docs/real-machines.md: every command on it is run, and every line that is printed on it comes in its place."""

import pytest
from printed_page import commands, first_wrong, parts

from plantfit.cases.shared.registry import demos

PARTS = parts("real-machines.md")
# solved at once; others search for 4 to 20 s of processor time
FAST = ("A linear drive with friction: a force that is known",)
REAL = {"heater", "gearmotor", "tanks", "emps", "thermal", "exchanger", "double_pendulum"}


def test_each_real_machine_has_a_part_that_begins_with_its_files():
    first = [commands(part)[0][0] for part in PARTS.values()]
    assert {words[1] for words in first} == REAL <= set(demos())
    assert len(first) == len(REAL)
    for words, part in zip(first, PARTS.values(), strict=True):
        assert words == ["demo", words[1], "--files"]
        assert "What one learns:" in part


@pytest.mark.parametrize("title", [pytest.param(t, marks=() if t in FAST else pytest.mark.slow) for t in PARTS])
def test_its_commands_print_what_stands_there(capsys, monkeypatch, tmp_path, title):
    assert first_wrong(capsys, monkeypatch, tmp_path, PARTS[title]) is None
