"""Exported plants, run by the other program: their outputs are plantfit's within 1e-6 of the range."""

import ast
import ctypes
import importlib.util
import json
import math
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from exported_plants import UNDEFINED, answered, same, series

import plantfit as pf
from plantfit.bridges import TARGETS, export_plant
from plantfit.bridges.matrices import matrices
from plantfit.errors import ModelError, SimulationError, StoreError
from plantfit.models.model import Declared
from plantfit.simulate.steps.vector import vectorise
from plantfit.simulate.straight_line import straight_line

import jax.numpy as jnp


def loaded(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_python_simulates_the_plant_without_plantfit(answer, tmp_path):
    (file,) = export_plant(answer, "python", tmp_path)
    assert "plantfit" not in [
        line.split()[1] for line in file.read_text().splitlines() if line.startswith(("import", "from"))
    ]
    module = loaded(file)
    t, u = series(answer)
    same(module.simulate(t, u), answer)
    other = {n: 1.1 * v for n, v in module.PARAMETERS.items()}
    same(module.simulate(t, u, other), answer, factor=1.1)


@pytest.mark.parametrize("stepper", ["exponential", pytest.param("adaptive", marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_a_plant_that_began_before_its_record_goes_on_from_its_first_sample(stepper, tmp_path):
    """A dose an hour ago, and an input that was 2 until the first sample."""
    model = pf.equations(
        "x' = -Vm*x/(K + x) + 0.1*delay(u, L); y = x",
        inputs=["u"],
        states={"x": {"initial": "dose"}},
        outputs=["y"],
        parameters={
            n: {"bounds": b}
            for n, b in {"Vm": (0.5, 4.0), "K": (0.5, 9.0), "dose": (5.0, 50.0), "L": (0.1, 3.0)}.items()
        },
    )  # fmt: skip
    t = np.arange(0.0, 20.0, 0.5)
    u, begin = np.where(t > 8, 4.0, 1.0), {"initial_time": -3.0, "before": {"u": 2.0}}
    blank = pf.Problem(model, pf.Recording(t, {"u": pf.Signal(u), "y": pf.Signal(0 * t)}), stepper=stepper, **begin)
    true = blank.predict(blank.space.vector({"Vm": 2.0, "K": 3.0, "dose": 20.0, "L": 1.1}))["y"]
    record = pf.Recording(
        t, {"u": pf.Signal(u), "y": pf.Signal(true + 0.01 * np.random.default_rng(1).normal(size=40))}
    )
    answer = pf.fit(pf.Problem(model, record, stepper=stepper, **begin), "least_squares", budget=200)
    (file,) = export_plant(answer, "python", tmp_path)
    found = loaded(file).simulate(t, {"u": u})["y"]
    np.testing.assert_allclose(found, answer.predict()["y"], atol=2e-3)
    assert abs(found[0] - 20.0) > 3.0


def test_c_simulates_the_plant(answer, tmp_path):
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not on this machine: the exported C is not compiled")
    header, source = export_plant(answer, "c", tmp_path, name="a plant")
    library = tmp_path / "plant.so"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, "-Wno-misleading-indentation", "-o", library, source, "-lm"], check=True)
    program, (t, u), model = ctypes.CDLL(str(library)), series(answer), answer.problem.model
    assert "a_plant_simulate" in header.read_text()
    y = np.empty((len(t), len(model.outputs)))
    flat = np.ascontiguousarray(np.column_stack([u[n] for n in model.inputs]))

    def held(name):
        return ctypes.cast(getattr(program, f"a_plant_{name}"), ctypes.c_void_p)

    def pointer(a):
        return a.ctypes.data_as(ctypes.c_void_p)

    program.a_plant_simulate.restype = None
    places = [ctypes.addressof(ctypes.c_double.in_dll(program, f"a_plant_{n}")) for n in ("parameters", "x0", "before")]
    program.a_plant_simulate(*map(ctypes.c_void_p, places), len(t), pointer(t), pointer(flat), 40, pointer(y))
    same(dict(zip(model.outputs, y.T, strict=True)), answer)


def test_casadi_simulates_the_plant(answer, tmp_path):
    casadi = pytest.importorskip("casadi", reason="casadi is not installed: the exported functions are not run")
    (file,) = export_plant(answer, "casadi", tmp_path)
    module = loaded(file)
    t, u = series(answer)
    same(module.simulate(t, u), answer)
    n = len(answer.problem.model.states)
    x, values = casadi.SX.sym("x", n), list(module.PARAMETERS.values())
    channels = np.r_[np.ones(len(module.INPUTS) + len(module.DELAYED)), 0.0]
    jacobian = casadi.Function("j", [x], [casadi.jacobian(module.rates(x, channels, values), x)])
    point, step = np.full(n, 0.3), 1e-6
    slopes = [
        np.asarray(module.rates(point + step * e, channels, values) - module.rates(point - step * e, channels, values))
        / (2 * step)
        for e in np.eye(n)
    ]
    np.testing.assert_allclose(np.asarray(jacobian(point)), np.hstack(slopes), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("to", ["python", "casadi"])
def test_roots_and_logarithms_are_undefined_where_they_are_in_plantfit(roots, to, tmp_path):
    if to == "casadi":
        pytest.importorskip("casadi", reason="casadi is not installed: the exported functions are not run")
    module = loaded(*export_plant(roots, to, tmp_path))
    for x, *y in UNDEFINED:
        np.testing.assert_allclose(
            np.ravel(module.outputs([x], [0.0, 0.0], list(module.PARAMETERS.values()))), y, rtol=1e-14
        )


def test_roots_and_logarithms_in_c_are_undefined_where_they_are_in_plantfit(roots, tmp_path):
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not on this machine: the exported C is not compiled")
    _, source = export_plant(roots, "c", tmp_path, name="plant")
    library = tmp_path / "plant.so"
    flags = ["-std=c99", "-O2", "-shared", "-fPIC", "-Dstatic="]  # its functions can be called from outside
    subprocess.run(["gcc", *flags, "-o", library, source, "-lm"], check=True)
    program, three = ctypes.CDLL(str(library)), ctypes.c_double * 3
    for x, *y in UNDEFINED:
        found = three()
        program.outputs(three(x), three(), three(), found)
        np.testing.assert_allclose(list(found), y, rtol=1e-14)


def test_python_control_simulates_the_linear_plant(heater, tmp_path):
    control = pytest.importorskip(
        "control", reason="python-control is not installed: the exported matrices are not run"
    )
    file, data = export_plant(heater, "control", tmp_path)
    module, v = loaded(file), heater.values
    (t, u), (delay, part) = series(heater), module.paths[0]
    assert delay == pytest.approx(v["L"])
    assert part.poles() == pytest.approx([-1 / v["tau"]])
    y = module.simulate(t, u["u"])
    # the recording does not begin at rest: after the start has faded both are one
    truth, h = np.empty(len(t)), t[1] - t[0]
    rest = v["K"] * module.U0 + v["T0"]
    state = rest
    for k in range(len(t)):  # the exact solution of the lag, begun at the rest of the matrices
        truth[k] = state
        edge = v["L"] % h
        back = int(v["L"] // h)
        for share, place in ((edge, k - back - 1), (h - edge, k - back)):
            goal = v["K"] * (u["u"][place] if place >= 0 else module.U0) + v["T0"]
            state = goal + (state - goal) * np.exp(-share / v["tau"])
    np.testing.assert_allclose(y, truth, atol=1e-6 * np.ptp(truth))
    w = np.geomspace(1e-3, 1.0, 20)
    g = v["K"] * np.exp(-1j * w * v["L"]) / (1 + 1j * w * v["tau"])
    np.testing.assert_allclose(module.frequency_response(w), g, rtol=1e-9)
    pade = module.system(4)
    assert isinstance(pade, control.StateSpace)
    # what is stated of a Pade fraction up to 1 rad/s at this dead time
    np.testing.assert_allclose(pade(1j * w), g, rtol=1e-6)
    assert json.loads(data.read_text())["paths"][0]["delay"] == pytest.approx(v["L"])


@pytest.mark.parametrize("u", [-2.6, 0.4, 1.4, 2.3])
def test_truths_add_up_as_numbers_and_whole_numbers_lose_their_places(u):
    def steps(x, u, p):
        over = [jnp.asarray(u["u"] > level, float) for level in (0.0, 1.0, 2.0)]
        whole = jnp.asarray(p["k"] * u["u"]).astype(int)
        return {"x": over[0] + over[1] - over[2] + whole * 1.0}

    declared = (Declared("k", None, (0.0, 5.0)),)
    model = pf.Model("steps", {"x": None}, {"u": None}, {"y": None}, declared, lambda x, u, p: {"y": x["x"]}, steps)
    vector, names = vectorise(model), (["x"], ["u", "t"], ["p"])
    truth = (u > 0) + (u > 1) - (u > 2) + math.trunc(1.7 * u)
    assert float(vector.rate((0.0,), (u, 0.0), (1.7,))[0]) == truth
    known = {"x": np.float64(0.0), "u": np.float64(u), "p": np.float64(1.7), "np": np}
    for language in ("python", "casadi"):
        if language == "casadi":
            ca = pytest.importorskip("casadi", reason="casadi is not installed: its equations are not run")
            known = {"x": ca.DM(0.0), "u": ca.DM(u), "p": ca.DM(1.7), "ca": ca}
        lines = straight_line(vector, "rate", language, names)
        own = dict(known)
        exec(lines.text(""), own)
        assert float(eval(lines.results[0], own)) == truth
    assert "trunc(v" in straight_line(vector, "rate", "c", names).text("")


@pytest.mark.parametrize("dead", [pytest.param(1.0, marks=pytest.mark.slow), 1.37])
def test_an_output_that_reads_the_late_input_itself_follows_it_in_the_matrices(dead, tmp_path):
    pytest.importorskip("control", reason="python-control is not installed: the exported matrices are not run")
    text = "x' = (K*delay(u, L) - x)/tau\nz = x + 0.5*delay(u, L)"
    answer = answered(text, {"K": 2.0, "tau": 3.0, "L": dead}, ["x"], ["z"], 47.5)
    module, plain = (loaded(export_plant(answer, to, tmp_path)[0]) for to in ("control", "python"))
    v, w = answer.values, np.geomspace(1e-2, 3.0, 20)
    truth = np.exp(-1j * w * v["L"]) * (v["K"] / (1 + 1j * w * v["tau"]) + 0.5)
    np.testing.assert_allclose(module.frequency_response(w), truth, rtol=1e-9)
    t = np.arange(0.0, 40.0, 0.3)
    u = np.where(np.arange(len(t)) // 10 % 2 == 0, 1.0, -0.5)
    y = plain.simulate(t, {"u": u}, x0={"x": module.X0[0]}, before={"u": module.U0})["z"]
    np.testing.assert_allclose(module.simulate(t, u), y, atol=1e-7 * np.ptp(y))


def test_matlab_files_hold_the_matrices(heater, tmp_path):
    from scipy.io import loadmat

    mat, script = export_plant(heater, "matlab", tmp_path)
    held, v = loadmat(mat), heater.values
    assert held["A"].item() == pytest.approx(-1 / v["tau"])
    assert held["delay1"].item() == pytest.approx(v["L"])
    assert held["B1"].item() == pytest.approx(v["K"] / v["tau"])
    assert "not run in MATLAB" in script.read_text()


def test_csv_holds_the_simulation(heater, tmp_path):
    simulated, parameters = export_plant(heater, "csv", tmp_path)
    rows = np.genfromtxt(simulated, delimiter=",", names=True, deletechars="")
    np.testing.assert_array_equal(rows["T_simulated_[-]"], heater.predict()["T"])
    lines = parameters.read_text().splitlines()
    assert float(next(line for line in lines if line.startswith("tau,")).split(",")[1]) == heater.values["tau"]


def test_what_cannot_be_carried_is_said(heater, arm, tmp_path):
    with pytest.raises(ModelError, match="no target 'sbml' to export to; there are python, c, casadi"):
        export_plant(heater, "sbml", tmp_path)
    with pytest.raises(
        SimulationError, match="1 inputs and 2 outputs; matrices can be exported only for one input and one output"
    ):
        export_plant(arm, "control", tmp_path)


def test_matrices_of_a_plant_that_rests_nowhere_near_its_recording_are_refused():
    model = pf.equations("y' = k*u - y\nz = y", inputs=["u"], states=["y"], outputs=["z"], parameters=["k"], name="m")
    seen = SimpleNamespace(recording={"z": np.array([1.0, 2.0])})
    answer = SimpleNamespace(problem=SimpleNamespace(experiments={"a": seen}))
    plant: Any = SimpleNamespace(model=model, p={"k": 0.0}, answer=answer, recording="a", inputs={"u": np.arange(3.0)})
    with pytest.raises(SimulationError, match=r"No rest of model 'm' was found at z = 1\.5, where it would be linear"):
        matrices(plant)


def test_a_file_of_the_user_is_not_replaced(heater, tmp_path):
    for to in TARGETS:
        for files in (export_plant(heater, to, tmp_path / to), export_plant(heater, to, tmp_path / to)):
            assert all(f.stat().st_size for f in files)
        files[-1].write_text("mine")
        first = files[0].read_bytes()
        with pytest.raises(StoreError, match=f"{files[-1].name} exists and was not written by plantfit"):
            export_plant(heater, to, tmp_path / to)
        assert files[-1].read_text() == "mine"
        assert len(files) == 1 or files[0].read_bytes() == first


def texts_of(files):
    """Texts of files, and of those in an archive."""
    found = []
    for file in files:
        if file.suffix == ".fmu":
            with zipfile.ZipFile(file) as archive:
                found += [archive.read(n).decode() for n in archive.namelist() if not n.startswith("binaries")]
        elif file.suffix not in (".mat", ".nc"):
            found.append(file.read_text("utf-8"))
    return found


HOSTILE = [
    '"""\nimport os; os.abort()\n"""',
    "*/\nint main(void) { abort(); }\n/*",
    "'\nexit\n%",
    "a\\",
    "\u2028\r\nabort()",
    "{p}",
]


@pytest.mark.parametrize(
    "name", [HOSTILE[0], HOSTILE[1], *(pytest.param(n, marks=pytest.mark.slow) for n in HOSTILE[2:-1]), HOSTILE[-1]]
)
def test_names_of_users_stay_in_comments(heater, name, tmp_path):
    (given,) = heater.problem.experiments.values()
    scales = heater.problem.scales
    problem = pf.Problem(
        heater.problem.model, {name: given.recording}, heater.problem.space.parameters, scales=scales, name=name
    )
    hostile = replace(heater, problem=problem)  # a fit of its own for each name would end at the same point
    texts = {to: texts_of(export_plant(hostile, to, tmp_path, name="plant")) for to in TARGETS}
    for to in ("python", "casadi", "control"):
        tree = ast.parse(texts[to][0])
        assert not {"abort", "os", "exit"} & {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
        assert not {"os"} & {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    for text in texts["c"] + texts["fmu"][1:]:
        bare = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        assert "abort" not in bare
        assert "*/" not in bare
    assert all(
        line.startswith(("%", "plant = ", "sys = ", "sys.InputName", "step("))
        for line in texts["matlab"][0].splitlines()
    )
    assert ET.fromstring(texts["fmu"][0]).get("modelName") == " ".join(
        "".join(c if c.isprintable() else " " for c in name).split()
    )
