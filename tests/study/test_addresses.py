"""No command, page, message or log shows the password of a store address."""

import json
import sys
import traceback
from pathlib import Path

import pytest
from sqlalchemy import URL
from study_fakes import FakeSearch, objective

from plantfit.cli.main import run_cli
from plantfit.errors import StoreError
from plantfit.study import Plan, Store, run
from plantfit.study.store.addresses import concealed, shown

SECRET = "hunter2@Zürich"
HIDDEN = ["h%C3%BC", "hunter2", "Zürich", "Z%C3%BCrich"]


@pytest.mark.parametrize(
    "place",
    [
        f"postgresql://me:{SECRET}@host:5432/name",
        "postgresql+psycopg://me:hunter2@host/name?sslmode=require",
        "postgresql://me@host/name?password=hunter2&host=/tmp",
        "postgresql://me@host/name?host=/tmp&PASSWORD=hunter2",
        "postgresql://host/name?sslpassword=hunter2",
        "postgresql://me:hunter2@host:notaport/name",
        "postgresql://:hunter2@host/name",
        "mysql://me:hunter2@host/name",
        URL.create("postgresql+psycopg", "me", SECRET, "host", 5432, "name").render_as_string(hide_password=False),
    ],
)
def test_passwords_are_masked_wherever_they_stand(place):
    for text in (
        shown(place),
        concealed(f"connection to {place} failed"),
        concealed(f"{SECRET} is wrong, hunter2", place),
    ):
        assert "hunter2@Z" not in text
        assert "***" in text or "hunter2" not in text
    assert not any(hidden in shown(place) for hidden in HIDDEN)
    assert shown(shown(place)) == shown(place)
    if "host=/tmp" in place:
        assert "host=/tmp" in shown(place)


@pytest.mark.parametrize(
    "place",
    ["plantfit.db", "a:b@c.db", "C:\\data\\x.db", "sqlite:///x.db", "postgresql://me@host:5432/name", Path("x.db")],
)
def test_addresses_without_passwords_stay_as_they_are(place):
    assert shown(place) == str(place)


def test_words_of_drivers():
    assert (
        concealed("could not connect with user=me password='two words' host=x")
        == "could not connect with user=me password=*** host=x"
    )
    assert concealed("no password supplied") == "no password supplied"


COMMANDS = [
    ["list"], ["report"], ["report", "7"], ["resume"], ["resume", "7"], ["compare"], ["compare", "1"], ["compare", "7"],
    ["export", "7"],
    ["workers"], ["workers", "7"], ["merge", "ADDRESS"], ["export", "1", "-o", "nowhere/x.json"],
]  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
@pytest.mark.parametrize("where", ["a server", "an empty server", "nobody there", "no port"])
@pytest.mark.further(6)
def test_no_command_shows_a_password(words, where, request, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "server" in where:
        url = (
            request.getfixturevalue("postgres_url").replace("plantfit@", "plantfit:hunter2@")
            + "&password=hunter3&sslpassword=hunter4"
        )
        if where == "a server":
            run(
                Plan("gearmotor", ("pso", "cmaes"), runs=3, budget=30),
                objective(),
                Store.open(url),
                search=FakeSearch(),
            )
    else:
        port = "1" if where == "nobody there" else "notaport"
        url = f"postgresql://me:hunter2@127.0.0.1:{port}/x?password=hunter3&sslpassword=hunter4"
    monkeypatch.setenv("PLANTFIT_STORE", url)
    monkeypatch.setattr(sys, "argv", ["plantfit", *(url if w == "ADDRESS" else w for w in words)])
    capsys.readouterr()
    code = 0
    try:
        run_cli()  # returns where all went well
    except SystemExit as ended:
        code = ended.code or 0
    said = capsys.readouterr()
    written = [p.read_text(errors="replace") for p in tmp_path.rglob("*") if p.is_file()]
    assert not any("hunter" in text for text in (said.out, said.err, *written))
    assert "Traceback" not in said.err
    if where == "a server" and words[:1] == ["compare"] and words != ["compare", "7"]:
        assert code == 0
        assert "***" in (tmp_path / "compare.html").read_text()
    if "server" not in where:
        assert code == 10


def test_tracebacks_of_python_have_no_password_either():
    for url in (
        "postgresql://me:hunter2@127.0.0.1:1/x?password=hunter3",
        "postgresql://me:hunter2@h:notaport/x",
        "postgresql://me:hunter2@[/x",
    ):
        with pytest.raises(StoreError) as raised:
            Store.open(url)
        assert "hunter" not in "".join(traceback.format_exception(raised.value)).replace(url, "")
        assert "hunter" not in json.dumps(str(raised.value))
