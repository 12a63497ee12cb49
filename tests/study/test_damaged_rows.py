"""Stores and exports with columns of the wrong kind, half characters, and stores where nothing can be written."""

import json
import os
import sqlite3
import subprocess
import sys

import polars as pl
import pytest
from study_fakes import FakeSearch, objective

from plantfit.errors import PlantfitError, StoreError
from plantfit.study import Plan, Store, run
from plantfit.study.store.importing import read_study


@pytest.fixture
def place(tmp_path):
    run(Plan("gearmotor", ("pso",), runs=3, budget=30), objective(), Store.open(tmp_path / "s.db"), search=FakeSearch())
    return tmp_path / "s.db"


VALUES = ["text", 7, 1.5, b"\0\1\2", b"", "\xff", "[" * 3000, "null", "[]", "{}", 2**62, float("inf")]
COLUMNS = {
    "run": [
        "seed",
        "cost",
        "cost_bits",
        "x",
        "parameters",
        "evaluations",
        "seconds",
        "status",
        "failures",
        "packing",
        "history_cost",
        "extra",
    ],
    "study": ["name", "plan", "coordinates", "versions", "notes", "probe", "cpu", "created"],
}


@pytest.mark.parametrize(("table", "column"), [(t, c) for t, columns in COLUMNS.items() for c in columns])
@pytest.mark.further(10)
def test_columns_of_another_kind_are_said_or_read(table, column, place):
    for value in VALUES:
        with sqlite3.connect(place) as connection:
            connection.execute(f"UPDATE {table} SET {column} = ?", (value,))
        store = Store.open(place)
        for read in (
            lambda s: s.studies(),
            lambda s: s.plan(1),
            lambda s: [r.cost + r.seconds for r in s.runs(1)],
            lambda s: s.whole(1),
        ):
            said = ""
            try:
                read(store)
            except PlantfitError as error:
                said = str(error)
            assert len(said) < 900
            assert "\n" not in said


def test_wrong_kinds_of_numbers_never_come_out(place):
    with sqlite3.connect(place) as connection:
        connection.execute("UPDATE run SET seconds = 'soon'")
    with pytest.raises(StoreError, match="seconds is 'soon'"):
        Store.open(place).runs(1)


@pytest.mark.parametrize(
    ("bend", "told"),
    [
        (lambda plan: plan.update(tau=[1]), "has the unknown 'tau'"),
        (lambda plan: plan.pop("name"), "lacks 'name'"),
        (lambda plan: plan.update(name=7), "has the name 7"),
        (lambda plan: plan.update(settings={"pso": {"population": 10**400}}), "outside its range"),
    ],
)
def test_a_stored_plan_with_other_keys(bend, told, place):
    """store 883 of seed 1, 1396 and 1988 of seed 2: TypeError of Plan.__init__()."""
    with sqlite3.connect(place) as connection:
        plan = json.loads(connection.execute("SELECT plan FROM study").fetchone()[0])
        bend(plan)
        connection.execute("UPDATE study SET plan = ?", (json.dumps(plan),))
    with pytest.raises(PlantfitError, match=told):
        Store.open(place).plan(1)


def test_half_characters_in_an_export(place, tmp_path):
    Store.open(place).export_json(1, tmp_path / "x.json")
    text = (tmp_path / "x.json").read_text()
    for spoiled in (text.replace("gearmotor", "\\ud800"), text.replace('"pso"', '"\\udfff"')):
        (tmp_path / "x.json").write_text(spoiled)
        with pytest.raises(StoreError, match="not Unicode"):
            read_study(tmp_path / "x.json")
    whole = text.replace("gearmotor", "\\ud83d\\ude00")
    (tmp_path / "x.json").write_text("\ufeff" + whole)
    assert read_study(tmp_path / "x.json").study.name == "\U0001f600"
    assert json.loads(whole)


def test_half_characters_in_the_metadata_of_parquet(place, tmp_path):
    """export 12 of seed 7, as mutated by what it holds: UnicodeEncodeError from the database."""
    Store.open(place).export_parquet(1, tmp_path / "x.parquet")
    frame = pl.read_parquet(tmp_path / "x.parquet")
    text = pl.read_parquet_metadata(tmp_path / "x.parquet")["plantfit"]
    frame.write_parquet(tmp_path / "x.parquet", metadata={"plantfit": text.replace("gearmotor", "\\ud800")})
    with pytest.raises(StoreError, match="not Unicode"):
        Store.open(tmp_path / "into.db").import_file(tmp_path / "x.parquet")
    frame.write_parquet(tmp_path / "x.parquet", metadata={"plantfit": "[" * 100_000})
    with pytest.raises(StoreError, match="broken metadata"):
        read_study(tmp_path / "x.parquet")


def test_a_schema_that_is_no_text(place):
    """store 467 of seed 101: sqlite3 cannot decode its own message about a broken schema."""
    whole = place.read_bytes()
    spoiled = whole.replace(b"CREATE TABLE study", b"CREATE TABL\xf6 study")
    assert spoiled != whole
    place.write_bytes(spoiled)
    with pytest.raises(StoreError, match=r"s\.db is damaged; restore it from a copy"):
        Store.open(place)


@pytest.mark.parametrize(
    ("bend", "told"),
    [
        (lambda r: r["runs"][0].update(x=[[1.0], 2.0, 3.0]), r"runs\[0\]: a value is of the wrong kind"),
        (lambda r: r["runs"].insert(0, "x"), r"runs\[0\]: a value is of the wrong kind"),
        (lambda r: r["study"].update(versions=7), "study: a value is of the wrong kind"),
        (lambda r: r["tasks"][0].update(first="x"), r"tasks\[0\]: 'x' in place of a whole number"),
    ],
)
def test_an_export_whose_values_are_of_another_kind_is_told_in_words(bend, told, place, tmp_path):
    Store.open(place).export_json(1, tmp_path / "x.json")
    record = json.loads((tmp_path / "x.json").read_text())
    bend(record)
    (tmp_path / "x.json").write_text(json.dumps(record))
    with pytest.raises(StoreError, match=told):
        read_study(tmp_path / "x.json")


def test_a_store_where_nothing_can_be_written_can_be_read(place, monkeypatch):
    before = place.read_bytes()
    real = os.access
    monkeypatch.setattr(
        os, "access", lambda path, mode: real(path, mode) and not (mode == os.W_OK and str(path) == str(place.parent))
    )
    store = Store.open(place)
    assert [s.name for s in store.studies()] == ["gearmotor"]
    assert len(store.runs(1)) == 3
    with pytest.raises(StoreError, match="cannot be written"):
        store.add_note(1, "x")
    assert place.read_bytes() == before


def test_a_read_only_mount(place, tmp_path):
    mount = tmp_path / "ro"
    mount.mkdir()
    bound = (
        subprocess.run(["mount", "--bind", str(place.parent), str(mount)], capture_output=True, text=True)
        if os.name == "posix"
        else None
    )
    if bound is None or bound.returncode:
        pytest.skip("no mount can be made here (it needs root on Linux)")
    try:
        if subprocess.run(["mount", "-o", "remount,ro,bind", str(mount)], capture_output=True).returncode:
            pytest.skip("no mount can be made read-only here")
        code = (
            "import sys; sys.argv = ['plantfit', 'list', '--store', "
            "sys.argv[1]]; from plantfit.cli.start import run; run()"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(mount / place.name)], capture_output=True, text=True, cwd=tmp_path
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert "gearmotor" in done.stdout
    finally:
        subprocess.run(["umount", str(mount)], check=True)
