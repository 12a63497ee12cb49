"""docs/papers.md: every command on it is one that there is, with options, demos, rigs, methods, models and files
that there are."""

import re
import shlex
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import typer

from plantfit import methods
from plantfit.cases.shared.registry import demos
from plantfit.cli.main import app
from plantfit.models.library.catalogue import models
from plantfit.rig.offered import names, offered
from plantfit.spec import load

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "papers.md").read_text("utf-8")
COMMANDS = list(dict.fromkeys(re.findall(r"`plantfit ([^`]+)`", PAGE)))
ROWS = [line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith("| part ")]
# what is quoted, or a section of the demo named last in the row
BRACKETS = re.compile(r"`([^`]*)`|\[([^\]`]+)\](?!\()")
WRITTEN = re.findall(r"```toml\n# (\S+\.toml)", PAGE)  # study files that the page holds


def sections():
    """(demo, words in brackets) of every row, the demo None where none stands before them."""
    found = []
    for row in ROWS:
        demo = None
        for match in BRACKETS.finditer(row):
            named = re.match(r"plantfit demo (\w+)", match[1] or "")
            demo = named[1] if named else demo
            if match[2]:
                found.append((demo, match[2]))
    return found


SHOWN = list(dict.fromkeys(sections()))
ALL = typer.main.get_command(app).commands  # pyrefly: ignore[missing-attribute]


def options_of(name):
    return {o: p for p in ALL[name].params for o in (*p.opts, *p.secondary_opts) if o.startswith("-")} | {
        "-h": None,
        "--help": None,
    }


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
    assert len(SHOWN) > 25


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
            assert word in made_before(COMMANDS.index(command)) | set(WRITTEN)


@pytest.mark.parametrize(("name", "section"), SHOWN)
def test_brackets_hold_the_first_words_of_a_heading_of_the_demo_before_them(name, section):
    assert name, "no demo stands before these brackets"
    folder = Path(str(files(f"plantfit.cases.{name}")))
    titles = [
        t
        for p in folder.rglob("*.py")
        for t in re.findall(r"(?:\"title\": f?|title: str = |\btitle = |TITLE = )\"([^\"]+)\"", p.read_text("utf-8"))
    ]
    assert any(t.startswith(section) for t in titles), titles


@pytest.mark.parametrize("row", ROWS)
def test_a_row_says_what_shows_it_or_why_nothing_does(row):
    part, command, reached = (cell.strip() for cell in row.strip("|").split("|"))
    assert part
    assert reached
    if not command:
        assert "not shown" in reached
    assert "the same" not in command  # each row names its own
    assert len(reached) < 560, "split this row"
    for word in re.findall(r"\b[A-Z]+_(?:RUN|LINE)\b", row):
        pytest.fail(f"{word} was not filled in")


def test_the_late_chamber_of_the_page_is_the_plant_of_its_study_file(tmp_path, monkeypatch):
    """The page's numpy writes the record, its study file reads it, and simulated at the truth leaves the noise."""
    [code] = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    [text] = re.findall(r"```toml\n(# delayed.toml.*?)```", PAGE, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(code, "papers.md", "exec"), names)
    Path("delayed.toml").write_text(text, "utf-8")
    problem = load("delayed.toml").problem
    truth = np.array([names[n] for n in problem.space.names])
    error = problem.predict(truth)["y"] - next(iter(problem.experiments.values())).recording["y"]
    assert np.std(error) == pytest.approx(0.05, rel=0.05)
    assert abs(np.mean(error)) < 0.005
