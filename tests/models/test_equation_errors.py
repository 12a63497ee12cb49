"""Every mistake in the text: its place and what the message names."""

import random
from typing import Any

import pytest
from model_calls import initial_state

from plantfit.errors import EquationError, ModelError, PlantfitError, UnitError
from plantfit.models import Declared, equations

BASE: dict[str, Any] = {
    "inputs": {"u": None}, "states": {"x": {"unit": None}}, "outputs": {"y": None}, "parameters": ["k"],
}  # fmt: skip


def build(text, **changes):
    return equations(text, **{**BASE, **changes})


PLACES = [
    # text, line, column, part of the message
    ("x' = k*u\ny = uu", 1, 4, "'uu' is not known. Did you mean 'u'?"),
    ("x' = k*u\n\n  y = x + sni(u)  # sine", 2, 10, "'sni' is not known. Did you mean 'sin'?"),
    ("x' = k*u(t - 2.5)\ny = x", 0, 7, "some time ago write delay(u, 2.5)."),
    ("x' = k*u(t)\ny = x", 0, 7, "A signal stands without its time; write u."),
    ("x' = k*u; y = x.real", 0, 15, "A dot after a name"),
    ("x' = k*u; y = (x).real", 0, 17, "A dot after a name"),
    ("x' = k*u; y = x[0]", 0, 15, "An index in brackets"),
    ("x' = k*u\ny = x, u", 1, 5, "A comma outside"),
    ("x' = k*u\ny = lambda: x", 1, 4, "lambda is not allowed"),
    ("x' = k*u\ny = [x for x in x]", 1, 4, "A comprehension"),
    ("x' = k*u\ny = {x}", 1, 4, "A pair of braces"),
    ("x' = k*u\ny = x*'text'", 1, 6, "The mark '"),
    ('x\' = k*u\ny = f"{x}"', 1, 5, 'The mark "'),
    ("x' = k*u\ny = x // 2", 1, 6, "The operator //"),
    ("x' = k*u\ny = (x) % 2", 1, 8, "The operator %"),
    ("x' = k*u\ny = ~x", 1, 4, "The operator ~"),
    ("x' = k*u\ny = x is u", 1, 4, "'in' and 'is'"),
    ("x' = k*u\ny = True", 1, 4, "True is not allowed"),
    ("x' = k*u\ny = 1j*x", 1, 4, "1j is not allowed"),
    ("x' = k*u\ny = sin(x=u)", 1, 4, "write sin(x)"),
    ("x' = k*u\ny = sat(x, 1)", 1, 4, "'sat' takes 3 arguments, not 2; write sat(x, low, high)"),
    ("x' = k*u\ny = sin", 1, 4, "'sin' is a function; write sin(x)"),
    ("x' = k*u\ny = 3(x)", 1, 4, "write * to multiply"),
    ("x' = k*u\ny = x x", 1, 6, "An operator is missing here"),
    ("x' = k*u\ny = x +", 1, 7, "ends too early"),
    ("x' = k*u\ny = 5x", 1, 4, "An operator is missing here"),
    ("x' = k*u\ny = sin(x +\n  u", 1, 7, "never closed"),
    ("x' = k*u\ny = x)", 1, 5, "never opened"),
    ("x' = k*u\ny =  ", 1, 2, "There is nothing right"),
    ("x' = k*u\n x + u", 1, 1, "There is no '='"),
    ("x' = k*u\ny == x", 1, 2, "'==' compares two values; write one '='"),
    ("x'' = k*u\ny = x", 0, 0, "write a second derivative with one more state, as in x' = v and v' = ..."),
    ("dx/dt = k*u\ny = x", 0, 0, "'dx/dt' cannot stand left of '='; write a single name, or name' for the derivative"),
    ("x' = (k u)\ny = x", 0, 6, "An operator is missing here; write * to multiply"),
    ("x' = k*u/0\ny = x", 0, 8, "This divides by 0; write a divisor that is not 0"),
    ("x' = k*u\ny = x/(2 - 2)", 1, 5, "This divides by 0"),
    ("x' = k*u\ny = 2,5*x", 1, 5, "write decimals with a point, as in 2.5"),
    ("x' = k*u\ny = x²", 1, 5, "The character '²' cannot be read in equations; delete it, and write powers as x^2"),
    ("x' = k*u\ny += x", 1, 0, "'y +' cannot stand left of '='"),
    ("x' = k*u\ny = x @ u", 1, 6, "The character @"),
    ("x' = k*u\ny = x\x00", 1, 5, "cannot be read"),
    ("x' = k*u\ny = x; y = u", 1, 7, "'y' has an equation already in line 2"),
    ("x' = k*u\nx = 3", 1, 0, "'x' is a state; write x' = ..."),
    ("x' = k*u\nu = 3", 1, 0, "'u' is an input"),
    ("x' = k*u\nk = 3", 1, 0, "'k' is a parameter"),
    ("x' = k*u\nt = 3", 1, 0, "'t' has a meaning of its own"),
    ("x' = k*u\n y' = x", 1, 1, "'y' is not a state; states are ['x']"),
    ("x' = k*u\na = b; b = 2*c; c = a\ny = a", 1, 0, "a -> b -> c -> a"),
    ("x' = k*u\ny = y + x", 1, 0, "y -> y"),
    (
        "x' = k*u\ny = delay(k, k)",
        1,
        10,
        "The first argument of delay() is the name of an input or a state, one of u, x.",
    ),
    ("x' = k*u\ny = delay(u, -1)", 1, 13, "looks into the future"),
    ("x' = k*u\ny = delay(u, kk)", 1, 13, "'kk' is none of them. Did you mean 'k'?"),
    ("x' = k*u\ny = delay(u, 2*k)", 1, 13, "a parameter, a constant or a number"),
    (
        "x' = k*u\ny = delay(u, k/x)",
        1,
        13,
        "one that changes with x is not there yet. Write delay(u, L) with a parameter L",
    ),
    ("x' = k*u\ny = delay(x, u)", 1, 13, "one that changes with u is not there yet. Write delay(x, L)"),
    ("x' = k*u\ny = delay(u, k*t)", 1, 13, "one that changes with time is not there yet"),
    ("x' = k*u\nθ = x; y = θθ + 1", 1, 11, "'θθ' is not known"),
    ("x' = k*u\r\ny = x + q\r\n", 1, 8, "'q' is not known"),
    ("x' = k*u\ny = x^2 + u^3 + q", 1, 16, "'q' is not known"),
    ("x' = k*u\ny = (x\n + u\n + q)", 3, 3, "'q' is not known"),
]


@pytest.mark.parametrize(("text", "line", "column", "message"), PLACES)
def test_place_and_message(text, line, column, message):
    with pytest.raises(EquationError) as caught:
        build(text)
    assert message in caught.value.reason
    assert (caught.value.line, caught.value.column) == (line, column)
    assert caught.value.text == text


HOSTILE = [
    ("y = __import__('os')", 15),
    ("y = __import__(u)", 4),
    ("y = ().__class__", 6),
    ("y = x.__class__.__bases__", 15),
    ("y = eval(u)", 4),
    ("y = (lambda: 1)()", 5),
    ("y = 9**9**9", 5),
    ("y = 9^9^9^9^9", 9),
    ("y = 1e999", 4),
    ("y = " + "9" * 400, 4),
    ("y = " + "9" * 5000, 4),
    ("y = 1/0", 5),
    ("y = " + "(" * 500 + "x" + ")" * 500, 64),
    ("y = " + "-" * 50_000 + "x", 4),
    ("y = " + "not " * 10_000 + "x", 4),
    ("y = " + "2**" * 10_000 + "x", 4),
    # Python 3.13 reads it, and it is too deep; 3.12 gives up
    ("y = " + "x if u else " * 5000 + "1", (4, 4 + 150 * 12)),
    ("y = " + "+".join(["x"] * 20_000), 4),
    ("y = x" + " " * 100_001, 0),
]


@pytest.mark.parametrize(("text", "column"), HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_text_is_refused_before_it_is_worked_out(text, column):
    with pytest.raises(EquationError) as caught:
        build(text)
    assert caught.value.column in (column if isinstance(column, tuple) else (column,))


TOKENS = (
    *(
        "x",
        "u",
        "k",
        "1",
        "2.5",
        "+",
        "-",
        "*",
        "/",
        "^",
        "**",
        "(",
        ")",
        "'",
        "=",
        ";",
        "\n",
        "#",
        " ",
        "if",
        "else",
        "and",
        "not",
        "é",
    ),
    *(
        "sin(",
        "max(",
        "delay(",
        ",",
        "<",
        ">=",
        "[",
        "]",
        "{",
        "}",
        ":",
        "λ",
        "\t",
        ".",
        "_",
        "1e",
        "0x",
        "\\",
        '"',
        "in",
        "lambda ",
    ),
    *("\u2028", "🙂", "for ", "await ", "x' = ", "y = "),
)


def error_of(text):
    """The error that plantfit raises for a text, None for a text that it takes."""
    try:
        build(text)
    except PlantfitError as error:
        return error
    return None


def test_random_text_gives_a_model_or_an_error_with_a_place():
    draw, refused = random.Random(7), 0
    for _ in range(600):
        text = "x' = k*u; y = " + " ".join(draw.choices(TOKENS, k=draw.randint(1, 8)))
        error, lines = error_of(text), text.split("\n")
        if isinstance(error, EquationError):
            refused += 1
            assert 0 <= error.line < len(lines), text
            assert 0 <= error.column <= len(lines[error.line]), text
    assert 300 < refused < 600


def test_nesting_within_the_limit_is_read_and_evaluated():
    model = build("x' = k*u; y = " + "+".join(["x"] * 150))
    assert float(model.output({"x": 2.0}, {"u": 0.0}, {"k": 1.0})["y"]) == 300.0
    with pytest.raises(EquationError, match="nests more than 150"):
        build("x' = k*u; y = " + "+".join(["x"] * 151))


def test_caret_stands_under_the_character():
    with pytest.raises(EquationError) as caught:
        build("x' = k*u\n  y = x + q")
    assert str(caught.value).split("\n")[1:] == ["      y = x + q", "    " + " " * 10 + "^"]


CONTRADICTIONS = [
    ("y = x*k*u", {}, "state 'x' has no derivative"),
    ("x' = k*u", {}, "output 'y' has no equation"),
    ("x' = k*x; y = x", {}, "input 'u' is never used"),
    ("x' = u; y = x", {}, "parameter 'k' is never used"),
    ("x' = k*u; y = x", {"outputs": {}}, "has no outputs"),
    ("x' = k*u; y = x", {"inputs": {"u": None, "sin": None}}, "which equations use themselves"),
    ("x' = k*u; y = x", {"parameters": ["k", "lambda"]}, "no Python keyword"),
    ("x' = k*u; y = x", {"parameters": ["k", "a b"]}, "'a b'"),
    ("x' = k*u; y = x", {"parameters": ["k", "\u00b5"]}, "write '\u03bc'"),
    ("x' = k*u; y = x", {"constants": {"k": 1.0}}, "declared in parameters and in constants"),
    ("x' = k*u; y = x", {"parameters": {"k": {"bound": (0, 1)}}}, "Did you mean 'bounds'?"),
    ("x' = k*u; y = x", {"parameters": {"k": {"bounds": (0, 1, 2)}}}, "write two numbers"),
    ("x' = k*u; y = x", {"parameters": {"k": {"bounds": (0, "a")}}}, "a bound of parameter 'k' is 'a'"),
    ("x' = k*u; y = x", {"parameters": {"k": {"scale": "ln"}}}, "use 'linear' or 'log'"),
    ("x' = k*u; y = x", {"parameters": {"k": 3}}, "parameter 'k' is 3"),
    ("x' = k*u; y = x", {"parameters": {"k": Declared("K")}}, "has a declaration for 'K'"),
    ("x' = k*u; y = x", {"constants": {"g": "about 9"}}, "'about 9'; write a number and a unit"),
    ("x' = k*u; y = x", {"constants": {"g": float("nan")}}, "write a finite number"),
    ("x' = k*u; y = x", {"states": {"x": {"initial": True}}}, "initial value of state 'x' is True"),
    ("x' = k*u; y = x", {"states": {"x": {"start": 1}}}, "Known are unit, initial"),
    ("x' = k*u; y = x", {"inputs": {"u": 3}}, "the unit of input 'u' is 3"),
    ("x' = k*u; y = x", {"inputs": "u"}, "inputs are 'u'"),
    (b"y = x", {}, "the equations are bytes"),
]


@pytest.mark.parametrize(("text", "changes", "message"), CONTRADICTIONS)
def test_contradicting_declarations(text, changes, message):
    with pytest.raises(ModelError) as caught:
        build(text, **changes)
    assert not isinstance(caught.value, EquationError)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("initial", "column", "message"),
    [
        ("y + yy", 4, "'yy' is not known. Did you mean 'y'?"),
        ("2*x", 2, "'x' is not known"),
        ("delay(u, k)", 0, "delay() has no meaning at the start"),
        ("y +", 3, "ends too early"),
        ("y; k", 0, "One expression is needed"),
        ("", 0, "One expression is needed"),
        ("x' ", 1, "The mark '"),
    ],
)
def test_errors_in_initial_values(initial, column, message):
    with pytest.raises(EquationError) as caught:
        build("x' = k*u; y = x", states={"x": {"initial": initial}})
    assert message in caught.value.reason
    assert "'x'" in caught.value.reason
    assert (caught.value.line, caught.value.column, caught.value.text) == (0, column, initial)


def test_name_used_only_in_an_initial_value_counts_as_used():
    model = build("x' = u; y = x", states={"x": {"initial": "k"}})
    assert float(initial_state(model)({"k": 4.0}, {"u": 0.0}, {"y": 0.0})["x"]) == 4.0


@pytest.mark.parametrize("kind", ["inputs", "outputs", "parameters"])
def test_unit_that_does_not_exist_names_its_owner(kind):
    name = {"inputs": "u", "outputs": "y", "parameters": "k"}[kind]
    with pytest.raises(UnitError, match=f"The unit of {kind[:-1]} '{name}'"):
        build("x' = k*u; y = x", **{kind: {name: "furlonk"}})


@pytest.mark.parametrize("output", ["az = v' + g0", "az = 2*v' - v'", "az=g0+v'"])
def test_a_rate_right_of_the_sign_is_told_how_to_be_written(output):
    given: dict[str, Any] = {"states": ["x", "v"], "outputs": ["az"], "parameters": ["k", "g0"]}
    with pytest.raises(EquationError, match=r"The rate v' cannot stand right of '='.*rate = .* and v' = rate"):
        equations(f"x' = v\nv' = -k*x\n{output}", **given)
    equations("x' = v\nrate = -k*x\nv' = rate\naz = rate + g0", **given)
