"""`plantfit --help`: every command once, in one line of at most 80 columns. Each has a page, and a schema of what
`--json` prints."""

import inspect
import re
from pathlib import Path

from typer.main import get_command
from typer.testing import CliRunner

from plantfit.cli.main import app
from plantfit.cli.terminal.overview import SECTIONS, sections
from plantfit.findings.results.all_results import RESULTS

DOCS = Path(__file__).resolve().parents[2] / "docs"
NO_RESULT = {
    "what it prints is the findings, whose schema is `plantfit schema --findings`": ("run", "resume", "report", "demo"),
    "what it prints is the part `diagnosis` of the findings, the looks and the files": ("diagnose",),
    "it prints which files it wrote, with a few words or numbers about them": (
        "init", "new", "combine", "export", "excite", "record", "rig", "export-study", "import", "merge",
    ),
    "it prints a plain list of what there is": ("list", "methods", "models", "workers"),
    "it is older than the schemas and prints a plain dict": ("check", "tune-search"),
}  # fmt: skip
"""Commands whose `--json` is no `Result`, by the reason."""


def test_every_command_stands_in_one_section():
    named = [name for rows in SECTIONS.values() for name in rows]
    assert sorted(named) == sorted(get_command(app).commands)  # pyrefly: ignore[missing-attribute]


def test_the_work_of_a_command_lies_in_the_sub_room_of_its_section():
    for rows in SECTIONS.values():
        for name, (command, _) in rows.items():
            section = command.__module__.rpartition(".")[2]
            rooms = re.findall(r"plantfit\.cli\.commands\.(\w+)", inspect.getsource(command))
            assert set(rooms) <= {section}, f"the work of `plantfit {name}` belongs to cli/commands/{section}/"


def test_the_page_on_the_architecture_has_every_section_with_its_commands():
    page = (DOCS / "architecture.md").read_text("utf-8")
    found = re.findall(r"^\| ([A-Z][a-z ]+): `(\w+)` \|[^:|]*: ([^|]*) \|$", page, re.MULTILINE)
    files = {title: next(iter(rows.values()))[0].__module__.rpartition(".")[2] for title, rows in SECTIONS.items()}
    wanted = [(title, files[title], ", ".join(rows)) for title, rows in SECTIONS.items()]
    assert found == wanted, (
        'name the command in the table below "A command" of docs/architecture.md, in the order of the help'
    )


def test_what_a_command_prints_as_json_has_a_schema():
    taking = {
        name
        for rows in SECTIONS.values()
        for name, (command, _) in rows.items()
        if "json" in inspect.signature(command).parameters
    }
    described, excepted = (
        {name.split()[0] for name in RESULTS},
        [name for names in NO_RESULT.values() for name in names],
    )
    missing = sorted(taking - described - set(excepted))
    assert missing == [], (
        "make a record below src/plantfit/findings/results/, with a line in RESULTS of all_results.py, of "
        f"what {missing} prints with --json, as `Sensitivities`; or name it in NO_RESULT here with the reason"
    )
    assert sorted(excepted) == sorted(taking - described), (
        "take out of NO_RESULT what has a schema, takes no --json, or stands there twice"
    )


def test_every_command_stands_on_a_page():
    """Beside the page on the architecture, which users do not read."""
    pages = " ".join(path.read_text("utf-8") for path in DOCS.glob("*.md") if path.name != "architecture.md")
    missing = [
        name for rows in SECTIONS.values() for name in rows if not re.search(rf"plantfit {name}(?![\w-])", pages)
    ]
    assert missing == [], f"write {[f'plantfit {name}' for name in missing]} on the page of docs/ about the matter"


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
