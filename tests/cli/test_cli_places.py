"""Folders with blanks and letters of other alphabets, locales without them, no home and one that cannot be written:
the same study."""

import json
import os
import subprocess
import sys

import pytest
from cli_call import heater

# one process for all commands: what a locale decides, it decides when Python starts
COMMANDS = """
import io, json, sys
from contextlib import redirect_stdout
from plantfit.cli.main import run_cli

def call(*words):
    sys.argv = ["plantfit", *words]
    said = io.StringIO()
    try:
        with redirect_stdout(said):
            run_cli()
    except SystemExit as end:
        assert not end.code, (words, end.code, said.getvalue())
    return said.getvalue()

spec = sys.argv[1]
call("check", spec)
call("run", spec, "--store", "Läufe 測.db", "--out", "Bericht 測.html")
call("list", "--store", "Läufe 測.db")
call("export", "1", "--out", "Läufe 測.json", "--store", "Läufe 測.db")
call("import", "Läufe 測.json", "--store", "zweite Läufe.db", "--spec", spec)
print(json.dumps(json.loads(call("report", "1", "--store", "zweite Läufe.db", "--json"))["parameters"]))
"""
PLACES = {
    "blanks and umlauts": ("Messung für Öl 測定", {}),
    "plain C": ("Größe", {"LC_ALL": "C", "LANG": None, "PYTHONUTF8": None}),
    "decimal comma": ("plain", {"LC_ALL": "de_DE.UTF-8"}),
    "Turkish": ("plain", {"LC_ALL": "tr_TR.UTF-8"}),
    "no home": ("plain", {"HOME": None, "XDG_CACHE_HOME": None, "PLANTFIT_CACHE": None}),
    "a home that is none": ("plain", {"HOME": "/proc/none", "XDG_CACHE_HOME": None, "PLANTFIT_CACHE": None}),
    "no time zone": ("plain", {"TZ": "nonsense/where"}),
}
FAST = ("plain C",)


def fitted(tmp_path, place):
    name, changed = PLACES[place]
    folder = tmp_path / name
    folder.mkdir()
    heater(folder)
    (folder / "Messung 測.csv").write_bytes((folder / "heater.csv").read_bytes())
    text = (
        (folder / "heater.toml")
        .read_text("utf-8")
        .replace("heater.csv", "Messung 測.csv")
        .replace('"heater"', '"Heizung größer"')
    )
    text += 'methods = ["least_squares"]\nruns = 1\nbudget = 60\n'
    (folder / "Heizung größer.toml").write_text(text, "utf-8")
    environment = {key: value for key, value in (os.environ | changed).items() if value is not None}
    words = [sys.executable, "-c", COMMANDS.encode("ascii", "backslashreplace").decode(), "Heizung größer.toml"]
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, timeout=900)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    assert b"Traceback" not in done.stderr
    return {p["name"]: p["value"] for p in json.loads(done.stdout)}


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    PLACES["usual"] = ("plain", {})
    return fitted(tmp_path_factory.mktemp("usual"), "usual")


@pytest.mark.thorough
@pytest.mark.parametrize("place", [pytest.param(p, marks=() if p in FAST else pytest.mark.slow) for p in PLACES])
def test_the_same_study_everywhere(place, usual, tmp_path):
    assert fitted(tmp_path, place) == usual
