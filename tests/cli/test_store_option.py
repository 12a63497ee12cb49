"""What a message adds to a command so that it reaches the store: nothing for the usual one, quotes, and never a
password."""

from pathlib import Path

import pytest

from plantfit.cli.commands.next_step.tuned_study import answer_for
from plantfit.errors import StoreError
from plantfit.spec.tables import validated
from plantfit.study.store.addresses import STORE, store_option


def test_the_option_reaches_the_store_and_hides_its_password():
    assert store_option(STORE) == ""
    assert store_option("s.db") == " --store s.db"
    assert store_option("my studies.db") == " --store 'my studies.db'"
    told = store_option("postgresql://ann:s3cret@host/db")
    assert "s3cret" not in told
    assert told.startswith(" --store ")


def test_a_store_that_is_not_there_is_named_with_a_command_that_can_be_pasted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = validated('name = "s"\n[recording.a]\nfile = "x.csv"\n[model]', Path("s.toml"))
    with pytest.raises(StoreError, match=r"`plantfit run s.toml --store 'my studies.db'`\.$"):
        answer_for(table, Path("s.toml"), None, "my studies.db")
