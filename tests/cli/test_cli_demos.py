"""`plantfit demo --list`, and what was found as the first part of a demo's record."""

import json

from cli_call import call

from plantfit.cases.shared.record import FOUND, record
from plantfit.cases.shared.registry import demos, seconds


def test_the_list_says_what_each_shows_and_how_long_it_takes(capsys, monkeypatch):
    said = call(capsys, monkeypatch, "demo", "--list")
    assert said.code == 0
    lines = {line.split()[0]: line for line in said.out.splitlines() if line.strip()}
    for name, (sentence, _) in demos().items():
        assert sentence in lines[name]
        assert " about " in lines[name]
    assert "about 5 s" in lines["heater"]
    assert "about 1 min" in lines["steam"]
    assert "one core of an x86-64 server" in said.out
    told = json.loads(call(capsys, monkeypatch, "demo", "--list", "--json").out)
    assert told["tanks"] == {"sentence": demos()["tanks"][0], "seconds": seconds("tanks")}


def test_files_alone_are_copied_and_named(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "demo", "tanks", "--files")
    assert said.code == 0
    assert said.out.strip() == "Written into out/tanks: tanks.csv, tanks.toml"
    assert sorted(p.name for p in (tmp_path / "out" / "tanks").iterdir()) == ["README.md", "tanks.csv", "tanks.toml"]
    told = json.loads(call(capsys, monkeypatch, "demo", "tanks", "--files", "--out", "mine", "--json").out)
    assert told == {"name": "tanks", "folder": "mine/tanks", "files": ["tanks.csv", "tanks.toml"]}
    wrong = call(capsys, monkeypatch, "demo", "tank", "--files")
    assert wrong.code == 7
    assert "There is no demo 'tank'" in wrong.err
    assert not (tmp_path / "out" / "tank").exists()


def test_what_was_found_stands_first():
    made = record(
        "a", "A", [], [], [], [], [{"title": "Then", "sentences": ["more"]}], found=["One number.", "Another."]
    )
    assert [s["title"] for s in made["sections"]] == [FOUND, "Then"]
    assert made["sections"][0]["sentences"] == made["found"] == ["One number.", "Another."]
    assert record("a", "A", [], [], [], [])["sections"] == []
