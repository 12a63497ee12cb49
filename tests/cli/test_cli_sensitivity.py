"""`plantfit sensitivity`: the same figures as in Python, and one sentence for what cannot be."""

import numpy as np
import pytest
from cli_call import call, heater

from plantfit import load
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.trust import morris, sobol_indices

AT = ["--set", "K=0.8", "--set", "T0=21", "--set", "tau=40", "--set", "L=3.4"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    heater(tmp_path)
    return tmp_path


def test_morris_around_a_point(folder, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "sensitivity", "heater.toml", *AT, "--seed", "5", "--out", "page.html", "--json")
    assert said.code == 0, said.err
    problem = choose_substeps(load("heater.toml").problem)
    at = problem.space.cube(problem.space.vector({"K": 0.8, "T0": 21.0, "tau": 40.0, "L": 3.4}))
    own = morris(problem, at, seed=5)
    rows = said.record("sensitivity")["groups"]
    assert [r["group"] for r in rows] == ["K", "T0", "tau", "L"]
    np.testing.assert_allclose([r["mu_star"] for r in rows], own.mu_star)
    assert "Elementary effects by group" in (folder / "page.html").read_text("utf-8")


@pytest.mark.thorough
def test_values_of_a_study_whose_file_or_recordings_have_changed_since_are_told(folder, capsys, monkeypatch):
    changed = "are those of study 1, which was of another problem: the study file or its recordings have changed"
    words = ("sensitivity", "heater.toml", "--trajectories", "4")
    assert call(capsys, monkeypatch, "run", "heater.toml", "--no-diagnose").code == 0
    text, table = (folder / "heater.toml").read_text(), (folder / "heater.csv").read_text()
    (folder / "heater.toml").write_text(text.replace("name = ", "# a comment is no change\nname = ", 1))
    same = call(capsys, monkeypatch, *words)
    assert same.code == 0, same.err
    assert changed not in same.err
    rows = table.splitlines(keepends=True)
    (folder / "heater.csv").write_text("".join(rows[: len(rows) // 2]))
    assert changed in " ".join(call(capsys, monkeypatch, *words).err.split())
    assert changed not in " ".join(call(capsys, monkeypatch, *words, *AT).err.split())  # nothing is taken from it
    (folder / "heater.csv").write_text(table)
    (folder / "heater.toml").write_text(text.replace("tau", "slow"))
    said = call(capsys, monkeypatch, *words)
    assert said.code == 10
    assert "Study 1 has no value for slow, which the file has: it has changed since." in " ".join(said.err.split())


def test_a_check_at_some_values_says_where_the_others_are(folder, capsys, monkeypatch):
    at = [w.replace("--set", "--at") for w in AT]
    assert "at K=0.8, the others in the middle of their bounds: RMSE" in " ".join(
        call(capsys, monkeypatch, "check", "heater.toml", *at[:2]).out.split()
    )
    assert "the others" not in call(capsys, monkeypatch, "check", "heater.toml", *at).out


def test_sobol_over_the_box_by_group(folder, capsys, monkeypatch):
    words = ["--method", "sobol", "--samples", "64", "--group", "rest=K,T0", "--group", "speed=tau,L"]
    said = call(capsys, monkeypatch, "sensitivity", "heater.toml", *words)
    assert said.code == 0, said.err
    problem = choose_substeps(load("heater.toml").problem)
    own = sobol_indices(problem, groups={"rest": ["K", "T0"], "speed": ["tau", "L"]}, samples=64)
    assert f"{own.total[0]:.4g}" in said.out
    assert "over the whole box; 256 evaluations" in said.out


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--method", "fast"], 8, "--method fast is unknown; use morris or sobol"),
        ([*AT[:-1], "L=30"], 6, "L = 30 lies outside of its bounds [0, 20]"),
        (["--set", "K=0.8"], 10, "plantfit.db"),
        ([*AT, "--group", "slow=mass"], 6, "Group 'slow' names 'mass', which is no free parameter"),
        ([*AT, "--group", "slow"], 6, "--group 'slow' cannot be read"),
        (["--box", "--radius", "0.1"], 8, "give one of them"),
        (["--method", "sobol", "--samples", "100"], 8, "give 64 or 128"),
        ([*AT, "--trajectories", "1"], 8, "trajectories = 1; give a whole number of at least 2"),
    ],
)
def test_bad_input_is_one_sentence(folder, capsys, monkeypatch, words, code, said):
    heard = call(capsys, monkeypatch, "sensitivity", "heater.toml", *words)
    assert heard.code == code, heard.err
    assert said in heard.err
    assert "Traceback" not in heard.err


def test_without_salib_the_package_is_named_before_anything_is_read(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("plantfit.trust.sensitivity.salib_extra.find_spec", lambda name: None)
    said = call(capsys, monkeypatch, "sensitivity", str(tmp_path / "none.toml"), "--box")
    assert (said.code, said.out) == (11, "")
    assert said.err == "plantfit: Sensitivity needs the package SALib; install it with: pip install 'plantfit[trust]'\n"


def test_the_steam_demo_says_what_is_left_out_without_salib():
    from plantfit.cases.steam.sections.screening_section import TITLE, not_screened
    from plantfit.report.case_page import render_case_page

    page = render_case_page({"title": "x", "sections": [not_screened()]})
    assert TITLE in page
    assert "Left out: the screening needs the package SALib" in page
