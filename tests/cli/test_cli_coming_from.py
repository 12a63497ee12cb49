"""What docs/coming-from.md and README.md type runs: their Python, the commands, and the keys that are named."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_call import call, heater

import plantfit as pf

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "coming-from.md").read_text("utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
HERE = [row.split(" | ")[1] for row in re.findall(r"^\| (.*) \|$", PAGE, re.MULTILINE)]
CODE = [c for cell in HERE for c in re.findall(r"`([^`]+)`", cell)]
COMMANDS = sorted({c for c in CODE if c.startswith("plantfit ")})


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """The names that the first block of the page makes, on a heater with known truth."""
    folder = tmp_path_factory.mktemp("heater")
    heater(folder)
    made: dict[str, Any] = {}
    exec(compile(BLOCKS[0].replace('"heater.csv"', repr(str(folder / "heater.csv"))), "coming-from.md", "exec"), made)
    return made


def test_the_example_finds_the_heater(names):
    values = names["answer"].values
    assert values["K"] == pytest.approx(0.8, rel=0.02)
    assert values["L"] == pytest.approx(3.4, abs=0.3)


def test_lines_of_python_give_what_the_page_says(names, tmp_path):
    answer = names["answer"]
    tried = {
        "answer.standard_errors": lambda: answer.standard_errors["K"],
        "answer.covariance": lambda: answer.covariance.matrix,
        'answer.report("heater.html")': lambda: answer.report(tmp_path / "heater.html"),
        "print(answer.summary())": answer.summary,
        "pf.fit(problem)": lambda: pf.fit,
        "pf.fit(problem, runs=100)": lambda: pf.fit,
        'pf.fit(problem, store="plantfit.db")': lambda: pf.fit,
        'pf.open_study("heater")': lambda: pf.open_study,
        "pf.Problem(model, record, split=0.7)": lambda: pf.Problem(names["model"], names["record"], split=0.7),
        "pf.equations(...)": lambda: pf.equations,
    }
    said = {c for c in CODE if re.match(r"(print\()?(pf|answer)\.", c)}
    assert said == set(tried)
    for line, run in tried.items():
        run()
        assert line in PAGE
    assert (tmp_path / "heater.html").is_file()


def test_fit_takes_the_words_of_the_page(names, tmp_path):
    problem = names["answer"].problem
    answer = pf.fit(problem, "least_squares", runs=2, budget=300, store=str(tmp_path / "plantfit.db"))
    assert len(answer.findings["runs"]) == 2


def test_the_curve_without_states_is_fitted():
    made: dict[str, Any] = {"pf": pf}
    exec(compile(BLOCKS[1], "coming-from.md", "exec"), made)
    x = np.linspace(0, 5, 40)
    record = pf.from_arrays(
        {"t": np.arange(40.0), "x": x, "y": 2 * np.exp(-x / 1.5)}, time="t", signals={"x": "x", "y": "y"}
    )
    answer = pf.fit(pf.Problem(made["curve"], record))
    assert answer.values == pytest.approx({"a": 2.0, "b": 1.5}, rel=1e-5)


def test_every_command_of_the_page_has_these_options(capsys, monkeypatch):
    """Each word of a command line stands in its help; the commands themselves run in their own tests."""
    assert len(COMMANDS) > 6
    for line in COMMANDS:
        _, name, *words = line.split()
        said = call(capsys, monkeypatch, name, "--help")
        assert said.code == 0, line
        assert [w for w in words if w.startswith("--") and w not in said.out] == [], line


def test_exports_and_keys_of_the_page_are_there():
    from plantfit.bridges.exported import TARGETS
    from plantfit.spec.tables import json_schema

    row = next(r for r in PAGE.splitlines() if r.startswith("| going back"))
    assert {"matlab", "c", "casadi", "control"} <= set(TARGETS) & set(re.findall(r"\w+", row))
    keys = {k for table in json_schema()["$defs"].values() for k in table.get("properties", {})}
    assert {k for c in CODE if (k := c.split(" = ")[0]) in ("clean", "value", "tied")} == {
        "clean",
        "value",
        "tied",
    } & keys


def test_the_five_lines_of_the_readme_run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    heater(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    exec(compile(block, "README.md", "exec"), {})
    assert (tmp_path / "heater.html").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    "line", [c for c in COMMANDS if c.split()[1] not in ("track", "new", "resume") and "--posterior" not in c]
)
def test_its_commands_run(line, capsys, monkeypatch, tmp_path):
    """But `track`, `new` and `resume`, which have tests of their own, and the posterior, which is an extra."""
    monkeypatch.chdir(tmp_path)
    heater(tmp_path)
    words = line.split()[1:]
    if words[0] == "compare" and len(words) == 1:
        words.append("heater.toml")
    if words[0] in ("export", "tune"):  # of a finished study
        assert call(capsys, monkeypatch, "run", "heater.toml").code == 0
    said = call(capsys, monkeypatch, *words)
    assert said.code == 0, said.err
