"""A package as docs/plug-ins.md shows it, installed beside plantfit: its model, reader and method in Python, study
file and commands."""

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
    metadata(
        folder,
        "bench-tools",
        "\n".join(points).replace('[project.entry-points."', "[").replace('"]', "]").replace('"', "") + "\n",
    )
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
    command = (
        [sys.executable, "-c", code]
        if code
        else [sys.executable, "-c", "from plantfit.cli.start import run; run()", *words]
    )
    where = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(command, cwd=work, env=where, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout if status == 0 else done.stderr


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_the_parts_of_the_package_pass_their_exams(bench_tools):
    code = (
        "from pathlib import Path\nimport bench_tools as b, plantfit as pf\n"
        "from plantfit.testing import check_look, check_model, check_optimizer, check_reader\n"
        "check_model(b.leaky_tank()); check_reader(b.read_blog, 'tank.blog'); check_optimizer(b.ShrinkingBox())\n"
        "from plantfit.testing import check_candidate\n"
        "check_look(b.hum); check_candidate('sensor_curve', b.sensor_curve)\n"
        "check_model(pf.models.make('leaky_tank'))\n"
        "print(pf.methods.names()[-1], pf.models.names()[-1], pf.methods.describe(b.ShrinkingBox()).split(':')[0])\n"
        "print(pf.read('tank.blog', time='time [s]', signals={'h': 'h [m]'}).signals['h'].unit)\n"
    )
    assert run(bench_tools, code=code).split() == ["shrinking_box", "leaky_tank", "shrinking_box", "m"]


@pytest.mark.thorough
def test_a_look_of_a_package_is_said_beside_those_of_plantfit(bench_tools, tmp_path):
    folder, _ = bench_tools
    t = np.arange(2000) / 1000
    tone = 0.5 * np.sin(2 * np.pi * 50 * t + 1.0)
    y = np.where(t < 1, 0.0, 1 - np.exp(-(t - 1) / 0.1)) + 0.01 * np.random.default_rng(1).normal(size=2000)
    study = (
        'name = "lag"\n[recording.a]\nfile = "a.csv"\ntime = "t"\n[model]\nequations = "x\' = (K*u - x)/tau; y = '
        'x"\ninputs = { u = "1" }\n'
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

    metadata(
        tmp_path,
        "bad-tools",
        "[plantfit.looks]\na = math:sin\nb = no_such_module:f\nc = builtins:str\nd = grave_look:f\n",
    )
    text = (
        "from plantfit.recording.looks import Look\ndef f(r, name, _): "
        "return [Look('a', 'grave', r.name, name, 'It is.', 0.0, 1.0)]\n"
    )
    (tmp_path / "grave_look.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    offered.cache_clear()
    told = [k.sentence for k in looks_of_packages(Recording(np.arange(3.0), {"y": Signal(np.ones(3))}, "r"), "y", True)]
    offered.cache_clear()
    assert told[0].startswith("The look 'a' of the package bad-tools failed at y (TypeError")
    assert "cannot be loaded (ModuleNotFoundError" in told[1]
    assert told[2].startswith("The look 'c' of the package bad-tools failed at y (TypeError")
    assert "failed at y (ValueError: its level is 'grave', not 'info' or 'warning')" in told[3]


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
            return (
                ["jumps"]
                if wrong == "no look"
                else [Look("a", "info", "r", name, sentence, t[0], t[-1] + (wrong == "outside"))]
            )
        return []

    with pytest.raises(AssertionError):
        check_look(look)


LAG = """name = "lag"
[recording.a]
file = "a.csv"
time = "t"
[model]
equations = "x' = (K*u - x)/tau; y = x"
inputs = { u = "1" }
outputs = { y = "1" }
states = { x = { unit = "1", initial = 0 } }
[parameters.K]
bounds = [0.1, 10]
[parameters.tau]
bounds = [0.01, 10]
unit = "s"
"""


def lagging(folder, name, bend, extensions=""):
    """A recording of a lag of first order by its closed form, gain 2, whose sensor shows y + bend y^2; and its study
    file."""
    t, u = np.arange(600) * 0.05, np.repeat(np.random.default_rng(3).uniform(-2, 3, 20), 30)
    decay, y = np.exp(-0.05 / 0.4), np.zeros(600)
    for k in range(599):
        y[k + 1] = decay * y[k] + (1 - decay) * 2 * u[k]
    shown = y + bend * y**2 + 0.02 * np.random.default_rng(4).normal(size=600)
    np.savetxt(folder / f"{name}.csv", np.column_stack([t, u, shown]), "%.9g", ",", header="t [s],u,y", comments="")
    (folder / f"{name}.toml").write_text(
        LAG.replace("a.csv", f"{name}.csv").replace("[parameters.K]", f"{extensions}\n[parameters.K]")
    )


@pytest.mark.thorough
def test_a_candidate_of_a_package_is_tried_named_and_fitted(bench_tools, tmp_path):
    lagging(tmp_path, "bent", 0.03)
    lagging(tmp_path, "straight", 0.0)
    lagging(tmp_path, "treated", 0.03, "extensions = { sensor_curve = { y = [-1, 1] } }")
    code = (
        "import json, plantfit as pf\nfrom plantfit.spec import load\nbent, "
        "straight, treated = (pf.fit(load(f'{n}.toml').problem, budget=400) for n "
        "in ('bent', 'straight', 'treated'))\nprint(json.dumps([bent.diagnose(), "
        "straight.diagnose(whole=True), treated.findings['parameters']]))\n"
    )
    found, nothing, rows = json.loads(run((bench_tools[0], tmp_path), code=code))
    assert found["rounds"][0]["found"] == ["bend of the sensor of y"]
    assert found["verdict"][0]["sentence"].startswith("A bend of 0.030"), found["verdict"]
    assert " of the sensor of y explains " in found["verdict"][0]["sentence"]
    assert "bend of the sensor of y" in [t["name"] for t in nothing["rounds"][0]["tried"]]
    assert nothing["rounds"][0]["found"] == []
    bend = next(p for p in rows if p["name"] == "sensor_curve_y")
    assert abs(bend["value"] - 0.03) < 4 * bend["standard_error"] < 0.01
    assert bend["unit"] == "1/(1)"


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Writes a package with candidates, from its source and entry points."""
    from plantfit.trust.diagnosis.candidates import of_packages

    def write(source, points):
        (tmp_path / "bad_tools.py").write_text(source)
        metadata(tmp_path, "bad-tools", "[plantfit.candidates]\n" + points)
        monkeypatch.syspath_prepend(tmp_path)
        sys.modules.pop("bad_tools", None)
        for cache in (offered, of_packages):
            cache.cache_clear()

    yield write
    sys.modules.pop("bad_tools", None)
    monkeypatch.undo()
    for cache in (offered, of_packages):
        cache.cache_clear()


def test_candidates_that_cannot_be_used_are_one_sentence_each(packages):
    from plantfit.models.extensions import with_extensions
    from plantfit.models.library.process import first_order
    from plantfit.trust.diagnosis.candidates import CANDIDATES, Behind, candidates, of_packages

    packages(
        "from dataclasses import replace\nfrom plantfit.models.extensions import KINDS\n"
        "from plantfit.trust.diagnosis.candidates import CANDIDATES\n"
        "def fails(*given): raise ValueError('of no use')\n"
        "good = replace(CANDIDATES['offset'], extension=KINDS['offset'])\n"
        "elsewhere = replace(good, extension=KINDS['lag'])\n"
        "dumb = replace(good, phrase='an offset')\n"
        "lost = replace(good, extension=KINDS['offset']._replace(make=fails), law=fails)\n",
        "good = bad_tools:good\nelsewhere = bad_tools:elsewhere\ndumb = bad_tools:dumb\nbare = math:pi\nnone = "
        "no_such_module:f\n"
        "lost = bad_tools:lost\noffset = bad_tools:good\n",
    )
    with pytest.warns(
        UserWarning, match="'offset' of the package bad-tools is left out: plantfit has one of this name"
    ):
        rows, told = of_packages()
    assert list(rows) == ["good", "lost"]
    assert [
        t for t in told if "no candidate with an `extension`" in t and t.startswith("'bare' of the package bad-tools")
    ]
    assert [t for t in told if t.startswith("'none' of the package bad-tools cannot be loaded")]
    assert [
        t for t in told if "it is tried on outputs, and its extension is to inputs; update or uninstall bad-tools." in t
    ]
    assert [t for t in told if t.startswith("'dumb'") and "leaves out the signal or value" in t]
    assert set(candidates(Behind)) == {k for k, c in CANDIDATES.items() if isinstance(c, Behind)} | {"good", "lost"}
    assert "good_y" in {p.name for p in with_extensions(first_order(), {"good": {"y": (-1, 1)}}).parameters}
    with pytest.raises(
        ModelError, match=r"'lost' of the package bad-tools fails at 'y' \(ValueError: of no use\); update or uninstall"
    ):
        with_extensions(first_order(), {"lost": {"y": (-1, 1)}})
    with pytest.raises(ModelError, match=r"extensions name 'goof'\. Did you mean 'good'"):
        with_extensions(first_order(), {"goof": {"y": (-1, 1)}})
    with pytest.raises(
        ModelError, match=r"The candidate 'lost' of the package bad-tools failed \(ValueError: of no use\)"
    ):
        rows["lost"].law(np.zeros(3), np.zeros(3), np.zeros((3, 0)), 1.0, 1.0)  # pyrefly: ignore[missing-attribute]


def test_the_exam_of_candidates_passes_those_of_plantfit_and_refuses_others():
    from dataclasses import replace

    from plantfit.models.extensions import KINDS
    from plantfit.testing import check_candidate
    from plantfit.trust.diagnosis.candidates import CANDIDATES, Behind, Inside

    for kind in ("offset", "saturation", "quadratic"):  # those of all kinds: tests/trust/test_diagnosis_candidates.py
        check_candidate(kind, CANDIDATES[kind], KINDS[kind])
    good, own = CANDIDATES["offset"], KINDS["offset"]
    assert isinstance(good, Behind)
    zone: Any = CANDIDATES["dead_zone"]
    drag, braked = CANDIDATES["quadratic"], KINDS["quadratic"]
    assert isinstance(drag, Inside)
    wrong: list[tuple[str, Any, Any, str]] = [
        ("no extension", good, None, "it has no extension"),
        ("elsewhere", good, KINDS["lag"], "it is tried on outputs, and its extension is to inputs"),
        ("no sentence", replace(good, phrase=""), own, "its phrase is ''"),
        ("no signal", good, own._replace(sentence="it is off"), "its sentence of its extension is 'it is off'"),
        ("bounds", replace(good, bounds=lambda low, high, value: (0.0, value / 2)), own, "do not hold the value"),
        (
            "never nothing",
            replace(good, law=lambda t, y, j, v, s: (y + (v + 1) / s, j, np.full(len(y), 1 / s))),
            own,
            "at zero, where it is",
        ),
        (
            "not finite",
            replace(good, law=lambda t, y, j, v, s: (y + np.where(t > 1, v, np.inf), j, 1 + t)),
            own,
            "not finite",
        ),
        (
            "slope",
            replace(good, law=lambda t, y, j, v, s: (y + v / s, j, np.full(len(y), 2 / s))),
            own,
            "derivatives by its value differ",
        ),
        (
            "plant",
            replace(good, law=lambda t, y, j, v, s: (y + v / s, 0 * j, np.full(len(y), 1 / s))),
            own,
            "by the plant's parameters",
        ),
        (
            "bent",
            replace(good, law=lambda t, y, j, v, s: (y + v**2 / s, j, np.full(len(y), 2 * v / s))),
            own,
            "no straight line",
        ),
        ("another model", good, KINDS["drift"], "its law and its model differ"),
        (
            "fails",
            replace(zone, law=lambda t, u, v, held: 1 / 0),  # pyrefly: ignore[division-by-zero]
            KINDS["dead_zone"],
            "its law fails",
        ),
        (
            "changes",
            replace(zone, law=lambda t, u, v, held: np.clip(u, -v, v, out=u) * 0),
            KINDS["dead_zone"],
            "changes",
        ),
        (
            "no starts",
            replace(zone, tried=lambda s: replace(zone.tried(s), starts=())),
            KINDS["dead_zone"],
            "values to begin with",
        ),
        (
            "outside",
            replace(zone, tried=lambda s: replace(zone.tried(s), starts=(99.0,))),
            KINDS["dead_zone"],
            "outside of its range",
        ),
        (
            "still",
            drag,
            braked._replace(make=lambda m, x, b, n: braked.make(m, x, b, n + "_")),
            "its model has no parameter 'still_x'",
        ),
        ("no size", replace(drag, size=lambda spread, rate: float("nan")), braked, "its size is nan"),
    ]
    for kind, candidate, extension, words in wrong:
        with pytest.raises(AssertionError, match=words):
            check_candidate(kind.replace(" ", "_"), candidate, extension)


def test_what_is_wrong_with_a_package_is_one_sentence(tmp_path):
    points = "[plantfit.methods]\nbroken = no_such_module:Method\nno_method = math:sin\npso = math:cos\n"
    points += "[plantfit.models]\nno_factory = math:pi\n[plantfit.readers]\nrlog = math:sin\n"
    metadata(tmp_path / "site", "bad-tools", points)
    (tmp_path / "a.rlog").write_bytes(b"123")
    code = (
        "import warnings\nwarnings.simplefilter('ignore')\nimport plantfit as pf\n"
        "for ask in (lambda: pf.methods.make('broken'), lambda: pf.methods.make('no_method'), lambda: "
        "pf.models.make('no_factory'),\n"
        "            lambda: pf.read('a.rlog', time='t')):\n"
        "    try: ask()\n"
        "    except pf.PlantfitError as error: print(type(error).__name__, error)\n"
        "print(pf.methods.make('pso'))\n"
    )
    lines = run((tmp_path / "site", tmp_path), code=code).splitlines()
    for line, (kind, words) in zip(
        lines,
        [
            (
                SearchError,
                "'broken' of the package bad-tools cannot be loaded (ModuleNotFoundError: No module named "
                "'no_such_module')",
            ),
            (SearchError, "'no_method' of the package bad-tools is no search method"),
            (ModelError, "'no_factory' of the package bad-tools is not a function that makes a model"),
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
    parts = {
        "states": {"x": None},
        "inputs": {"u": None},
        "outputs": {"y": None},
        "parameters": (Declared("T", bounds=(1.0, 2.0)),),
    }
    good = Model(
        "good",
        **parts,
        output=lambda x, u, p: {"y": x["x"]},
        derivative=lambda x, u, p: {"x": (u["u"] - x["x"]) / p["T"]},
    )
    check_model(good)
    with pytest.raises(AssertionError):
        check_model(Model(wrong, **parts, output=lambda x, u, p: {"y": x["x"]}, derivative=laws[wrong]))


@pytest.mark.thorough
def test_the_exam_of_models_passes_those_of_plantfit():
    import plantfit as pf
    from plantfit.models.model import Model
    from plantfit.testing import check_model

    for name in pf.models.names():
        model = pf.models.make(name)
        if isinstance(model, Model):
            check_model(model)


@pytest.mark.parametrize(
    "reader", [lambda p: [1.0], lambda p: {"a": np.zeros((2, 2))}, lambda p: {"a": np.array(["x"])}]
)
def test_the_exam_of_readers_refuses(reader, tmp_path):
    from plantfit.testing import check_reader

    (tmp_path / "a.log").write_bytes(b"12345")
    check_reader(lambda p: {"a": np.frombuffer(p.read_bytes(), "u1")}, tmp_path / "a.log")
    with pytest.raises(AssertionError):
        check_reader(reader, tmp_path / "a.log")
