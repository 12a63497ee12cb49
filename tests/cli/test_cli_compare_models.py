"""`plantfit compare` of study files and `plantfit look`, on a heater whose truth is known."""

import pytest
from cli_call import call, heater


@pytest.mark.thorough
def test_study_files_are_fitted_once_compared_and_a_difference_of_data_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    good = heater(tmp_path)
    text = good.read_text()
    wrong = text.replace('"heater"', '"instant"').replace("delay(u, L)", "(u + 0*L)")
    (tmp_path / "instant.toml").write_text(wrong)
    said = call(capsys, monkeypatch, "compare", "heater.toml", "instant.toml", "--json")
    assert said.code == 0, said.err
    record = said.record("compare")
    assert record["verdict"][0]["sentence"].startswith("heater.toml predicts unseen data better: RMSE 0.")
    assert [m["name"] for m in record["models"]] == ["heater.toml", "instant.toml", "linear"]
    assert record["pairs"][0]["told"]
    assert "residual of instant.toml" in (tmp_path / "compare.html").read_text()

    again = call(capsys, monkeypatch, "compare", "heater.toml", "instant.toml")
    assert "study 1 has its answer" in again.err
    assert "deg" in again.out
    stored = call(capsys, monkeypatch, "compare", "1", "2", "--json", "--no-linear").record("compare")
    assert [m["rmse"] for m in stored["models"]] == [m["rmse"] for m in record["models"][:2]]

    (tmp_path / "half.toml").write_text(text.replace("split = 0.7", "split = 0.5"))
    said = call(capsys, monkeypatch, "compare", "heater.toml", "half.toml")
    assert said.code == 3
    assert "are fitted in heater.toml and 200 in half.toml; give both the same split" in said.err

    assert call(capsys, monkeypatch, "look", "heater.toml", "--json").record("look")["recording"] == "bench"
    said = call(capsys, monkeypatch, "look", "heater.toml")
    assert said.code == 0, said.err
    assert "of the unseen T: RMSE 0.0" in said.out
    assert (tmp_path / "heater-look.html").exists()


def test_what_cannot_be_compared_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    heater(tmp_path)
    for words, told in (
        (("heater.toml", "--methods"), "--methods compares the runs"),
        (("heater.toml", "--no-linear"), "One model alone cannot be compared"),
        (("heater.toml", "heater.toml"), "is given twice"),
        (("heater.toml", "--latex", "t.tex"), "--latex is for comparisons of search methods"),
    ):
        said = call(capsys, monkeypatch, "compare", *words)
        assert said.code == 8, said.err
        assert told in said.err
