"""The models that come with plantfit: their declarations, options and closed-form behaviour."""

import numpy as np
import pytest
from model_calls import derivative, initial_state
from scipy.linalg import lstsq

from plantfit import units
from plantfit.errors import ModelError
from plantfit.models import (
    Declared,
    LinearModel,
    Model,
    dc_motor,
    describe,
    drive,
    drive_regression,
    first_order,
    make,
    models,
    second_order,
)

import jax

ALL = [
    ("dc_motor", {}),
    ("dc_motor", {"current_output": True, "tied": True, "dead_time": True, "load": True}),
    ("drive", {}),
    ("drive", {"velocity_output": True}),
    ("drive_regression", {}),
    ("first_order", {"input_unit": "%", "output_unit": "degC"}),
    ("first_order", {"dead_time": False, "offset": False, "initial": "free"}),
    ("hammerstein_wiener", {}),
    (
        "hammerstein_wiener",
        {"input_curve": "saturation", "order": 3, "form": "modal", "output_curve": "table", "dead_time": True},
    ),
    (
        "hammerstein_wiener",
        {"input_curve": "dead_zone", "order": 1, "degree": 3, "input_unit": "V", "output_unit": "rad/s"},
    ),
    (
        "hammerstein_wiener",
        {"input_curve": "table", "order": 3, "output_curve": "none", "input_unit": "%", "output_unit": "K"},
    ),
    ("pendubot", {}),
    (
        "pendubot",
        {"drive": "voltage", "gear_ratio": 6.0, "friction": ("viscous", "coulomb", "load"), "initial": "free"},
    ),
    ("pendubot", {"parameters": "base", "joints": (1, 2), "friction": ("stribeck", "offset"), "velocity_output": True}),
    (
        "pendubot_regression",
        {"joints": (1, 2), "gear_ratio": 6.0, "friction": ("viscous", "coulomb", "stribeck", "load", "offset")},
    ),
    ("second_order", {"initial": "free"}),
    ("second_order", {"dead_time": False}),
    ("steam_chamber", {}),
    ("steam_chamber", {"opening_nodes": [0, 50, 100], "nodes": [0, 5, 20], "dead_time": False, "initial": "measured"}),
    ("tabled_first_order", {"input_unit": "%", "output_unit": "degC"}),
    ("tabled_first_order", {"over": "y", "nodes": [-3, 0, 5], "dead_time": False, "offset": False, "initial": "free"}),
]


def values(model, seed=0):
    draw = np.random.default_rng(seed).uniform
    found = {p.name: draw(0.5, 2.0, p.shape) if p.shape else draw(0.5, 2.0) for p in model.parameters}
    return found | {n: v for n, v in {"low": 0.4, "high": 0.6}.items() if n in found}  # within the inputs of `point`


def point(model, seed=0):
    draw = np.random.default_rng(seed).uniform
    return {s: draw() for s in model.states}, {n: draw() for n in (*model.inputs, *(d.channel for d in model.delays))}


@pytest.mark.parametrize(("name", "options"), ALL)
def test_every_declaration_is_usable(name, options):
    model = make(name, **options)
    assert model.name == name
    for p in model.parameters:
        assert p.bounds is not None
        low, high = p.bounds
        assert low < high
        assert p.scale == "linear" or low > 0
        assert p.sentence
        assert p.unit is None or units.known(p.unit)
    assert models()[name].__doc__
    assert model.sentence
    assert model.source


@pytest.mark.parametrize(("name", "options"), [entry for entry in ALL if not entry[0].endswith("_regression")])
@pytest.mark.further(6)
def test_every_parameter_and_state_has_an_effect(name, options):
    """Shift each argument alone: at some point a derivative, output or initial state must change, and shapes must
    hold."""
    model = make(name, **options)
    assert isinstance(model, Model)
    x, u = point(model)
    p, y = values(model), {o: 0.3 for o in model.outputs}

    def everything(x, u, p, y):
        return [
            *derivative(model)(x, u, p).values(),
            *model.output(x, u, p).values(),
            *initial_state(model)(p, u, y).values(),
        ]

    assert set(derivative(model)(x, u, p)) == set(model.states) == set(initial_state(model)(p, u, y))
    assert set(model.output(x, u, p)) == set(model.outputs)
    points = [(*point(model, seed), values(model, seed + 1), y) for seed in range(32)]
    together = jax.tree.map(lambda *v: jax.numpy.stack(v), *points)
    slopes = jax.jit(
        jax.vmap(jax.jacfwd(lambda tree: jax.numpy.stack([jax.numpy.asarray(v) for v in everything(*tree)])))
    )(together)
    delayed = {d.parameter for d in model.delays} | {d.input for d in model.delays}
    measured_unused = set(y) if options.get("initial") == "free" and name != "pendubot" else set()
    if name == "hammerstein_wiener":  # it starts at rest under the first input
        measured_unused, delayed = set(y), delayed - {"u"}
    if name == "steam_chamber" and options.get("initial") != "measured":
        measured_unused = set(y)
    for group, allowed in zip(slopes, (set(), delayed, delayed, measured_unused), strict=True):
        for argument, slope in group.items():
            assert np.any(slope != 0) != (argument in allowed), argument


def test_units_of_the_motor_agree_with_its_equations():
    unit = {p.name: units.parse(p.unit) for p in dc_motor().parameters if p.unit}
    w, i, volt = units.parse("rad/s"), units.parse("A"), units.parse("V")
    for left, right in (
        (unit["Rm"] * i, volt),
        (unit["Kb"] * w, volt),
        (unit["Lm"] * i / units.parse("s"), volt),
        (unit["Kt"] * i, unit["Tf"]),
        (unit["Cm"] * w, unit["Tf"]),
        (unit["Jm"] * w / units.parse("s"), unit["Tf"]),
    ):
        assert units.compatible(left, right)  # pyrefly: ignore[bad-argument-type]  (products of units are units)


def test_motor_stands_still_at_its_closed_form_steady_state():
    model, p = dc_motor(), {"Rm": 2.0, "Lm": 1e-3, "Kb": 0.05, "Kt": 0.04, "Jm": 1e-4, "Cm": 1e-5, "Tf": 0.01}
    w = 50.0  # far above the smoothing width
    start = initial_state(model)(p, {"V": 0.0}, {"w": w})
    current = (p["Cm"] * w + p["Tf"]) / p["Kt"]
    assert float(start["i"]) == pytest.approx(current, rel=1e-12)
    rate = derivative(model)(start, {"V": p["Rm"] * current + p["Kb"] * w}, p)
    assert float(rate["i"]) == pytest.approx(0.0, abs=1e-9)
    assert float(rate["w"]) == pytest.approx(0.0, abs=1e-9)


def test_tied_motor_is_the_motor_with_equal_constants():
    free, tied = dc_motor(), dc_motor(tied=True)
    p = values(tied)
    assert "Kt" not in p
    x, u = point(free)
    assert derivative(free)(x, u, {**p, "Kt": p["Kb"]}) == derivative(tied)(x, u, p)


def test_scaling_mechanics_and_torque_together_changes_nothing():
    model = dc_motor()
    (x, u), p = point(model), values(model)
    scaled = {n: v * (3.0 if n in ("Kt", "Jm", "Cm", "Tf") else 1.0) for n, v in p.items()}
    for state, rate in derivative(model)(x, u, p).items():
        assert float(derivative(model)(x, u, scaled)[state]) == pytest.approx(float(rate), rel=1e-12)


@pytest.mark.parametrize("build", [first_order, second_order])
def test_process_rests_at_gain_times_input_plus_offset(build):
    model = build()
    p = {**values(model), "K": 3.0, "c": 20.0}
    for rate in derivative(model)({s: 26.0 for s in model.states}, {"u": 9.0, "u_delayed": 2.0}, p).values():
        assert float(rate) == pytest.approx(0.0, abs=1e-12)
    assert [(d.input, d.parameter) for d in model.delays] == [("u", "L")]


@pytest.mark.parametrize("build", [first_order, second_order])
def test_process_starts_measured_or_free(build):
    assert set(initial_state(build())({}, {"u": 0.0}, {"y": 7.0}).values()) == {7.0}
    assert set(initial_state(build(initial="free"))({"y0": 5.0}, {"u": 0.0}, {"y": 7.0}).values()) == {5.0}
    with pytest.raises(ModelError, match="use 'measured' or 'free'"):
        build(initial="guess")


def test_gain_unit_follows_the_signals():
    assert first_order(input_unit="%", output_unit="degC").declared("K").unit == "degC/%"
    assert first_order(input_unit="1", output_unit="degC").declared("K").unit == "degC"
    assert first_order(input_unit="rad/s", output_unit="V").declared("K").unit == "V/(rad/s)"
    assert first_order(input_unit="%").declared("K").unit is None


def test_drive_regression_is_the_inverse_of_the_drive():
    """The force of the regression, put into the simulation model, gives the acceleration back."""
    regression, plant = drive_regression(), drive(smooth_width=1e-9)
    p = {"M": 95.1, "Fv": 203.5, "Fc": 20.4, "offset": -3.2}
    draw = np.random.default_rng(0).normal
    signals = {"acceleration": draw(size=20), "velocity": draw(size=20)}
    force = regression.predict(signals, p)
    found = derivative(plant)({"q": np.zeros(20), "v": signals["velocity"]}, {"force": force}, p)["v"]
    np.testing.assert_allclose(found, signals["acceleration"], rtol=1e-10)


def test_least_squares_on_the_regressor_finds_the_parameters_in_any_order_of_rows():
    regression, p = drive_regression(), {"M": 95.1, "Fv": 203.5, "Fc": 20.4, "offset": -3.2}
    rng = np.random.default_rng(0)
    signals = {"acceleration": rng.normal(size=50), "velocity": rng.normal(size=50)}
    force, order = regression.predict(signals, p), rng.permutation(50)
    found = lstsq(regression.columns({n: v[order] for n, v in signals.items()}), force[order])
    assert found is not None
    np.testing.assert_allclose(found[0], list(p.values()), rtol=1e-10)


def test_linear_model_refuses_what_cannot_be_used():
    regression = drive_regression()
    with pytest.raises(ModelError, match="needs the signal 'velocity'"):
        regression.columns({"acceleration": np.zeros(3)})
    with pytest.raises(ModelError, match="no value for parameter 'Fv'"):
        regression.predict({"acceleration": np.zeros(3), "velocity": np.zeros(3)}, {"M": 1.0})
    with pytest.raises(ModelError, match="output 'f' is not one of its outputs"):
        regression.columns({"acceleration": np.zeros(3), "velocity": np.zeros(3)}, "f")
    with pytest.raises(ModelError, match="has no outputs"):
        LinearModel("m", {}, (Declared("a"),), lambda s: np.zeros((1, 1)))
    with pytest.raises(ModelError, match="different names"):
        LinearModel("m", {"y": None}, (Declared("a"), Declared("a")), lambda s: np.zeros((1, 2)))
    with pytest.raises(ModelError, match=r"shape \(2, 3\); it needs 1 columns"):
        LinearModel("m", {"y": None}, (Declared("a"),), lambda s: np.zeros((2, 3))).columns({})
    with pytest.raises(ModelError, match=r"columns for \['z'\]; it needs them for \['y'\]"):
        LinearModel("m", {"y": None}, (Declared("a"),), lambda s: {"z": np.zeros((2, 1))}).columns({})
    with pytest.raises(ModelError, match="base and coefficients belong together"):
        LinearModel("m", {"y": None}, (Declared("a"),), lambda s: np.zeros((2, 1)), base=lambda p: p)


def test_make_names_close_matches():
    with pytest.raises(ModelError, match="Did you mean 'dc_motor'"):
        make("dcmotor")
    with pytest.raises(ModelError, match="Did you mean 'dead_time'"):
        make("first_order", deadtime=True)


def test_describe_lists_everything_declared():
    model = dc_motor(dead_time=True)
    table = describe(model)
    for name in (*model.states, *model.inputs, *model.outputs, *(p.name for p in model.parameters), "V_delayed"):
        assert any(line.split()[1:2] == [name] for line in table.split("\n")), name
    assert "1e-05 to 0.1 (log)" in table
    assert "acceleration" in describe(drive_regression())
