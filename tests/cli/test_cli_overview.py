"""`plantfit --help`: every command once, in one line of at most 80 columns."""

import inspect
import re
from pathlib import Path

from typer.main import get_command
from typer.testing import CliRunner

from plantfit.cli.main import app
from plantfit.cli.terminal.overview import SECTIONS, sections


def test_every_command_stands_in_one_section():
    named = [name for rows in SECTIONS.values() for name in rows]
    assert sorted(named) == sorted(get_command(app).commands)  # pyright: ignore[reportAttributeAccessIssue]


def test_the_work_of_a_command_lies_in_the_sub_room_of_its_section():
    for rows in SECTIONS.values():
        for name, (command, _) in rows.items():
            section = command.__module__.rpartition(".")[2]
            rooms = re.findall(r"plantfit\.cli\.commands\.(\w+)", inspect.getsource(command))
            assert set(rooms) <= {section}, f"the work of `plantfit {name}` belongs to cli/commands/{section}/"


def test_the_page_on_the_architecture_has_every_section_with_its_commands():
    page = (Path(__file__).resolve().parents[2] / "docs" / "architecture.md").read_text("utf-8")
    found = re.findall(r"^\| ([A-Z][a-z ]+): `(\w+)` \|[^:|]*: ([^|]*) \|$", page, re.MULTILINE)
    files = {title: next(iter(rows.values()))[0].__module__.rpartition(".")[2] for title, rows in SECTIONS.items()}
    assert found == [(title, files[title], ", ".join(rows)) for title, rows in SECTIONS.items()]


def test_each_has_one_line_that_is_not_cut():
    done = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "80"})
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert "..." not in "".join(lines[1:])
    for rows in SECTIONS.values():
        for name, (_, said) in rows.items():
            (line,) = [k for k in lines if k.split()[:1] == [name]]
            assert line.endswith(said)
            assert len(line) <= 80


def test_a_command_that_no_section_names_is_shown_all_the_same():
    fit, more = sections(["run", "sing"])
    assert fit == ("Fit", [("run ", "Search the parameters, judge them, write the report")])
    assert more == ("More", [("sing", "")])
