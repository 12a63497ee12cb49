"""docs/papers.md: every command on it is one that there is, with options, demos, rigs, methods, models and files that there are."""

import re
import shlex
from importlib.resources import files
from pathlib import Path

import pytest
import typer

from plantfit import methods
from plantfit.cases.shared.registry import demos
from plantfit.cli.main import app
from plantfit.models.library.catalogue import models
from plantfit.rig.offered import names, offered

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "papers.md").read_text("utf-8")
COMMANDS = list(dict.fromkeys(re.findall(r"`plantfit ([^`]+)`", PAGE)))
SHOWN = re.findall(r"`plantfit demo (\w+)`(?: \[([^\]]+)\])?(?!\()", PAGE)
ALL = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]


def options_of(name):
    return {o: p for p in ALL[name].params for o in (*p.opts, *p.secondary_opts) if o.startswith("-")} | {"-h": None, "--help": None}


def made_before(place):
    """Names of the files that commands above this place of the list write."""
    made = set()
    for command in COMMANDS[:place]:
        words = shlex.split(command)
        if words[0] == "rig" and len(words) > 1:
            out = words[words.index("--out") + 1] if "--out" in words else f"{words[1]}.csv"
            made |= {out} | ({out.replace(".csv", ".toml")} if "--study" in words else set())
    return made


def test_there_are_many():
    assert len(COMMANDS) > 35
    assert {"pendubot", "motor", "robot", "steam"} <= {name for name, _ in SHOWN}


@pytest.mark.parametrize("command", [c for c in COMMANDS if "NAME" not in c])
def test_a_command_is_one_that_there_is(command):
    name, *words = shlex.split(command)
    assert name in ALL
    known, free = options_of(name), []
    while words:
        word = words.pop(0)
        if not word.startswith("-"):
            free.append(word)
            continue
        assert word in known, word
        option = known[word]
        if option is None or option.is_flag:
            continue
        value = words.pop(0)
        if name == "rig" and word == "--set":
            assert value.partition("=")[0] in {n.name for n in offered(free[0]).numbers}
        if word == "--recording":
            assert value in made_before(COMMANDS.index(command))
    offers = {"demo": demos(), "rig": names(), "methods": methods.names(), "models": models()}
    if name in offers:
        assert all(word in offers[name] for word in free)
    for word in free:
        if word.startswith("out/"):
            _, case, file = word.split("/")
            assert files(f"plantfit.cases.{case}").joinpath(file).is_file()
        elif word.endswith(".toml"):
            assert word in made_before(COMMANDS.index(command))


@pytest.mark.parametrize(("name", "section"), [(n, s) for n, s in dict.fromkeys(SHOWN) if s])
def test_a_section_named_in_brackets_is_on_the_page(name, section):
    folder = Path(str(files(f"plantfit.cases.{name}")))
    titles = [
        t for p in folder.rglob("*.py") for t in re.findall(r"(?:\"title\": f?|title: str = |TITLE = )\"([^\"]+)\"", p.read_text("utf-8"))
    ]
    assert any(section in t for t in titles), titles


@pytest.mark.parametrize("row", [line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith("| part ")])
def test_a_row_says_what_shows_it_or_why_nothing_does(row):
    part, command, reached = (cell.strip() for cell in row.strip("|").split("|"))
    assert part
    assert reached
    if not command:
        assert "not shown" in reached or "the names stand" in reached
    for word in re.findall(r"\b[A-Z]+_(?:RUN|LINE)\b", row):
        pytest.fail(f"{word} was not filled in")
