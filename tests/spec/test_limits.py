"""What is too large, or cannot be, is told before work begins."""

import tracemalloc

import pytest

from plantfit.errors import PlantfitError, SearchError
from plantfit.recording import read
from plantfit.recording.readers.memory import free_memory, memory_needed
from plantfit.spec import parse
from plantfit.study import Plan

TEXT = """
name = "x"
[recording.a]
file = "x.csv"
[model]
equations = "x' = (K*delay(u, L) - x)/2; y = x"
inputs = { u = "" }
states = { x = "" }
outputs = { y = "" }
[parameters.K]
bounds = [0.0, 1.0]
[parameters.L]
bounds = [0.0, 1.0]
unit = "s"
"""


def parsed(text, tmp_path):
    (tmp_path / "x.csv").write_text("time,u,y\n" + "".join(f"{k},{k % 3},{k % 3}\n" for k in range(40)))
    return parse(text, tmp_path / "s.toml")


TABLE = f"[model.tables]\nk = {{ over = ['u', 'y'], nodes = [{list(range(200))}, {list(range(200))}] }}\n"
STATES = range(300)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[parameters.K]", "[search]\nruns = 2000000000\n[parameters.K]", "at most 1000000 runs"),
        ("[parameters.K]", "[simulation]\nsubsteps = 1000000000\n[parameters.K]", "substeps"),
        ("[parameters.K]", "[simulation]\nsubsteps = 900000\n[parameters.K]", ""),
        ('x = "" }', ", ".join(f'x{k} = ""' for k in STATES) + " }", "300 states"),
        ("[parameters.K]\n", f"{TABLE}[parameters.K]\n", "40000 nodes"),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = "drop_outliers", signal = "u", window = 1000000001 }]',
         "window"),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = "lowpass", signal = "u", cutoff = 0.1, order = 400 }]',
         "order"),
        ("bounds = [0.0, 1.0]\n[parameters.L]", "bounds = [0.0, 1.0]\nstart = 2.0\n[parameters.L]",
         "outside its bounds"),
        ('[0.0, 1.0]\nunit = "s"', '[-1.0, 1.0]\nunit = "s"', "dead time"),
    ],
    ids=lambda t: str(t)[:30],
)  # fmt: skip
def test_limits(old, new, told, tmp_path):
    assert old in TEXT
    if not told:
        parsed(TEXT.replace(old, new), tmp_path)
        return
    tracemalloc.start()
    with pytest.raises(PlantfitError, match=told):
        parsed(TEXT.replace(old, new), tmp_path)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_the_text_itself_is_good_and_signal_is_what_cleaning_steps_take(tmp_path):
    parsed(TEXT, tmp_path)
    study = parsed(
        TEXT.replace('"x.csv"', '"x.csv"\nclean = [{ step = "lowpass", signal = "u", cutoff = 0.1 }]'), tmp_path
    )
    assert "low-pass" in " ".join(study.problem.experiments["a"].recording.log)


def test_runs_of_a_plan():
    with pytest.raises(SearchError, match="at most"):
        Plan("x", runs=1_000_001)
    Plan("x", runs=1_000_000)


def test_a_file_larger_than_the_memory_is_not_read(tmp_path, monkeypatch):
    file = tmp_path / "x.csv"
    file.write_text("time,u\n0,1\n1,2\n")
    monkeypatch.setattr("plantfit.recording.readers.any_format.free_memory", lambda: 50)
    with pytest.raises(PlantfitError, match="GiB are free"):
        read(file)
    monkeypatch.setattr("plantfit.recording.readers.any_format.free_memory", lambda: None)  # nobody says
    assert len(read(file)) == 2
    assert memory_needed(file) == 12 * file.stat().st_size


def test_free_memory(tmp_path):
    info, group = tmp_path / "meminfo", tmp_path / "group"
    assert free_memory(info, group) is None
    info.write_text("MemTotal: 9 kB\nMemAvailable:    100 kB\n")
    assert free_memory(info, group) == 102400
    group.mkdir()
    (group / "memory.max").write_text("max\n")
    (group / "memory.current").write_text("7\n")
    assert free_memory(info, group) == 102400
    (group / "memory.max").write_text("1007\n")
    assert free_memory(info, group) == 1000
    # cached files count as used, but are given back
    (group / "memory.stat").write_text("anon 5\nfile 900\ninactive_file 600\nactive_file 250\n")
    assert free_memory(info, group) == 1850
