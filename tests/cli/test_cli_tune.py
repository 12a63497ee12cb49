"""`plantfit methods` and `plantfit tune-search`."""

import json
import re
import tomllib

import pytest
from cli_call import call, heater

QUICK = ("--method", "pso", "--outer", "random", "--budget", "60", "--runs", "3", "--trials", "6")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    heater(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_methods_table_and_one_in_full(capsys, monkeypatch):
    table = call(capsys, monkeypatch, "methods").out
    assert "what it does" in table
    assert "residuals" in table
    one = " ".join(call(capsys, monkeypatch, "methods", "pso").out.split())
    for part in (
        "Kennedy and Eberhart 1995",
        "inertia",
        "0.72984",
        "0 to 1",
        "share of the velocity",
        "absorb, reflect",
    ):
        assert part in one
    [record] = json.loads(call(capsys, monkeypatch, "methods", "pso", "--json").out)
    assert record["name"] == "pso"
    assert {"name": "inertia", "default": 0.72984, "range": [0.0, 1.0]}.items() <= record["settings"][1].items()
    wrong = call(capsys, monkeypatch, "methods", "psoo")
    assert wrong.code == 8
    assert "Did you mean 'pso'?" in wrong.err


@pytest.mark.thorough
def test_tune_search_writes_a_block_that_a_study_takes(folder, capsys, monkeypatch):
    words = (
        "tune-search",
        "heater.toml",
        *QUICK,
        "--only",
        "inertia,topology",
        "--range",
        "inertia=0.4:0.7",
        "--out",
        "settings.toml",
    )
    said = call(capsys, monkeypatch, *words)
    assert said.code == 0, said.err
    text = (folder / "settings.toml").read_text()
    assert text in said.out
    # the values may be comments, when they did not pay
    values = tomllib.loads(text.replace("# inertia", "inertia").replace("# topology", "topology"))["search"][
        "settings"
    ]["pso"]
    assert set(values) == {"inertia", "topology"}
    assert "on runs 0 to 2 of seed 1, compared on runs 3 to 22" in " ".join(said.out.split())

    record = json.loads(call(capsys, monkeypatch, *words, "--json").out)
    assert record["best"] == values
    assert record["sentence"] in said.out
    assert record["trials"][0]["settings"] == {"inertia": 0.72984, "topology": "global"}

    from plantfit.spec import load

    study = (folder / "heater.toml").read_text() + 'methods = ["pso"]\n' + text
    (folder / "with.toml").write_text(study)
    assert set(load(folder / "with.toml").plan.settings["pso"]) <= {"inertia", "topology"}


WRONG = {
    "unknown method": (("--method", "psoo"), "Did you mean 'pso'"),
    "unknown outer": (("--method", "pso", "--outer", "pos"), "no method 'pos'"),
    "unknown setting": (("--method", "pso", "--only", "inerta"), "Did you mean 'inertia'"),
    "unreadable range": (("--method", "pso", "--range", "inertia"), "write inertia=0.4:0.9"),
    "range outside": (("--method", "pso", "--range", "inertia=0.4:9"), "within 0 to 1"),
    "range of words for a number": (("--method", "pso", "--range", "inertia=a,b"), "give two numbers"),
    "too few trials": (("--method", "pso", "--trials", "1"), "trials is 1"),
}


@pytest.mark.parametrize("case", WRONG)
def test_one_sentence_and_exit_code_8(case, folder, capsys, monkeypatch):
    words, part = WRONG[case]
    said = call(capsys, monkeypatch, "tune-search", "heater.toml", *words)
    assert said.code == 8, said.err
    assert part in said.err
    assert "Traceback" not in said.err
    assert said.out == ""


def test_ctrl_c_keeps_the_best_so_far(folder, capsys, monkeypatch):
    import os
    import signal

    from plantfit.study.tuning import racing, tuner

    held = []

    def interrupting(*arguments):
        held.append(1)
        if len(held) == 2:  # the default is measured, the first settings are about to race
            os.kill(os.getpid(), signal.SIGINT)
        return racing.race(*arguments)

    monkeypatch.setattr(tuner, "race", interrupting)
    said = call(
        capsys, monkeypatch, "tune-search", "heater.toml", *QUICK, "--only", "inertia", "--out", "settings.toml"
    )
    assert said.code == 130
    assert "not yet compared on fresh seeds" in said.err
    assert "# Stopped after 1 setting" in (folder / "settings.toml").read_text()


def test_progress_without_a_terminal_is_plain_lines(folder, capsys, monkeypatch):
    monkeypatch.setattr("plantfit.cli.terminal.out.LOG_EVERY", 0.0)
    said = call(capsys, monkeypatch, "tune-search", "heater.toml", *QUICK, "--only", "inertia")
    assert said.code == 0, said.err
    assert re.search(r"^\d+ s: .*evaluations, .*left in this search$", said.err, re.MULTILINE), said.err
    quiet = call(capsys, monkeypatch, "tune-search", "heater.toml", *QUICK, "--only", "inertia", "--json")
    assert "evaluations" not in quiet.err
