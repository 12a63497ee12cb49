"""What finishing found is kept in the store: used to the last bit where nothing has changed, and found anew where
anything has."""

import json
import os
import sqlite3
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from face_plants import lasting

import plantfit as pf
from plantfit import stages
from plantfit.errors import Status, StoreError
from plantfit.models import Declared, Model, Table
from plantfit.optimize.contract import RunResult
from plantfit.problem import Problem
from plantfit.problem.measure.scale_source import ScaleSource
from plantfit.space import Parameter
from plantfit.study import begin
from plantfit.study.running import runner
from plantfit.trust.finish.stored import finish_bytes, finish_of_bytes

pytestmark = pytest.mark.thorough

T = np.array([0.0, 1.0, 2.0, 4.0, 7.0, 10.0])
STUDY = """\
name = "growth"
[recording.run]
file = "growth.csv"
[model]
equations = \"\"\"
x' = r*x*(k - x)
y = x
w = x^2
\"\"\"
outputs = ["y", "w"]
[model.states]
x = { initial = "1e-4" }
[parameters.r]
bounds = [0.5, 20]
scale = "log"
[parameters.k]
bounds = [0.5, 2]
[search]
methods = ["least_squares"]
runs = 2
budget = 400
seed = 3
"""


def write_growth(folder):
    """Growth from little to its end between two samples, so that steps are a mesh; two outputs whose scales the fit
    estimates."""
    noise = 0.01 * np.random.default_rng(2).normal(size=(2, len(T)))
    y = 1.0 / (1.0 + (1e4 - 1.0) * np.exp(-3.0 * T))
    rows = ["t,y,w", *(f"{a:g},{b:.6f},{c:.6f}" for a, b, c in zip(T, y + noise[0], y**2 + noise[1], strict=True))]
    (folder / "growth.csv").write_text("\n".join(rows))
    (folder / "growth.toml").write_text(STUDY)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("growth")
    write_growth(place)
    # in a process with strings of other hashes
    words = ["run", "growth.toml", "--store", "lab.db", "--out", "growth.html"]
    code = f"import sys; sys.argv = ['plantfit', *{words!r}]; from plantfit.cli.start import run; run()"
    done = subprocess.run([sys.executable, "-c", code], cwd=place, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return place


@pytest.fixture
def finished(monkeypatch):
    """The numbers of runs that were finished since the test began."""
    seen, real = [], stages.finish

    def finish(problem, runs):
        seen.append(len(runs))
        return real(problem, runs)

    monkeypatch.setattr(stages, "finish", finish)
    return seen


@pytest.fixture(scope="module")
def anew(folder):
    """The answer of the same study without what was kept."""
    copy = folder / "copy.db"
    with sqlite3.connect(folder / "lab.db") as source, sqlite3.connect(copy) as target:
        source.backup(target)
        target.execute("DROP TABLE finish")
    return pf.open_study(1, copy)


def ends(answer):
    return [(r.x.tobytes(), r.cost, r.extra) for r in answer.runs]


def alike(one, other):
    assert ends(one) == ends(other)
    assert json.dumps(lasting(one.findings)) == json.dumps(lasting(other.findings))
    assert list(one.problem.mesh) == list(other.problem.mesh)
    for name, t in one.problem.mesh.items():
        np.testing.assert_array_equal(t, other.problem.mesh[name])
    for output, y in one.predict("run").items():
        np.testing.assert_array_equal(y, other.predict("run")[output])


def test_a_study_that_is_opened_again_has_the_same_bits_and_is_not_finished_again(folder, anew, finished):
    opened = pf.open_study("growth", folder / "lab.db")
    assert finished == []
    assert opened.problem.mesh  # there was something to find
    assert {s.kind for s in opened.problem.scale_sources.values()} == {"residuals"}
    alike(opened, anew)


def test_a_study_from_python_is_kept_and_given_to_commands(folder, finished, tmp_path):
    fitted = pf.fit(
        pf.load(folder / "growth.toml").problem, "least_squares", runs=2, budget=400, seed=3, store=tmp_path / "s.db"
    )
    assert finished == [2]
    opened = pf.open_study(1, tmp_path / "s.db")
    fitted.findings["reproduction"]["command"] = opened.command  # the store does not keep what a program called itself
    alike(fitted, opened)
    code = (
        "import sys; from plantfit import stages; stages.finish = None\nsys.argv = "
        f"['plantfit', 'export', 'growth.toml', '--store', {str(tmp_path / 's.db')!r}, '--to', "
        f"'python', '--out', {str(tmp_path)!r}]\nfrom plantfit.cli.start import run; run()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert finished == [2]


def test_another_study_file_or_other_data_are_finished_anew(folder, finished, tmp_path):
    given, store = pf.load(folder / "growth.toml").problem, folder / "lab.db"
    pf.open_study(1, store, problem=given)
    assert finished == []
    # one that costs the same everywhere, so that nothing but the key tells it from the first
    (folder / "typical.toml").write_text(STUDY.replace("[parameters.k]\n", "[parameters.k]\ntypical = 1.0\n"))
    pf.open_study(1, store, problem=pf.load(folder / "typical.toml").problem)
    assert finished == [2]
    text = (folder / "growth.csv").read_text()
    try:
        (folder / "growth.csv").write_text(text.replace("\n4,", "\n4,1"))
        with pytest.raises(StoreError, match="Study 1 began with another problem"):
            pf.open_study(1, store)
        assert finished == [2]
    finally:
        (folder / "growth.csv").write_text(text)
    pf.open_study(1, store)
    pf.open_study(1, store)
    assert finished == [2, 2]  # the other study had taken the place


def test_more_runs_are_finished_anew(folder, finished, tmp_path):
    study, store = pf.load(folder / "growth.toml"), pf.Store.open(tmp_path / "s.db")
    prepared = stages.prepare(study.problem)
    plan = pf.Plan("growth", ("least_squares",), 2, 400, 3, chunk=1)
    number = begin(plan, prepared.objective, store, spec_text=study.text, spec_path=str(study.path),
                   coordinates=("r", "k"),
                   to_physical=prepared.to_physical)  # fmt: skip
    runner.resume(
        store, number, prepared.objective, to_physical=prepared.to_physical, stop=lambda: store.counts(number)[2] > 0
    )
    assert store.counts(number)[2] == 1
    pf.open_study(number, store)
    pf.open_study(number, store)
    assert finished == [1]
    runner.resume(store, number, prepared.objective, to_physical=prepared.to_physical)
    assert len(pf.open_study(number, store).runs) == 2
    assert finished == [1, 2]


@pytest.mark.parametrize(
    "damage", ["substr(content, 1, length(content) - 1)", "'text'", "7", "x''", "x'00' || substr(content, 2)"]
)
def test_a_damaged_record_is_found_anew_and_mended(folder, anew, finished, damage):
    with sqlite3.connect(folder / "lab.db") as connection:
        assert connection.execute(f"UPDATE finish SET content = {damage}").rowcount == 1
    assert ends(pf.open_study(1, folder / "lab.db")) == ends(anew)
    assert finished == [2]
    pf.open_study(1, folder / "lab.db")
    assert finished == [2]


def test_older_and_read_only_stores_are_opened_and_finished(folder, anew, finished, tmp_path, monkeypatch):
    place = tmp_path / "old.db"
    with sqlite3.connect(folder / "lab.db") as source, sqlite3.connect(place) as target:
        source.backup(target)
        target.execute("DROP TABLE finish")
    before, real = place.read_bytes(), os.access
    with monkeypatch.context() as patch:
        patch.setattr(
            os, "access", lambda path, mode: real(path, mode) and not (mode == os.W_OK and str(path) == str(tmp_path))
        )
        assert ends(pf.open_study(1, place)) == ends(anew)
        pf.open_study(1, place)
    assert finished == [2, 2]
    assert place.read_bytes() == before
    pf.open_study(1, place)
    pf.open_study(1, place)
    assert finished == [2, 2, 2]


def test_a_deleted_study_leaves_nothing(folder, tmp_path):
    with sqlite3.connect(folder / "lab.db") as source, sqlite3.connect(tmp_path / "s.db") as target:
        source.backup(target)
        assert target.execute("SELECT count(*) FROM finish").fetchone() == (1,)
    pf.Store.open(tmp_path / "s.db").delete(1)
    with sqlite3.connect(tmp_path / "s.db") as connection:
        assert connection.execute("SELECT count(*) FROM finish").fetchone() == (0,)


def test_code_of_other_packages_is_never_taken_for_the_same(finished, tmp_path):
    model = Model(
        name="own", states={"x": None}, inputs={}, outputs={"x": None}, parameters=(Declared("k", None, (0.1, 1.0)),),
        derivative=lambda x, u, p: {"x": -p["k"] * x["x"]}, initial_state=lambda p, u, y: {"x": 1.0}, output=lambda x,
        u, p: {"x": x["x"]},
    )  # fmt: skip
    t = np.arange(10.0)
    problem = pf.Problem(model, pf.from_arrays({"t": t, "x": np.exp(-0.3 * t)}, name="run"), name="own")
    answer = pf.fit(problem, "least_squares", budget=100, store=tmp_path / "s.db")
    assert pf.open_study(1, tmp_path / "s.db", problem=problem).values == answer.values
    assert finished == [1, 1]


def test_strengths_and_who_chose_a_scale_come_back():
    nodes = (0.0, 1.0, 2.0, 3.0)
    table = Table("f", ("u",), (nodes,), "V")
    model = Model(
        name="curve", states={}, inputs={"u": None}, outputs={"y": "V", "z": "V"},
        parameters=(Declared("f", "V", (-2.0, 2.0), shape=table.shape),),
        output=lambda x, u, p: {"y": table(p["f"], u["u"]), "z": 0.0 * u["u"]}, tables=(table,),
    )  # fmt: skip
    u = np.linspace(0.0, 3.0, 12)
    record = pf.from_arrays({"u": u, "y": (np.sin(u), "V"), "z": (0.1 * u, "V")}, period=1.0, name="r")
    problem = Problem(model, record, {"f": Parameter((-2.0, 2.0), "V", smooth="reml")}, scales={"z": 2.0})
    final = problem.with_smoothing({("f", "u"): 1.0 / 3.0}).with_scales(
        {"y": 0.1 + 0.2}, ScaleSource("residuals", 3, False)
    )
    runs = [
        RunResult("m", k, 1, np.zeros(4), np.inf, 7.0, 0.1, Status.budget, np.ones(1), np.ones(1)) for k in range(2)
    ]
    costs = (-0.0, np.nan)
    found = [replace(r, x=np.full(4, 0.1 * r.run), cost=costs[r.run], extra={"ended": "cut"}) for r in runs]
    read = finish_of_bytes(finish_bytes("key", final, found), "key", problem, runs)
    assert read is not None
    again, results = read
    assert again.smoothing is not None
    assert final.smoothing is not None
    assert (again.scales, again.scale_sources, again.smoothing.strengths) == (
        final.scales,
        final.scale_sources,
        final.smoothing.strengths,
    )
    assert [(r.x.tobytes(), np.float64(r.cost).tobytes(), r.extra) for r in results] == [
        (r.x.tobytes(), np.float64(r.cost).tobytes(), r.extra) for r in found
    ]
    z = np.array([0.3, 0.1, 0.9, 0.6])
    assert float(again.cost(z)) == float(final.cost(z))
    assert finish_of_bytes(finish_bytes("key", final, found), "other", problem, runs) is None
