"""Additions to a model against plants simulated elsewhere (benchmarks/diagnosis.py: Runge-Kutta, no line shared with
plantfit)."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, STARTED, write

from plantfit.errors import ModelError, PlantfitError
from plantfit.models.extensions import KINDS, parameter_name, with_extensions
from plantfit.models.library.process import first_order
from plantfit.spec import load

TRUTH = {
    "first": {"K": 8.0, "tau": 0.6},
    "second": {"m": 0.5, "b": 0.8, "k": 4.0},
}
WHERE = {
    "start": "x",
    **dict.fromkeys(("dead_time", "lag", "dead_zone", "saturation", "backlash", "input_offset"), "u"),
}
WHERE |= dict.fromkeys(("coulomb", "quadratic", "stribeck"), "v")


@pytest.mark.parametrize(
    "kind",
    [
        *(
            k
            for k, own in KINDS.items()
            if k not in ("change", "viscous") and not own.over and own.to not in ("parts", "products")
        ),  # viscous: that of the plant
        "change k with x",
        "change b with t",
        "change m with t",
    ],
)
@pytest.mark.thorough
def test_an_addition_is_the_fault_of_its_name(kind, tmp_path):
    plant, fault = PLANTS["second"], kind
    place = write(plant, fault, 0.0, 0, tmp_path)
    kind, _, pair = kind.partition(" ")
    signal, size = pair or WHERE.get(kind, "y"), plant.faults[fault]
    assert kind != "start" or signal == STARTED["second"]
    low = 0 if kind == "dead_time" else -100
    text = place.read_text().replace(
        "[parameters]", f'extensions = {{ {kind} = {{ "{signal}" = [{low}, 100] }} }}\n[parameters]\n'
    )
    if kind in ("coulomb", "stribeck"):
        text += "creep_v = { value = 1e-3 }\n"
    text += "stribeck_speed_v = { value = 0.1 }\n" if kind == "stribeck" else ""
    text += f"{parameter_name('reference', signal)} = {{ value = 0 }}\n" if kind == "change" else ""
    place.write_text(text)
    problem = load(place).problem
    problem = problem.with_simulator(problem.predictor.stepping().refined(16))
    bare = load(write(plant, "clean", 0.0, 0, tmp_path)).problem  # the record of another file name would be another one
    values = TRUTH["second"] | {parameter_name(kind, signal): size}
    write(plant, fault, 0.0, 0, tmp_path)
    measured = problem.experiments["a"].recording["y"]
    at = lambda p: p.predict(np.array([values[n] for n in p.space.names]))["y"]  # noqa: E731
    without = at(bare)
    with_it = at(problem)
    error, effect = np.sqrt(np.mean((with_it - measured) ** 2)), np.sqrt(np.mean((without - measured) ** 2))
    assert error < 0.02 * np.std(measured)
    assert error < 0.2 * effect


PART = {
    "proportional": (("u",), 0.7, lambda y, u: y + 0.7 * u),
    "square": (("u",), -0.2, lambda y, u: y - 0.2 * u**2),
    "signed_square": (("u",), 0.3, lambda y, u: y + 0.3 * u * np.abs(u)),
    "sign": (("u",), 1.5, lambda y, u: y + 1.5 * np.sign(u)),
    "power": (("u",), 0.6, lambda y, u: y * (u / 2.0) ** 0.6),
    "product": (("u", "v"), -0.4, lambda y, u, v: y - 0.4 * u * v),
}


@pytest.mark.parametrize("moves", [True, False])
@pytest.mark.parametrize("kind", [k for k, own in KINDS.items() if own.to in ("parts", "products")])
def test_a_part_of_an_output_is_what_its_name_says(kind, moves, tmp_path):
    """Of a table at rest, and of a plant with a state, whose output then has a direct feedthrough."""
    inputs, size, truth = PART[kind]
    rng = np.random.default_rng(len(kind) + moves)
    t = 0.1 * np.arange(80)
    low = 0.5 if kind == "power" else -3.0
    u, v = np.repeat(rng.uniform(low, 3.0, (2, 16)), 5, axis=1)
    if moves:
        x = np.zeros(t.size)
        for k in range(t.size - 1):  # exact for held inputs: x' = (2 u + v - x)/0.5
            x[k + 1] = 2 * u[k] + v[k] + (x[k] - 2 * u[k] - v[k]) * np.exp(-0.1 / 0.5)
        y, equations, states = x, "x' = (a*u + v - x)/tau; y = x", 'states = { x = "m" }'
    else:
        y, equations, states = 2 * u + v, "y = a*u + v", ""
    np.savetxt(
        tmp_path / "a.csv",
        np.column_stack([t, u, v, truth(y, *(u, v)[: len(inputs)])]),
        delimiter=",",
        header="t,u,v,y",
        comments="",
    )
    pair = f"y with {' and '.join(inputs)}"
    (tmp_path / "s.toml").write_text(f"""name = "part"
[recording.a]
file = "a.csv"
time = "t"
[model]
equations = "{equations}"
inputs = {{ u = "m", v = "m" }}
{states}
outputs = {{ y = "m" }}
extensions = {{ {kind} = {{ "{pair}" = [-5, 5] }} }}
[parameters]
a = {{ unit = "1", bounds = [0.1, 10] }}
{'tau = { unit = "s", value = 0.5 }' if moves else ""}
{f"{parameter_name('reference', pair)} = {{ value = 2.0 }}" if kind == "power" else ""}
""")
    problem = load(tmp_path / "s.toml").problem
    problem = problem.with_simulator(problem.predictor.stepping().refined(16)) if moves else problem
    values = {"a": 2.0, parameter_name(kind, pair): size}
    made = problem.predict(np.array([values[n] for n in problem.space.names]))["y"]
    measured = problem.experiments["a"].recording["y"]
    np.testing.assert_allclose(made, measured, atol=1e-6 * np.ptp(measured))
    assert np.std(measured - y[: measured.size]) > 0.05 * np.std(y)


def test_viscous_friction_is_more_of_what_a_plant_has(tmp_path):
    place = write(PLANTS["second"], "clean", 0.01, 0, tmp_path)
    bare = load(place).problem
    text = place.read_text().replace("[parameters]", "extensions = { viscous = { v = [0, 5] } }\n[parameters]\n")
    place.write_text(text)
    added = load(place).problem
    values = {**TRUTH["second"], "viscous_v": 1.2}
    with_it = added.predict(np.array([values[n] for n in added.space.names]))["y"]
    more = {**TRUTH["second"], "b": TRUTH["second"]["b"] + 1.2 * TRUTH["second"]["m"]}
    np.testing.assert_allclose(with_it, bare.predict(np.array([more[n] for n in bare.space.names]))["y"], atol=1e-9)


@pytest.mark.thorough
def test_derivatives_by_additions_are_exact(tmp_path):
    """Except where the input jumps on a sample; sizes are such that nothing stands on a corner."""
    place = write(PLANTS["second"], "clean", 0.01, 0, tmp_path)
    kinds = {
        "lag": "u",
        "dead_zone": "u",
        "saturation": "u",
        "input_offset": "u",
        "sensor_lag": "y",
        "offset": "y",
        "drift": "y",
        "sensor_high": "y",
        "start": "x",
    }
    given = ", ".join(f"{k} = {{ {s} = [0.011, 2.017] }}" for k, s in kinds.items())
    place.write_text(place.read_text().replace("[parameters]", f"extensions = {{ {given} }}\n[parameters]\n"))
    problem = load(place).problem
    z, h = np.full(problem.space.dimension, 0.37), 1e-6
    _, jacobian = problem.residuals_and_jacobian(z)
    numeric = [
        (np.asarray(problem.residuals(z + h * e)) - np.asarray(problem.residuals(z - h * e))) / (2 * h)
        for e in np.eye(len(z))
    ]
    assert np.allclose(jacobian, np.stack(numeric, axis=1), atol=1e-5 * np.abs(jacobian).max())


def test_a_library_model_takes_additions_and_can_be_pickled():
    given = {"dead_zone": {"u": (0, 1)}, "sensor_lag": {"y": (0.01, 1)}}
    model = with_extensions(first_order(dead_time=False), given)
    assert [p.name for p in model.parameters][-2:] == ["dead_zone_u", "sensor_lag_y"]
    again = pickle.loads(pickle.dumps(model))
    assert again.states == model.states


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"dead_tme": {"u": (0, 1)}}, "dead_time"),
        ({"dead_time": {"v": (0, 1)}}, "not one of its inputs"),
        ({"offset": {"u": (0, 1)}}, "not one of its outputs"),
        ({"lag": {"u": (1, 0)}}, "bounds"),
        ({"dead_time": {"u": (0, 1)}}, "one already"),
        ({"change": {"K": (-1, 1)}}, "'K', which is no pair; write .* as in 'K with u'"),
        ({"change": {"G with u": (-1, 1)}}, "'G' is no parameter or input that can change"),
        ({"change": {"K with v": (-1, 1)}}, "'v' is no input, state or t"),
        ({"change": {"u with u": (-1, 1)}}, "cannot change with itself"),
    ],
)
def test_what_cannot_be_added_is_said(given, said):
    with pytest.raises(ModelError, match=said):
        with_extensions(first_order(), given)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            "dead_time = { force = [0, 1] }",
            "is a regression: 'dead_time' cannot be added to it. It takes offset, viscous, coulomb",
        ),
        ("coulom = { force = [0, 1] }", "'coulom' cannot be added to it. Did you mean 'coulomb'"),
        ("offset = { fore = [0, 1] }", "'fore' is none of its outputs ['force']. Did you mean 'force'"),
        ("offset = { force = [1, 0] }", "offset of 'force' is [1, 0]; write the bounds of its parameter, as in [0, 1]"),
        ("coulomb = { 'force with velocity' = [0, 1] }", "write it as in 'force with acceleration over 0.01'"),
        ("coulomb = { 'force with velocity over fast' = [0, 1] }", "whose scale is not a number"),
        ("coulomb = { 'force with velocity over -1' = [0, 1] }", "write it as in 'force with acceleration over 0.01'"),
        ("quadratic = { 'force with velocty' = [0, 1] }", "it reads no 'velocty'. Did you mean 'velocity'"),
        ("quadratic = { force = [0, 1] }", "write it as in 'force with acceleration'"),
        ("change = { 'K with velocity' = [0, 1] }", "'K' is none of its coefficients"),
    ],
)
def test_what_a_regression_cannot_take_is_told_with_what_it_can(tmp_path, given, told):
    with pytest.raises(PlantfitError) as error:
        load(regression(tmp_path, given))
    assert told in str(error.value), str(error.value)
    assert "s.toml, [model]" in str(error.value)


def test_a_regression_with_columns_more_predicts_their_sum(tmp_path):
    study = load(
        regression(
            tmp_path,
            "quadratic = { 'force with velocity' = [-1, 1] }, change = { 'M with velocity' = [-1, 1] }, "
            "stribeck = { 'force with velocity over 2' = [-9, 9], 'force with velocity over 3' = [-9, 9] }",
        )
    )
    assert list(study.problem.space.names)[-4:] == [
        "quadratic_force_with_velocity", "change_M_with_velocity", "stribeck_force_with_velocity",
        "stribeck_force_with_velocity_2",
    ]  # fmt: skip
    values = {"M": 2.0, "Fv": 3.0, "Fc": 0.5, "offset": 0.1} | dict(
        zip(study.problem.space.names[-4:], (0.3, 0.7, 1.1, 1.3), strict=True)
    )
    found = study.problem.predict(np.array([values[n] for n in study.problem.space.names]), "a")["force"]
    v, a = (study.problem.experiments["a"].recording[n] for n in ("velocity", "acceleration"))
    steps = sum(c * np.exp(-((v / s) ** 2)) * np.tanh(v / (0.1 * s)) for c, s in ((1.1, 2.0), (1.3, 3.0)))
    assert found == pytest.approx((2.0 + 0.7 * v) * a + 3.0 * v + 0.5 * np.sign(v) + 0.1 + 0.3 * v * np.abs(v) + steps)


def regression(tmp_path, extensions):
    rows = "\n".join(f"{k * 0.1},{k % 3},{k % 5 - 2},{k % 7 - 3}" for k in range(30))
    (tmp_path / "a.csv").write_text("t,force,velocity,acceleration\n" + rows)
    (tmp_path / "s.toml").write_text(
        'name = "r"\n[recording.a]\nfile = "a.csv"\ntime = "t"\n'
        'signals = { force = "force", velocity = "velocity", acceleration = "acceleration" }\n'
        'units = { force = "N", velocity = "m/s", acceleration = "m/s^2" }\n'
        f'[model]\nkind = "drive_regression"\nextensions = {{ {extensions} }}\n[parameters]\n'
    )
    return tmp_path / "s.toml"
