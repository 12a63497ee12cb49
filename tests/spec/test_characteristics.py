"""Tables of a model whose nodes and values stand in a file."""

import numpy as np
import pytest

import plantfit as pf
from plantfit import spec
from plantfit.errors import PlantfitError, StoreError
from plantfit.models.model import Model
from plantfit.rebuild import recipe_of
from plantfit.study.objective import objective_of
from plantfit.study.running.probe import check_same, probe
from plantfit.study.store.codec import from_blob, to_blob

SOC = np.linspace(0.0, 1.0, 21)
OCV = 3.0 + 1.2 * SOC - 0.35 * np.exp(-20 * SOC) - 0.15 * np.sin(4 * SOC)
TRUTH = {"Q": 8280.0, "R0": 0.03, "R1": 0.02, "tau": 30.0, "soc0": 0.9}
STUDY = """name = "cell"
[recording.drive]
file = "cell.csv"
[model]
equations = '''
soc' = -I/Q
v1' = (R1*I - v1)/tau
V = ocv(soc) - R0*I - v1
'''
inputs = { I = "A" }
states = { soc = { unit = "1", initial = "soc0" }, v1 = { unit = "V" } }
outputs = { V = "V" }
[model.tables.ocv]
over = "soc"
file = "ocv.csv"
unit = "V"
[parameters]
Q = { unit = "A*s", bounds = [1800, 36000] }
R0 = { unit = "ohm", bounds = [0.001, 0.2] }
R1 = { unit = "ohm", bounds = [0.001, 0.2] }
tau = { unit = "s", bounds = [2.0, 300.0] }
soc0 = { bounds = [0.3, 1.0] }
"""
HEAD = "SOC [%],OCV [mV]\n"


@pytest.fixture
def folder(tmp_path):
    """A cell under a current that changes every two minutes, its voltage with 1 mV of noise, and its curve at rest in
    a file, in other units and out of order."""
    rng, step = np.random.default_rng(2), 4.0
    current = np.repeat(rng.choice([0.0, 1.0, 2.5, -1.0, 3.0], size=30), 30)
    soc = TRUTH["soc0"] - np.concatenate([[0.0], np.cumsum(current[:-1]) * step / TRUTH["Q"]])
    fades, slow = np.exp(-step / TRUTH["tau"]), np.zeros(len(current))
    for k in range(len(current) - 1):
        slow[k + 1] = fades * slow[k] + TRUTH["R1"] * (1 - fades) * current[k]
    volts = np.interp(soc, SOC, OCV) - TRUTH["R0"] * current - slow + 0.001 * rng.normal(size=len(current))
    rows = [f"{step * k},{i},{v:.5f}\n" for k, (i, v) in enumerate(zip(current, volts, strict=True))]
    (tmp_path / "cell.csv").write_text("time [s],I [A],V [V]\n" + "".join(rows))
    order = rng.permutation(len(SOC))
    (tmp_path / "ocv.csv").write_text(HEAD + "".join(f"{100 * SOC[k]:.1f},{1000 * OCV[k]:.4f}\n" for k in order))
    return tmp_path


def parsed(folder, text=STUDY):
    return spec.parse(text, folder / "cell.toml")


def test_a_cell_is_identified_with_its_curve_at_rest_from_a_file(folder):
    answer = pf.fit(parsed(folder).problem, seed=1)
    for name, truth in TRUTH.items():
        assert abs(answer.values[name] - truth) < 4 * answer.standard_errors[name], name
    assert answer.values["Q"] == pytest.approx(TRUTH["Q"], rel=2e-3)


def test_nodes_and_values_are_those_of_the_file_in_the_models_units(folder):
    problem = parsed(folder).problem
    assert np.asarray(problem.space.parameters["ocv"].value) == pytest.approx(OCV, abs=1e-7)
    assert isinstance(problem.model, Model)
    [table] = problem.model.tables
    assert np.asarray(table.nodes[0]) == pytest.approx(SOC)
    assert "from ocv.csv" in next(p.sentence for p in problem.model.parameters if p.name == "ocv")


def test_the_unit_of_values_is_that_of_the_table_or_of_its_parameter(folder):
    """One that only the file knows would stand in no line of the study."""
    bare = STUDY.replace('unit = "V"\n[par', "[par")
    with pytest.raises(
        PlantfitError, match=r"\[mV\]' is in mV.* has no unit; declare its unit under \[model.tables.ocv\]"
    ):
        parsed(folder, bare)
    own = parsed(folder, bare + 'ocv = { unit = "V", bounds = [1.0, 6.0] }\n').problem.space.parameters["ocv"]
    assert np.asarray(own.start) == pytest.approx(OCV, abs=1e-7)


def test_a_search_begins_at_the_files_values_where_bounds_are_given(folder):
    own = parsed(folder, STUDY + "ocv = { bounds = [1.0, 6.0] }\n").problem.space.parameters["ocv"]
    assert own.value is None
    assert np.asarray(own.start) == pytest.approx(OCV, abs=1e-7)


def test_a_table_over_two_signals_has_a_row_for_every_pair(tmp_path):
    rows = [(n, a, 0.01 * n * (1 - a)) for n in (100.0, 200.0, 400.0) for a in (0.0, 0.5, 1.0)]
    order = np.random.default_rng(1).permutation(len(rows))
    (tmp_path / "map.csv").write_text("a,n,k\n" + "".join("{1},{0},{2}\n".format(*rows[i]) for i in order))
    (tmp_path / "run.csv").write_text("t,n,a,y\n" + "".join(f"{i},{100 + i},{i / 300},{i % 3}\n" for i in range(300)))
    text = """name = "map"
[recording.run]
file = "run.csv"
[model]
equations = "y = g*k(n, a)"
inputs = ["n", "a"]
outputs = ["y"]
[model.tables.k]
over = ["n", "a"]
file = "map.csv"
[parameters]
g = { bounds = [0.1, 10] }
"""
    problem = spec.parse(text, tmp_path / "map.toml").problem
    assert np.asarray(problem.space.parameters["k"].value) == pytest.approx(
        np.array([r[2] for r in rows]).reshape(3, 3)
    )
    (tmp_path / "map.csv").write_text("a,n,k\n" + "".join("{1},{0},{2}\n".format(*r) for r in rows[:-1]))
    with pytest.raises(PlantfitError, match=r"map.csv has no row for n = 400 with a = 1\. .*every pair"):
        spec.parse(text, tmp_path / "map.toml")
    for kept, said in (
        (rows[:3], "map.csv has one value of n alone; a table"),
        ([*rows, rows[4]], "n = 200 with a = 0.5 stands"),
    ):
        (tmp_path / "map.csv").write_text("a,n,k\n" + "".join("{1},{0},{2}\n".format(*r) for r in kept))
        with pytest.raises(PlantfitError, match=said):
            spec.parse(text, tmp_path / "map.toml")


@pytest.mark.parametrize(
    ("file", "key", "said"),
    [
        (HEAD + "0,3000\n50,3500\n50,3600\n", "", "line 4: soc = 0.5 stands in two rows; leave one of them"),
        (HEAD + "0,3000\n50,\n100,4000\n", "", "line 3, column 'OCV [mV]': there is no number; fill or delete"),
        (HEAD + "0,low\n100,4000\n", "", "line 2, column 'OCV [mV]': 'low' is not a number; correct it"),
        (HEAD + "0,3000\n", "", "ocv.csv has 1 row; a table needs two nodes or more"),
        (HEAD + "0,3000\n100,4000\n", 'unit = "A"', "cannot be converted to 'A'"),
        (HEAD + "0,3000\n100,4000\n", 'columns = ["SOC"]', "columns needs 2 names, of soc, ocv; it has 1"),
        (HEAD + "0,3000\n100,4000\n", 'columns = ["SOC", "U"]', "ocv.csv has no column 'U' for ocv"),
        (HEAD + "0,3000\n100,4000\n", "nodes = [[0, 1]]", "that holds nodes and values, not both"),
        ("time,SOC,OCV\n0,0,3\n1,1,4\n", "", 'Say which of them are soc, ocv: columns = ["...", ...]'),
    ],
)
def test_what_is_no_characteristic_is_refused_with_its_place(folder, file, key, said):
    (folder / "ocv.csv").write_text(file)
    own = STUDY.replace('unit = "V"\n[par', "[par") if key.startswith("unit") else STUDY
    with pytest.raises(PlantfitError) as told:
        parsed(folder, own.replace('file = "ocv.csv"', f'file = "ocv.csv"\n{key}'))
    assert said in str(told.value)
    assert "cell.toml" in str(told.value)


def test_a_column_with_a_unit_needs_one_of_the_signal(folder):
    """Percent would be taken as they are, a hundred times the charge."""
    with pytest.raises(PlantfitError, match=r"'SOC \[%\]' is in %, and the model's soc has no unit; declare its unit"):
        parsed(folder, STUDY.replace('unit = "1", initial', "initial"))


def test_values_in_the_file_and_in_the_study_are_refused(folder):
    with pytest.raises(PlantfitError, match=r"in 'ocv.csv' and in \[parameters.ocv\]; leave one of them out"):
        parsed(folder, STUDY + "ocv = { value = [1, 2] }\n")


def test_machines_that_share_no_disk_get_the_file_too(folder, tmp_path_factory):
    """What a study is made of elsewhere is the same problem."""
    study = parsed(folder)
    recipe = recipe_of(study)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    for name, data in recipe.files.items():
        (elsewhere / name).write_bytes(data)
    assert set(recipe.files) == {"cell.csv", "ocv.csv"}
    again = spec.parse(study.text, "gone/cell.toml", {name: elsewhere / name for name in recipe.files}).problem
    z = np.full((1, study.problem.space.dimension), 0.4)
    assert again.costs(z)[0] == study.problem.costs(z)[0]


def test_a_study_is_not_resumed_with_another_curve(folder):
    """No test point of the box need visit the entry that has changed; a stored study of an earlier version tells
    nothing of what was held."""

    def told():
        problem = parsed(folder).problem
        return probe(objective_of(problem), problem.space.physical)

    before = told()
    check_same(before, told(), 1)
    text = (folder / "ocv.csv").read_text()
    (folder / "ocv.csv").write_text(text.replace("\n0.0,", "\n0.0,1"))
    with pytest.raises(StoreError, match=r"Study 1 began with other values that are held.*file of a table"):
        check_same(before, told(), 1)
    check_same(to_blob(from_blob(before)[:-1]), told(), 1)
