"""Where reports and exports go: whatever a study is named, into this folder and over nothing else than their like."""

import json
import sys
from pathlib import Path

import pytest
from cli_call import call, heater
from hypothesis import example, given
from hypothesis import strategies as st

from plantfit.cli.arguments.file_names import file_name, report_places
from plantfit.errors import SearchError, StoreError
from plantfit.report.html import is_report, write_page
from plantfit.study import Store

sys.path.append(str(Path(__file__).resolve().parents[1] / "study"))
from study_fakes import FakeSearch, objective

from plantfit.study import Plan, run

HOSTILE = [
    "../escaped", "/tmp/escaped", "a/b", "a\0b", "..", ".", "~", "-rf", "con", "NUL.x", "a\nb", "\ud800", "C:\\x",
    "x" * 5000,
    "é" * 300, ".bashrc", "<script>", "a:b", " ", "\u202e", "$(x)", "*",
]  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE, ids=lambda n: ascii(n)[:20])
def test_hostile_names_stay_in_the_folder(name, tmp_path, monkeypatch):
    folder = tmp_path / "inner"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (place,) = report_places([name], None)
    write_page(place, '<!doctype html>\n<meta name="generator" content="plantfit">')
    assert [p.parent for p in tmp_path.rglob("*.html")] == [folder]
    (place,) = report_places([name], None)  # over itself
    write_page(place, "again")


@example("~")
@example("~/.ssh")
@given(st.text(min_size=1))
@pytest.mark.thorough
def test_any_name_is_one_plain_file(name):
    file = file_name(name, "html")
    assert Path(file).name == file
    assert file[0] not in ".-~"
    assert file.isprintable()
    assert len(file.encode()) < 200
    assert file_name(file.removesuffix(".html"), "html") == file


@pytest.mark.parametrize("name", ["heater", "Motor 2, left", "Wärme-01", "run (3)", "v1.2"])
def test_good_names_stay(name):
    assert file_name(name, "html") == f"{name}.html"


def test_two_studies_never_share_a_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for names in (["a/b", "a-b"], ["Heater", "heater"], ["x", "x"], ["../x", "x"]):
        with pytest.raises(SearchError, match="would write the report"):
            report_places(names, None)
    assert [str(p) for p in report_places(["a", "b"], None)] == ["a.html", "b.html"]


def test_a_report_overwrites_only_a_report(tmp_path):
    for k, text in enumerate(["", "my notes", "<html>a page of mine</html>", "plantfit", "\0\0"]):
        file = tmp_path / f"{k}.html"
        file.write_text(text)
        with pytest.raises(StoreError, match="not a report of plantfit"):
            write_page(file, "new")
        assert file.read_text() == text
    old = tmp_path / "old.html"
    old.write_text('<!doctype html>\n<html lang="en">\n<head>\n<title>x · plantfit report</title>\n<style></style>')
    assert is_report(old)
    (tmp_path / "link.html").symlink_to(tmp_path / "1.html")
    for place in (tmp_path / "link.html", Path("/dev/null"), tmp_path / ("x" * 300), Path("a\0b")):
        with pytest.raises(StoreError):
            write_page(place, "new")
    assert (tmp_path / "1.html").read_text() == "my notes"


@pytest.mark.parametrize("words", [(), ("-o", "heater.csv"), ("-o", "nowhere/x.html"), ("-o", "."), ("-o", "x" * 300)])
def test_it_is_said_before_anything_runs(words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spec = heater(tmp_path)
    before = (tmp_path / "heater.csv").read_text()
    (tmp_path / "heater.html").write_text("my notes")
    said = call(capsys, monkeypatch, "run", spec.name, *words)
    assert said.code == 10
    assert said.err.count("\n") == 1
    assert not (tmp_path / "plantfit.db").exists()
    assert ((tmp_path / "heater.csv").read_text(), (tmp_path / "heater.html").read_text()) == (before, "my notes")


@pytest.mark.thorough
def test_a_report_of_a_study_with_a_hostile_name(tmp_path, capsys, monkeypatch):
    folder = tmp_path / "inner"
    folder.mkdir()
    monkeypatch.chdir(folder)
    spec = heater(folder)
    spec.write_text(spec.read_text().replace('"heater"', '"../escaped"') + "budget = 60\n")
    said = call(capsys, monkeypatch, "run", spec.name)
    assert said.code == 0, said.err
    assert said.out.endswith("Report: escaped.html\n")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["inner"]
    for words in (
        ["export"],
        ["export", "--parquet"],
        ["import", "escaped.json", "--store", "other.db"],
        ["report", "--store", "other.db"],
    ):
        assert call(capsys, monkeypatch, *words).code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["inner"]
    assert {"escaped.html", "escaped.json", "escaped.parquet"} <= {p.name for p in folder.iterdir()}


def test_an_export_overwrites_only_an_export_unless_told(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(Plan("settings", ("pso",), runs=2, budget=20), objective(), Store.open("plantfit.db"), search=FakeSearch())
    (tmp_path / "settings.json").write_text('{"mine": 1}')
    said = call(capsys, monkeypatch, "export")
    assert (said.code, json.loads((tmp_path / "settings.json").read_text())) == (10, {"mine": 1})
    assert call(capsys, monkeypatch, "export", "-o", "settings.json").code == 0
    assert call(capsys, monkeypatch, "export").code == 0
