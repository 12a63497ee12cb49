"""Which coordinates of a problem are found to be linear: many models in which they are, and many in which they are
not."""

import numpy as np
import pytest
from problem_motors import line
from projection_plants import curve, linear_names, problem, record, text

import plantfit.runtime  # noqa: F401
from plantfit.models import (
    Declared,
    LinearModel,
    Model,
    dc_motor,
    first_order,
    hammerstein_wiener,
    second_order,
    steam_chamber,
)
from plantfit.problem import Experiment, Problem
from plantfit.problem.linear.affine import affine_by_structure, affine_coordinates
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.steps.registry import FIXED
from plantfit.space import Parameter

import jax
import jax.numpy as jnp

LAG = {"states": ["x"]}
TABLE_OVER_INPUT = {"k": {"over": ["u"], "nodes": [0.0, 1.0, 3.0]}}
TABLE_OVER_STATE = {"k": {"over": ["x"], "nodes": [0.0, 1.0, 3.0]}}
TABLE_OVER_OUTPUT = {"k": {"over": ["y"], "nodes": [0.0, 1.0, 3.0]}}
ENTRIES = ["k[0]", "k[1]", "k[2]"]

# equations, parameters, what is linear, further declarations
TEXTS = {
    "line": ("y = a*u + b", "a b", ["a", "b"], {}),
    "saturation curve": ("y = b1*(1 - exp(-b2*u))", "b1 b2", ["b1"], {}),
    "power": ("y = b1*u^b2", "b1 b2", ["b1"], {}),
    "nothing": ("y = exp(-a*u)/(b + c*u)", "a b c", [], {}),
    "fraction": ("y = (a + b*u)/(1 + c*u)", "a b c", ["a", "b"], {}),
    "sum of exponentials": ("y = a*exp(-b*u) + c*exp(-d*u)", "a b c d", ["a", "c"], {}),
    "product": ("y = a*b*u + c", "a b c", ["a", "c"], {}),
    "product, more on the right": ("y = a*(b*u + c)", "a b c", ["b", "c"], {}),
    "product in a chain": ("y = a*b + b*c*u", "a b c", ["a", "c"], {}),
    "phase": ("y = a*sin(w*u + f) + b", "a w f b", ["a", "b"], {}),
    "saturation of a gain": ("y = sat(a*u, 0, 2) + b", "a b", ["b"], {}),
    "limits": ("y = a*clip(u, l, h) + b", "a l h b", ["a", "b"], {}),
    "condition on data": ("y = a*u if u > 1 else b*u", "a b", ["a", "b"], {}),
    "condition on a parameter": ("y = a*u if u > b else c", "a b c", ["a", "c"], {}),
    "condition on a gain": ("y = u if a*u > 1 else c", "a c", ["c"], {}),
    "table over an input": ("y = k(u)*exp(-a*u)", "a k", ENTRIES, {"tables": TABLE_OVER_INPUT}),
    "table times table entry": ("y = k(u)*a", "a k", ENTRIES, {"tables": TABLE_OVER_INPUT}),
    "table at a gain": ("y = k(a*u) + b", "a b k", ["b", *ENTRIES], {"tables": TABLE_OVER_INPUT}),
    "late input": ("y = a*delay(u, L) + b", "a L b", ["a", "b"], {}),
    "time": ("y = a*exp(-b*t) + c*u", "a b c", ["a", "c"], {}),
    "lag": ("x' = (K*u - x)/T; y = x + c", "K T c", ["K", "c"], LAG),
    "lag, free start": ("x' = (K*u - x)/T; y = x", "K T x0", ["K", "x0"], {"states": {"x": {"initial": "x0"}}}),
    "start from the output": ("x' = (K*u - x)/T; y = x + c", "K T c", ["K", "c"],
                              {"states": {"x": {"initial": "y - c"}}}),
    "start that is scaled": ("x' = (K*u - x)/T; y = x", "K T x0", ["K", "x0"], {"states": {"x": {"initial": "x0/T"}}}),
    "lag with a rate": ("x' = K*u - a*x; y = x", "K a", ["K"], LAG),
    "gain at both ends": ("x' = (K*u - x)/T; y = g*x + c", "K T g c", ["K", "c"], LAG),
    "squared output": ("x' = (K*u - x)/T; y = x^2 + c", "K T c", ["c"], LAG),
    "nonlinear plant": ("x' = K*u - x^3; y = g*x + c", "K g c", ["g", "c"], LAG),
    "nonlinear before linear": (
        "x' = u - T*x^3; z' = (a*x + b*x^2 - z)/R; y = z + c", "T R a b c", ["a", "b", "c"], {"states": ["x", "z"]}
    ),
    "linear before nonlinear": ("x' = (K*u - x)/T; z' = x - z^3; y = z + g*x + c", "K T g c", ["g", "c"],
                                {"states": ["x", "z"]}),
    "bilinear plant": ("x' = K*u - a*x*u; y = x", "K a", ["K"], LAG),
    "two states": ("x' = v; v' = K*u - a*x - b*v + c; y = x", "K a b c", ["K", "c"], {"states": ["x", "v"]}),
    "three states": ("x' = (K*u + c - x)/A; v' = (x - v)/B; w' = (v - w)/C; y = w", "K c A B C", ["K", "c"],
                     {"states": ["x", "v", "w"]}),
    "dead time": ("x' = (K*delay(u, L) - x)/T; y = x + c", "K L T c", ["K", "c"], LAG),
    "late state": ("x' = K*u - a*delay(x, L) - x; y = x + c", "K L a c", ["K", "c"], LAG),
    "late state, nonlinear": ("x' = K*u - x*delay(x, L); y = x + c", "K L c", ["c"], LAG),
    "table over the input of a plant": ("x' = (k(u) - x)/T; y = x + c", "T c k", ["c", *ENTRIES],
                                        {**LAG, "tables": TABLE_OVER_INPUT}),
    "table over the state": ("x' = (k(x)*u - x)/T; y = x + c", "T c k", ["c"], {**LAG, "tables": TABLE_OVER_STATE}),
    "table over the output": ("x' = (k(y)*u - x)/T; y = x + c", "T c k", [], {**LAG, "tables": TABLE_OVER_OUTPUT}),
    "saturated input": ("x' = (sat(K*u, 0, 2) - x)/T; y = x + c", "K T c", ["c"], LAG),
    "dry friction": ("v' = K*u - friction(v, F) - b*v; y = v + c", "K F b c", ["c"], {"states": ["v"]}),
    "backlash": ("x' = K*u - x; z = play(x, g); y = a*z + c", "K g a c", ["a", "c"], {"states": ["x", "z"]}),
    "event at a state": ("x' = K*u - x; when rising(x - 1): x = 0\ny = a*x + c", "K a c", ["a", "c"], LAG),
    "event at a clock": (
        "x' = K*u - x; s' = 1; when rising(s - 1): s = 0, x = r\ny = x + c", "K r c", ["K", "r", "c"],
        {"states": ["x", "s"]}
    ),
    "two outputs": ("y = a*u + b; q = c*exp(-d*u) + b", "a b c d", ["a", "b", "c"], {"outputs": ["y", "q"]}),
    "product in one of two outputs": ("y = a*u; q = b*u + a*b", "a b", ["a"], {"outputs": ["y", "q"]}),
    "nonlinear in one of two outputs": ("y = a*u + b; q = sqrt(a)*u", "a b", ["b"], {"outputs": ["y", "q"]}),
    "smooth friction": ("v' = K*u - F*smooth_sign(v, 0.1) - b*v; y = v + c", "K F b c", ["c"], {"states": ["v"]}),
    "friction over an input": ("v' = K*u - F*sign(u) - b*v; y = v", "K F b", ["K", "F"], {"states": ["v"]}),
}  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_what_is_linear_in_equations_is_found(name):
    lines, names, expected, settings = TEXTS[name]
    assert sorted(linear_names(text(lines, names, **settings))) == sorted(expected)


# Python models: an output over an input and parameters, shapes, what is linear
CURVES = {
    "entries of an array": (
        lambda u, p: p["b"][0] * jnp.exp(-p["b"][1] * u) + p["b"][2],
        {"b": (3,)},
        ["b[0]", "b[2]"],
    ),
    "polynomial": (lambda u, p: jnp.polyval(p["b"], u), {"b": (4,)}, ["b[0]", "b[1]", "b[2]", "b[3]"]),
    "matrix": (
        lambda u, p: jnp.array([u, 1.0]) @ p["A"] @ jnp.array([1.0, u]) * p["g"],
        {"A": (2, 2), "g": ()},
        ["A[0,0]", "A[0,1]", "A[1,0]", "A[1,1]"],
    ),
    "loop over entries": (
        lambda u, p: jax.lax.fori_loop(0, 3, lambda i, y: y * u + p["b"][i], 0.0),
        {"b": (3,)},
        ["b[0]", "b[1]", "b[2]"],
    ),
    "gain in a function": (lambda u, p: jnp.tanh(p["a"] * u) + p["b"], {"a": (), "b": ()}, ["b"]),
    "norm": (lambda u, p: jnp.linalg.norm(p["b"]) * u + p["c"], {"b": (2,), "c": ()}, ["c"]),
}


@pytest.mark.parametrize("name", CURVES)
def test_what_is_linear_in_a_python_model_is_found(name):
    output, shapes, expected = CURVES[name]
    assert linear_names(curve(output, shapes)) == expected


LIBRARY = {
    "first order": (first_order(), ["K", "c"]),
    "first order, free start": (first_order(initial="free"), ["K", "c", "y0"]),
    "first order, bare": (first_order(dead_time=False, offset=False), ["K"]),
    "second order": (second_order(initial="free"), ["K", "c", "y0"]),
    "motor": (dc_motor(), []),
    "tied motor": (dc_motor(tied=True, current_output=True), []),
    "hammerstein": (hammerstein_wiener(output_curve="none"), [f"f[{i}]" for i in range(5)]),
    "hammerstein-wiener": (hammerstein_wiener(degree=3), ["g0", "g1", "g2", "g3"]),
    "wiener with a table": (
        hammerstein_wiener(input_curve="none", output_curve="table"),
        [f"g[{i}]" for i in range(5)],
    ),
    "saturated, modal": (hammerstein_wiener(input_curve="saturation", form="modal"), ["c1", "g0"]),
}


@pytest.mark.parametrize("name", LIBRARY)
def test_what_is_linear_in_the_library_is_found(name):
    model, expected = LIBRARY[name]
    assert linear_names(model) == expected


def test_a_plant_with_tables_over_its_own_output_has_no_linear_table():
    bounds = {d.name: (0.5, 2.0) for d in steam_chamber().parameters if d.bounds is None and d.value is None}
    assert linear_names(steam_chamber(), bounds) == []


def test_the_motor_without_friction_is_linear_in_its_torque_constant():
    assert linear_names(dc_motor(current_output=True), {"Tf": 0.0, "Kb": 0.0}) == ["Kt"]
    assert linear_names(dc_motor(current_output=True), {"Tf": 0.0}) == []
    assert linear_names(dc_motor(current_output=True), {"Tf": 0.1, "Kb": 0.0}) == []
    assert linear_names(dc_motor(), {"Tf": 0.0, "Kb": 0.0}) == []  # its current starts at what friction needs over Kt


def test_regressions_are_linear_in_their_coefficients_as_far_as_their_base_is():
    plain = LinearModel(
        "r", {"y": None}, (Declared("a", bounds=(0.2, 3)), Declared("b", bounds=(0.2, 3))), _columns, {"u": None}
    )
    assert linear_names(plain) == ["a", "b"]
    based = LinearModel(
        "r", {"y": None}, (Declared("m", bounds=(0.2, 3)), Declared("l", bounds=(0.2, 3)),
                           Declared("J", bounds=(0.2, 3))), _columns,
        {"u": None}, {"c0": None, "c1": None}, lambda p: {"c0": p["m"] * p["l"] ** 2 + p["J"], "c1": p["m"]},
    )  # fmt: skip
    assert linear_names(based) == ["m", "J"]


def _columns(signals):
    return np.column_stack([signals["u"], np.ones(len(signals["u"]))])


# -- spaces -------------------------------------------------------------------------------------------


def test_held_and_tied_parameters_count_as_what_they_are():
    model = text("y = a*u + b*exp(-c*u) + d", "a b c d")
    assert linear_names(model, {"a": 2.0}) == ["b", "d"]
    assert linear_names(model, {"d": Parameter(tied="a")}) == ["a", "b"]
    assert linear_names(model, {"d": Parameter(tied="c")}) == ["a", "b"]
    assert linear_names(model, {"a": Parameter(tied="b"), "c": 1.0}) == ["b", "d"]
    product = text("y = a*b*u + c", "a b c")
    assert linear_names(product, {"a": 2.0}) == ["b", "c"]
    assert linear_names(product, {"a": Parameter(tied="b")}) == ["c"]


def test_a_parameter_for_every_recording_counts_once_for_each():
    model = text("y = a*(u + b)", "a b")
    assert linear_names(model, records=3) == ["a"]
    assert linear_names(model, {"b": Parameter((0.2, 3), per_recording=True)}, records=3) == ["b[r0]", "b[r1]", "b[r2]"]
    assert linear_names(model, {"a": Parameter((0.2, 3), per_recording=True)}, records=2) == ["a[r0]", "a[r1]"]


def test_the_order_of_parameters_decides_between_equals_alone():
    lines = "x' = (K*u - x)/T; y = g*x + c"
    assert linear_names(text(lines, "K T g c", **LAG)) == ["K", "c"]
    assert linear_names(text(lines, "c g T K", **LAG)) == ["c", "g"]


def test_coordinates_by_decades_are_linear_unless_they_are_smoothed():
    model = text("y = k(u)*exp(-a*u)", "a k", tables=TABLE_OVER_INPUT)
    assert linear_names(model, {"k": Parameter((0.2, 3), scale="log")}) == ENTRIES
    assert linear_names(model, {"k": Parameter((0.2, 3), smooth=0.1)}) == ENTRIES
    assert linear_names(model, {"k": Parameter((0.2, 3), smooth=0.1, scale="log")}) == []


def test_records_at_rest_are_nonlinear_in_what_enters_the_rates():
    model = text("x' = (K*u - x)/T; y = g*x + c", "K T g c", **LAG)
    assert linear_names(model, steady=True) == ["g", "c"]
    moving, still = record(model, 0, name="a"), Experiment(record(model, 1, name="b"), steady=True)
    both = Problem(model, {"a": moving, "b": still})
    assert [both.space.names[i] for i in affine_by_structure(both)] == ["g", "c"]


def test_many_entries_multiplied_with_many_leave_the_smaller_table():
    tables = {"k": {"over": ["u"], "nodes": [0.0, 1.0, 3.0]}, "h": {"over": ["w"], "nodes": list(range(12))}}
    model = text("y = k(u)*h(w) + a", "k h a", inputs=["u", "w"], tables=tables)
    assert linear_names(model) == [f"h[{i}]" for i in range(12)] + ["a"]


# -- the guard ------------------------------------------------------------------------------------------


def _lying():
    @jax.custom_jvp
    def half(x):
        return 0.5 * x

    half.defjvp(lambda primals, tangents: (half(primals[0]), primals[0] * tangents[0]))
    return half


def test_a_derivative_that_contradicts_its_function_is_left_out():
    half = _lying()
    made = problem(curve(lambda u, p: half(p["a"] * u) + p["b"] * u**2, {"a": (), "b": ()}))
    assert [made.space.names[i] for i in affine_by_structure(made)] == ["a", "b"]
    assert affine_coordinates(made) == ()
    honest = problem(curve(lambda u, p: 0.5 * p["a"] * u + p["b"] * u**2, {"a": (), "b": ()}))
    assert affine_coordinates(honest) == (0, 1)


def test_what_cannot_be_simulated_is_left_to_the_equations():
    made = problem(curve(lambda u, p: p["a"] * jnp.sqrt(p["c"] - 2.9) + p["b"], {"a": (), "b": (), "c": ()}))
    assert affine_coordinates(made) == (0, 1)


def test_variants_share_what_was_found_and_a_freed_parameter_is_looked_at_anew():
    made = problem(text("x' = (K*u - x)/T; y = x + c", "K T c", **LAG), {"c": 1.0})
    found = affine_coordinates(made)
    assert found == (0,)
    assert affine_coordinates(made.with_scales({"y": 3.0})) is found
    assert affine_coordinates(made.with_simulator(made.predictor.stepping().refined(2))) is found
    freed = made.freed({"c": (0.0, 2.0)})
    assert [freed.space.names[i] for i in affine_coordinates(freed)] == ["K", "c"]


MOVING = [
    "lag, free start",
    "dead time",
    "late state",
    "table over the input of a plant",
    "nonlinear before linear",
    "event at a clock",
]
MOVING += ["event at a state", "backlash", "dry friction", "table at a gain"]


# of every stepper what moves by itself, what is not linear, and what jumps; of one stepper all of them
OFTEN = ["lag, free start", "nonlinear before linear", "event at a state"]


@pytest.mark.parametrize(
    ("stepper", "name"),
    [
        pytest.param(stepper, name, marks=() if stepper == "exponential" or name in OFTEN else pytest.mark.slow)
        for stepper in FIXED
        for name in MOVING
    ],
)
@pytest.mark.further(2)
def test_residuals_are_affine_to_rounding_in_what_is_found(name, stepper):
    lines, names, _, settings = TEXTS[name]
    made = problem(text(lines, names, **settings), stepper=stepper)
    places = np.array(affine_by_structure(made))
    assert affine_coordinates(made) == tuple(places)
    rng = np.random.default_rng(3)
    z = rng.uniform(0.2, 0.8, made.space.dimension)
    ends = rng.uniform(0.0, 1.0, (2, len(places)))

    def residuals(share):
        point = z.copy()
        point[places] = (1 - share) * ends[0] + share * ends[1]
        return np.asarray(made.residuals(point))

    np.testing.assert_allclose(residuals(0.3), 0.7 * residuals(0.0) + 0.3 * residuals(1.0), rtol=1e-11, atol=1e-11)


def test_an_exact_stepper_keeps_what_is_linear():
    made = problem(text(*TEXTS["two states"][:2], states=["x", "v"]), stepper="exact")
    assert [made.space.names[i] for i in affine_coordinates(made)] == ["K", "c"]


def test_a_straight_input_keeps_what_is_linear():
    made = problem(text(*TEXTS["lag"][:2], **LAG), hold={"u": "linear"})
    assert [made.space.names[i] for i in affine_coordinates(made)] == ["K", "c"]


def test_a_static_line_of_two_units_is_linear():
    recording = Recording(np.arange(9.0), {"u": Signal(np.arange(9.0), "mV"), "y": Signal(np.arange(9.0), "rpm")})
    made = Problem(line(), recording)
    assert [made.space.names[i] for i in affine_coordinates(made)] == ["a", "b"]


def test_a_model_without_anything_linear_has_nothing():
    model = Model(
        "m", {}, {"u": None}, {"y": None}, (Declared("a", bounds=(1, 2)),), lambda x, u, p: {"y": u["u"] ** p["a"]}
    )
    assert affine_coordinates(problem(model)) == ()
