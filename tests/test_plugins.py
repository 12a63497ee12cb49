"""A package as docs/plug-ins.md shows it, installed beside plantfit: its model, reader and method in Python, study file and commands."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plantfit.errors import ModelError, RecordingError, SearchError
from plantfit.plugins import offered

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "plug-ins.md").read_text("utf-8")
TRUTH = {"A": 0.02, "c": 2e-4}  # m2, m2.5/s


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.S)


def metadata(folder: Path, package: str, points: str) -> None:
    info = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)


@pytest.fixture(scope="module")
def bench_tools(tmp_path_factory):
    """The folder of the package of the page, and that of its study."""
    folder, work = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("work")
    [project, study] = blocks("toml")
    points = [line for line in project.splitlines() if '"bench_tools' in line or line.startswith("[project.entry")]
    metadata(folder, "bench-tools", "\n".join(points).replace('[project.entry-points."', "[").replace('"]', "]").replace('"', "") + "\n")
    (folder / "bench_tools.py").write_text("\n".join(blocks("python")))
    (work / "tank.toml").write_text(study)
    t = np.arange(0, 400.0, 2.0)
    q, h = np.where(t % 200 < 100, 12.0, 4.0), np.empty(len(t))
    h[0] = 0.3
    for k in range(len(t) - 1):  # Euler's steps of 1 ms: the tank is slow
        level = h[k]
        for _ in range(2000):
            level += 1e-3 * (q[k] / 60000 - TRUTH["c"] * np.sqrt(level)) / TRUTH["A"]
        h[k + 1] = level
    rows = np.column_stack([t, q, h + np.random.default_rng(1).normal(0, 1e-3, len(t))])
    names = b"".join(n.encode().ljust(16, b"\0") for n in ("time [s]", "q [l/min]", "h [m]"))
    (work / "tank.blog").write_bytes(bytes([3]) + names + rows.astype("<f8").tobytes())
    return folder, work


def run(bench_tools, *words, code=None, status=0):
    folder, work = bench_tools
    command = [sys.executable, "-c", code] if code else [sys.executable, "-c", "from plantfit.cli.start import run; run()", *words]
    done = subprocess.run(command, cwd=work, env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout if status == 0 else done.stderr


def test_a_study_runs_with_model_reader_and_method_of_a_package(bench_tools):
    listed = {m["name"]: m for m in json.loads(run(bench_tools, "methods", "--json"))}
    assert listed["shrinking_box"]["sentence"].startswith("Uniform points in a box around the best point")
    assert listed["shrinking_box"]["paper"] == "an example"
    assert "leaky_tank" in run(bench_tools, "models")
    run(bench_tools, "check", "tank.toml")
    found = json.loads(run(bench_tools, "run", "tank.toml", "--json"))
    rows = {p["name"]: p for p in found["parameters"]}
    assert {r["method"] for r in found["runs"]} == {"shrinking_box"}
    for name, truth in TRUTH.items():
        assert abs(rows[name]["value"] - truth) < 4 * rows[name]["standard_error"] < 0.1 * truth


def test_the_parts_of_the_package_pass_their_exams(bench_tools):
    code = (
        "from pathlib import Path\nimport bench_tools as b, plantfit as pf\n"
        "from plantfit.testing import check_look, check_model, check_optimizer, check_reader\n"
        "check_model(b.leaky_tank()); check_reader(b.read_blog, 'tank.blog'); check_optimizer(b.ShrinkingBox())\n"
        "check_look(b.hum)\n"
        "check_model(pf.models.make('leaky_tank'))\n"
        "print(pf.methods.names()[-1], pf.models.names()[-1], pf.methods.describe(b.ShrinkingBox()).split(':')[0])\n"
        "print(pf.read('tank.blog', time='time [s]', signals={'h': 'h [m]'}).signals['h'].unit)\n"
    )
    assert run(bench_tools, code=code).split() == ["shrinking_box", "leaky_tank", "shrinking_box", "m"]


def test_a_look_of_a_package_is_said_beside_those_of_plantfit(bench_tools, tmp_path):
    folder, _ = bench_tools
    t = np.arange(2000) / 1000
    tone = 0.5 * np.sin(2 * np.pi * 50 * t + 1.0)
    y = np.where(t < 1, 0.0, 1 - np.exp(-(t - 1) / 0.1)) + 0.01 * np.random.default_rng(1).normal(size=2000)
    study = (
        'name = "lag"\n[recording.a]\nfile = "a.csv"\ntime = "t"\n[model]\nequations = "x\' = (K*u - x)/tau; y = x"\ninputs = { u = "1" }\n'
        'outputs = { y = "1" }\nstates = { x = "1" }\n[parameters.K]\nbounds = [0.1, 10]\n'
        '[parameters.tau]\nbounds = [0.01, 1]\nunit = "s"\n'
    )
    (tmp_path / "lag.toml").write_text(study)
    for hums in (True, False):
        rows = np.column_stack([t, t >= 1, y + (tone if hums else 0)])
        np.savetxt(tmp_path / "a.csv", rows, "%.9g", ",", header="t [s],u,y", comments="")
        looks = json.loads(run((folder, tmp_path), "check", "lag.toml", "--json"))["data"]
        found = [k for k in looks if k["kind"] == "hum"]
        assert len(found) == hums, looks
        if hums:
            assert found[0]["sentence"].startswith("y hums with 50 Hz and an amplitude of 0.")
            assert "lowpass" in found[0]["write"]


def test_a_look_that_fails_is_one_sentence(tmp_path, monkeypatch):
    from plantfit.recording.looks.of_packages import looks_of_packages
    from plantfit.recording.record import Recording, Signal

    metadata(tmp_path, "bad-tools", "[plantfit.looks]\na = math:sin\nb = no_such_module:f\nc = builtins:str\n")
    monkeypatch.syspath_prepend(tmp_path)
    offered.cache_clear()
    told = [k.sentence for k in looks_of_packages(Recording(np.arange(3.0), {"y": Signal(np.ones(3))}, "r"), "y", True)]
    offered.cache_clear()
    assert told[0].startswith("The look 'a' of the package bad-tools failed at y (TypeError")
    assert "cannot be loaded (ModuleNotFoundError" in told[1]
    assert told[2].startswith("The look 'c' of the package bad-tools failed at y (TypeError")


@pytest.mark.parametrize("wrong", ["fails", "noisy", "no look", "no sentence", "outside"])
def test_the_exam_of_looks_refuses(wrong):
    from plantfit.recording.looks import Look
    from plantfit.testing import check_look

    def look(recording, name, measured) -> Any:
        y, t = recording[name], recording.t
        there = np.isfinite(y)
        if wrong == "fails":
            return [int(np.nanmax(y))]
        if wrong == "noisy" or (there.any() and np.ptp(y[there]) > 100):
            sentence = "It jumps" if wrong == "no sentence" else "It jumps."
            return ["jumps"] if wrong == "no look" else [Look("a", "info", "r", name, sentence, t[0], t[-1] + (wrong == "outside"))]
        return []

    with pytest.raises(AssertionError):
        check_look(look)


def test_what_is_wrong_with_a_package_is_one_sentence(tmp_path):
    points = "[plantfit.methods]\nbroken = no_such_module:Method\nno_method = math:sin\npso = math:cos\n"
    points += "[plantfit.models]\nno_factory = math:pi\n[plantfit.readers]\nrlog = math:sin\n"
    metadata(tmp_path / "site", "bad-tools", points)
    (tmp_path / "a.rlog").write_bytes(b"123")
    code = (
        "import warnings\nwarnings.simplefilter('ignore')\nimport plantfit as pf\n"
        "for ask in (lambda: pf.methods.make('broken'), lambda: pf.methods.make('no_method'), lambda: pf.models.make('no_factory'),\n"
        "            lambda: pf.read('a.rlog', time='t')):\n"
        "    try: ask()\n"
        "    except pf.PlantfitError as error: print(type(error).__name__, error)\n"
        "print(pf.methods.make('pso'))\n"
    )
    lines = run((tmp_path / "site", tmp_path), code=code).splitlines()
    for line, (kind, words) in zip(
        lines,
        [
            (SearchError, "'broken' of the package bad-tools cannot be loaded (ModuleNotFoundError: No module named 'no_such_module')"),
            (SearchError, "'no_method' of the package bad-tools is no search method"),
            (ModelError, "'no_factory' of the package bad-tools is no function"),
            (RecordingError, "a.rlog cannot be read (TypeError"),
        ],
        strict=False,
    ):
        assert line.startswith(kind.__name__), lines
        assert words in line
    assert lines[4].startswith("ParticleSwarm"), "plantfit's own method has its name"


def test_names_that_are_taken_are_left_out_with_a_warning(monkeypatch, tmp_path):
    metadata(tmp_path, "bad-tools", "[plantfit.models]\nfirst_order = math:pi\nmine = math:pi\n")
    metadata(tmp_path, "a-tools", "[plantfit.models]\nmine = math:e\n")
    monkeypatch.syspath_prepend(tmp_path)
    offered.cache_clear()
    with pytest.warns(UserWarning, match="left out") as told:
        found = offered("models", frozenset({"first_order"}))
    offered.cache_clear()
    assert {n: p.package for n, p in found.items()} == {"mine": "a-tools"}
    assert sorted(str(w.message).split(" is left out: ")[1] for w in told) == [
        "a-tools has one of this name.",
        "plantfit has one of this name.",
    ]


@pytest.mark.parametrize("wrong", ["impure", "kinked", "silent"])
def test_the_exam_of_models_refuses(wrong):
    from plantfit.models.model import Declared, Model
    from plantfit.testing import check_model

    import jax

    count = iter(range(10**6))
    laws = {
        "impure": lambda x, u, p: {"x": (u["u"] - x["x"]) / p["T"] + 1e-3 * next(count)},
        "kinked": lambda x, u, p: {"x": jax.lax.stop_gradient((u["u"] - x["x"]) / p["T"])},
        "silent": lambda x, u, p: {},
    }
    parts = {"states": {"x": None}, "inputs": {"u": None}, "outputs": {"y": None}, "parameters": (Declared("T", bounds=(1.0, 2.0)),)}
    good = Model("good", **parts, output=lambda x, u, p: {"y": x["x"]}, derivative=lambda x, u, p: {"x": (u["u"] - x["x"]) / p["T"]})
    check_model(good)
    with pytest.raises(AssertionError):
        check_model(Model(wrong, **parts, output=lambda x, u, p: {"y": x["x"]}, derivative=laws[wrong]))


def test_the_exam_of_models_passes_those_of_plantfit():
    import plantfit as pf
    from plantfit.models.model import Model
    from plantfit.testing import check_model

    for name in pf.models.names():
        model = pf.models.make(name)
        if isinstance(model, Model):
            check_model(model)


@pytest.mark.parametrize("reader", [lambda p: [1.0], lambda p: {"a": np.zeros((2, 2))}, lambda p: {"a": np.array(["x"])}])
def test_the_exam_of_readers_refuses(reader, tmp_path):
    from plantfit.testing import check_reader

    (tmp_path / "a.log").write_bytes(b"12345")
    check_reader(lambda p: {"a": np.frombuffer(p.read_bytes(), "u1")}, tmp_path / "a.log")
    with pytest.raises(AssertionError):
        check_reader(reader, tmp_path / "a.log")
