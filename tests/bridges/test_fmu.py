"""Functional Mock-up Units of identified plants, validated and simulated by FMPy."""

import re
import xml.etree.ElementTree as ET
import zipfile
from contextlib import contextmanager

import numpy as np
import pytest
from exported_plants import MASS, UNDEFINED, answered, same, series

import plantfit as pf
from plantfit.bridges import export_plant
from plantfit.errors import PlantfitWarning
from plantfit.units import si_base


@pytest.fixture(scope="module")
def fmpy():
    return pytest.importorskip("fmpy", reason="FMPy is not installed: the FMU is neither validated nor simulated")


@pytest.fixture(scope="module")
def mass():
    """No dead time, a force that the input reaches at once, an output named as a state, units, an input in straight
    lines."""
    states = {"v": {"initial": 0.1, "unit": "m/s"}, "x": {"initial": 0.0, "unit": "m"}}
    units = {"u": "N", "x": "m", "F": "N", "m": "kg", "d": "N s/m"}
    return answered(MASS, {"m": 1.3, "d": 0.7}, states, ["x", "F"], 12.0, units=units, hold={"u": "linear"})


def table(answer):
    t, u = series(answer)
    return np.array(list(zip(t, *u.values(), strict=True)), dtype=[("time", float), *((n, float) for n in u)])


def simulated(fmpy, file, answer, **more):
    t, _ = series(answer)
    outputs = list(answer.problem.model.outputs)
    given = {
        "input": table(answer),
        "output": outputs,
        "output_interval": t[1] - t[0],
        "start_time": t[0],
        "stop_time": t[-1],
    }
    return fmpy.simulate_fmu(str(file), **given | more)


def test_fmpy_validates_and_simulates_the_plant(fmpy, answer, tmp_path):
    from fmpy.validation import validate_fmu

    (file,) = export_plant(answer, "fmu", tmp_path)
    assert validate_fmu(str(file)) == []
    same(simulated(fmpy, file, answer), answer)
    other = {n: 1.1 * v for n, v in answer.values.items()}
    same(simulated(fmpy, file, answer, start_values=other), answer, factor=1.1)


def test_roots_and_logarithms_are_undefined_where_they_are_in_plantfit(fmpy, roots, tmp_path):
    (file,) = export_plant(roots, "fmu", tmp_path)
    with instance(fmpy, file, tmp_path) as (one, place, _):
        for x, *y in UNDEFINED:
            one.setReal([place["x"]], [x])
            np.testing.assert_allclose(one.getReal([place["s"], place["l"], place["d"]]), y, rtol=1e-14)


def test_inputs_go_straight_with_the_derivatives_that_the_importer_gives(fmpy, mass, tmp_path):
    (file,) = export_plant(mass, "fmu", tmp_path)
    (t, u), found = series(mass), []
    with instance(fmpy, file, tmp_path) as (one, place, _):
        one.exitInitializationMode()
        for k in range(len(t)):
            one.setReal([place["u"]], [u["u"][k]])
            found.append(one.getReal([place["x"], place["F"]]))
            if k + 1 < len(t):
                one.setRealInputDerivatives([place["u"]], [1], [(u["u"][k + 1] - u["u"][k]) / (t[k + 1] - t[k])])
                one.doStep(t[k], t[k + 1] - t[k])
    same(dict(zip(("x", "F"), np.array(found).T, strict=True)), mass)


def test_a_held_input_jumps_in_co_simulation_and_model_exchange(fmpy, mass, tmp_path):
    (file,) = export_plant(mass, "fmu", tmp_path)
    t, u = series(mass)
    problem = mass.problem
    (experiment,) = problem.experiments.values()
    held = pf.Problem(
        problem.model, experiment.recording, problem.space.parameters, scales={"x": 1.0, "F": 1.0}, substeps=150
    )
    y = held.predict(np.array(list(mass.values.values())))["x"]
    found = simulated(fmpy, file, mass, fmi_type="CoSimulation", output=["x", "v", "F"])
    assert np.max(np.abs(found["x"] - y)) <= 1e-6 * np.ptp(y)
    assert found["F"][3] == pytest.approx(u["u"][2] - mass.values["d"] * found["v"][3])  # before the next value comes
    rows = table(mass)
    stairs = np.repeat(rows, 2)[1:]
    stairs["u"] = np.repeat(rows["u"], 2)[:-1]  # the old value and the new one at each sample
    exchanged = simulated(
        fmpy, file, mass, fmi_type="ModelExchange", output=["x"], input=stairs, relative_tolerance=1e-8
    )
    at = np.flatnonzero(np.diff(exchanged["time"], append=np.inf) > 0)
    np.testing.assert_allclose(np.interp(t, exchanged["time"][at], exchanged["x"][at]), y, atol=1e-6 * np.ptp(y))


def test_units_come_with_their_si_base(mass, tmp_path):
    (file,) = export_plant(mass, "fmu", tmp_path)
    xml = ET.fromstring(zipfile.ZipFile(file).read("modelDescription.xml"))
    units = {u.get("name"): _inside(u, "BaseUnit") for u in xml.iter("Unit")}
    assert units["N s/m"] == {"kg": "1", "s": "-1", "factor": "1.0", "offset": "0.0"}
    reals = {
        v.get("name"): (v.get("causality"), v.get("variability"), _inside(v, "Real"))
        for v in xml.iter("ScalarVariable")
    }
    assert reals["m"] == ("parameter", "tunable", {"start": repr(mass.values["m"]), "unit": "kg"})
    assert reals["x"][0] == "output"
    assert reals["state(x)"][2] == {"start": "0.0", "nominal": reals["state(x)"][2]["nominal"], "unit": "m"}
    assert reals["der(v)"][2]["unit"] == "m/s/s"
    assert not any(str(name).startswith("before") for name in reals)


def _inside(element: ET.Element, name: str) -> dict[str, str]:
    found = element.find(name)
    assert found is not None
    return found.attrib


@pytest.mark.parametrize(
    ("unit", "base"),
    [
        ("degC", (1.0, 273.15, {"K": 1})),
        ("degF", (5 / 9, 459.67 * 5 / 9, {"K": 1})),
        ("rpm", (np.pi / 30, 0.0, {"rad": 1, "s": -1})),
        ("V s/rad", (1.0, 0.0, {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1})),
        ("l/min", (1e-3 / 60, 0.0, {"m": 3, "s": -1})),
        ("%", (0.01, 0.0, {})),
        ("pH", None),
        ("furlong per", None),
    ],
)
def test_si_base(unit, base):
    found = si_base(unit)
    if base is None:
        assert found is None
        return
    assert found is not None
    assert found[:2] == pytest.approx(base[:2], rel=1e-14)
    assert found[2] == base[2]


@contextmanager
def instance(fmpy, file, folder):
    """An instance of an FMU in its initialisation, its value references by name, and a list of what it says."""
    from fmpy.fmi2 import FMU2Slave

    told, messages = fmpy.read_model_description(str(file)), []
    one = FMU2Slave(
        guid=told.guid, unzipDirectory=fmpy.extract(str(file), str(folder / "open")), instanceName="one",
        modelIdentifier=told.coSimulation.modelIdentifier,
    )  # fmt: skip
    one.instantiate(callbacks=calls(messages))
    one.setupExperiment(startTime=0.0)
    one.enterInitializationMode()
    yield one, {v.name: v.valueReference for v in told.modelVariables}, messages
    one.freeInstance()


@pytest.fixture
def opened(fmpy, heater, tmp_path):
    (file,) = export_plant(heater, "fmu", tmp_path)
    with instance(fmpy, file, tmp_path) as found:
        yield found


def calls(messages):
    from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    def heard(environment, instance, status, category, message):
        messages.append(message.decode())

    found = fmi2CallbackFunctions()
    found.logger = fmi2CallbackLoggerTYPE(heard)
    return found


def test_a_step_is_taken_again_after_going_back(opened):
    one, place, _ = opened
    one.exitInitializationMode()
    now = 0.0
    for k in range(40):
        one.setReal([place["u"]], [float(k % 7)])
        one.doStep(now, 0.31)
        now += 0.31
    state = one.getFMUstate()
    ends = []
    for _ in range(2):
        one.setFMUstate(state)
        for k in range(5):
            one.setReal([place["u"]], [2.0 * k])
            one.doStep(now + 0.31 * k, 0.31)
        ends.append(one.getReal([place["T"], place["x"]]))
    one.freeFMUstate(state)
    assert ends[0] == ends[1]


def test_what_cannot_be_set_is_refused_in_a_sentence(opened):
    from fmpy.fmi1 import FMICallException

    one, place, messages = opened
    for wrong, value, sentence in (
        (place["L"], -1.0, "dead time of -1 s"),
        (place["K"], np.nan, "cannot be nan"),
        (99, 0.0, "cannot be set"),
    ):
        with pytest.raises(FMICallException):
            one.setReal([wrong], [value])
        assert re.search(sentence, messages[-1])
    one.exitInitializationMode()
    with pytest.raises(FMICallException):
        one.setReal([place["L"]], [1.0])
    assert "before the simulation begins only" in messages[-1]
    one.setReal([place["K"]], [0.9])
    with pytest.raises(FMICallException):
        one.doStep(5.0, 0.1)
    assert messages[-1] == "The step begins at 5 s, and the plant stands at 0 s."
    one.setReal([place["tau"]], [1e-9])
    with pytest.raises(FMICallException):
        one.doStep(0.0, 1.0)
    assert "cannot be simulated beyond" in messages[-1]


def test_without_a_compiler_the_sources_are_written_and_that_is_said(heater, monkeypatch, tmp_path):
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.warns(
        PlantfitWarning, match=r"sources and no binary, because no C compiler is on this machine \(cc, gcc or clang\)"
    ):
        (file,) = export_plant(heater, "fmu", tmp_path)
    names = zipfile.ZipFile(file).namelist()
    assert "sources/fit_fmu.c" in names
    assert not any(n.startswith("binaries") for n in names)


def test_the_same_study_writes_the_same_bytes(heater, tmp_path):
    assert (
        export_plant(heater, "fmu", tmp_path / "a")[0].read_bytes()
        == export_plant(heater, "fmu", tmp_path / "b")[0].read_bytes()
    )
