"""`plantfit export`, `import` and `merge` between two stores of one folder."""

import json
import sys
from pathlib import Path

import pytest
from cli_call import call

from plantfit.study import Store

sys.path.append(str(Path(__file__).resolve().parents[1] / "study"))
from study_fakes import FakeSearch, objective
from test_study_store import PLAN

from plantfit.study import run


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """plantfit.db has study 1 with 2 of 6 runs; other.db the same study, whole, as its study 1."""
    monkeypatch.chdir(tmp_path)
    search = FakeSearch()
    run(PLAN, objective(), Store.open("plantfit.db"), stop=lambda: len(search.done) >= 2, search=search)
    run(PLAN, objective(), Store.open("other.db"), search=FakeSearch())
    return tmp_path


def test_export_names_its_file_and_import_brings_it_back(folder, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "export", "--json", "--parquet")
    assert said.code == 0, said.err
    assert "Study 1 (gearmotor), 2 of 6 runs: gearmotor.json" in said.out
    assert (folder / "gearmotor.parquet").read_bytes()[:4] == b"PAR1"
    said = call(capsys, monkeypatch, "import", "gearmotor.json", "gearmotor.parquet", "--store", "new.db")
    assert said.code == 0, said.err
    assert "gearmotor.json: study 1 (gearmotor), 2 of 6 runs; go on with `plantfit resume 1 --store new.db`" in said.out
    assert "Study 1 is the same study as gearmotor.parquet: `plantfit merge" in said.err
    call(capsys, monkeypatch, "export", "2", "--store", "new.db", "-o", "again.parquet")
    assert (folder / "again.parquet").read_bytes() == (folder / "gearmotor.parquet").read_bytes()
    (told,) = json.loads(call(capsys, monkeypatch, "import", "gearmotor.json", "--json", "--store", "third.db").out)
    assert told == {"file": "gearmotor.json", "study": 1, "runs_done": 2, "runs": 6, "same_as": None}


def test_merge_of_stores_and_files(folder, capsys, monkeypatch):
    call(capsys, monkeypatch, "export", "--store", "other.db", "-o", "whole.json")
    said = call(capsys, monkeypatch, "merge", "other.db", "whole.json")
    assert said.code == 0, said.err
    assert "other.db: study 1 (gearmotor) is study 1 here: 4 runs added, 2 the same, 0 kept" in said.out
    assert "whole.json (gearmotor) is study 1 here: 0 runs added, 6 the same, 0 kept" in said.out
    assert Store.open("plantfit.db").study(1).state == "done"
    (told,) = json.loads(call(capsys, monkeypatch, "merge", "other.db", "--store", "new.db", "--json").out)
    assert (told["there"], told["study"], told["new"], told["added"]) == (1, 1, True, 6)
    Store.open("empty.db")
    assert "nothing was changed" in call(capsys, monkeypatch, "merge", "empty.db").out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["export", "9"], "no study 9"),
        (["export", "--store", "nowhere.db"], "does not exist"),
        (["export", "--json", "--parquet", "-o", "x"], "leave one of the three out"),
        (["import", "other.db"], "plantfit merge"),
        (["import", "nowhere.json"], "cannot be read"),
        (["import", "good.json", "--spec", "nowhere.toml"], "no study file nowhere.toml"),
        (["import", "good.json", "notes.txt"], "is not an exported study"),
        (["merge", "plantfit.db"], "is the store to merge into"),
        (["merge", "nowhere.db"], "does not exist"),
        (["merge", "notes.txt"], "is not an exported study"),
    ],
)
def test_mistakes_are_one_sentence_and_change_nothing(folder, capsys, monkeypatch, words, told):
    (folder / "notes.txt").write_text("my notes")
    Store.open("plantfit.db").export_json(1, "good.json")
    said = call(capsys, monkeypatch, *words)
    assert said.code == 10
    assert told in said.err
    assert said.err.count("\n") == 1
    assert len(Store.open("plantfit.db").studies()) == 1
