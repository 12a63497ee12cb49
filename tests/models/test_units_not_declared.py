"""Equations of which few units are declared: what must be accepted, what contradicts itself whatever the other units
are."""

import itertools

import pytest

from plantfit import units
from plantfit.errors import EquationError, UnitError
from plantfit.models import Declared, Delay, Model, equations
from plantfit.models.text.dimensions.contradictions import spelled
from plantfit.models.text.dimensions.forms import form_of

LAG = "x' = (k*u - x)/tau; y = x"
DECLARED = list(itertools.product((None, "degC"), (None, "degC"), (None, "%"), (None, "degC/%")))


def lag(tau, state=None, output=None, input=None, gain=None, text=LAG, **more):
    return equations(
        text,
        inputs={"u": input},
        states={"x": state},
        outputs={"y": output},
        parameters={"k": gain, "tau": tau, **more},
    )


@pytest.mark.parametrize("declared", DECLARED)
@pytest.mark.parametrize("tau", ["min", "week", "ms", "furlong", "1/s", "1/min", "%", "Hz", "kg"])
def test_a_time_constant_in_no_second_is_refused_whatever_else_is_declared(tau, declared):
    """x in degC with k and u in units was the only one of these sixteen that was refused."""
    with pytest.raises(EquationError) as caught:
        lag({"unit": tau, "bounds": (1.0, 10.0)}, *declared)
    if units.compatible(tau, "s"):
        low, high = (f"{units.convert(v, tau, 's'):.12g}" for v in (1.0, 10.0))
        assert f"Write unit = \"s\", bounds = [{low}, {high}] for 'tau'" in caught.value.reason
    elif declared != ("degC", "degC", "%", "degC/%") and declared != ("degC", None, "%", "degC/%"):
        assert f"parameter 'tau' has the unit {tau!r}, but must be in s" in caught.value.reason


@pytest.mark.parametrize("declared", DECLARED)
@pytest.mark.parametrize("tau", ["s", "sec", None])
def test_a_time_constant_in_seconds_is_accepted_whatever_else_is_declared(tau, declared):
    lag(tau, *declared)


FITS = {
    "a hidden 1/s": ("x' = u - x/tau", {"u": "V"}, {"x": None}, "V", {"tau": "s"}),
    "a hidden 1/s beside a known state": ("x' = -2*x + u", {"u": "V"}, {"x": None}, "V", {}),
    "no units at all": ("x' = v; v' = mu*(1 - x^2)*v - x", {}, ["x", "v"], None, {"mu": None}),
    "a mass only": ("x' = v; v' = (F - b*v - k*x)/m", {"F": None}, ["x", "v"], None, {"b": None, "k": None, "m": "kg"}),
    "a hidden stiffness": ("x' = v; v' = (F - 2*x - b*v)/m", {"F": "N"}, ["x", "v"], "m", {"b": "N*s/m", "m": "kg"}),
    "numbers with hidden units": ("x' = v; v' = -10 - b*v", {}, ["x", "v"], "m", {"b": "1/s"}),
    "minutes by a number": ("x' = (u - x)/(60*tau)", {"u": None}, ["x"], "V", {"tau": "min"}),
    "minutes by a number below": ("x' = (u - x)*k/60", {"u": None}, ["x"], "V", {"k": "1/min"}),
    "minutes by several numbers": ("x' = (u - x)/(2*30*tau)", {"u": None}, ["x"], "V", {"tau": "min"}),
    "weeks by a number of days": ("x' = (u - x)/(7*86400*tau)", {"u": None}, ["x"], "V", {"tau": "week"}),
    "kohm and mF": ("x' = (u - x)/(R*C)", {"u": None}, ["x"], None, {"R": "kohm", "C": "mF"}),
    "rates in Hz": ("x' = v; v' = w^2*(u - x) - 2*z*w*v", {"u": None}, ["x", "v"], None, {"w": "rad/s", "z": ""}),
    "an angle in deg, converted": ("x' = w; w' = -g*sin(x); y = x*180/pi", {}, ["x", "w"], "deg", {"g": "1/s^2"}),
    "a flow": ("x' = (u - c*sqrt(x))/A", {"u": "cm^3/s"}, ["x"], "cm", {"A": "cm^2", "c": "cm^2.5/s"}),
    "heat": ("x' = (u - G*(x - Ta))/C", {"u": "W", "Ta": "degC"}, ["x"], "degC", {"G": "W/K", "C": "J/K"}),
    "a power in degC, made absolute": ("x' = (u - s*(x + 273.15)^4)/C", {"u": "W"}, ["x"], "degC",
                                       {"s": "W/K^4", "C": "J/K"}),
    "a power in K": ("x' = (u - s*x^4)/C", {"u": "W"}, ["x"], "K", {"s": "W/K^4", "C": "J/K"}),
    "a free exponent": ("x' = (u - x^n)/tau", {"u": None}, ["x"], "bar", {"n": None, "tau": "s"}),
    "a logarithm of numbers": ("x' = (u - k*log(x))/tau", {"u": None}, ["x"], "bar", {"k": None, "tau": "s"}),
    "a share": ("x' = (u - x)/tau; y = exp(x)", {"u": "%"}, ["x"], None, {"tau": "s"}),
    "an event at a number of seconds": ("x' = -x/tau; when rising(t - 12): x = x + d", {}, ["x"], None,
                                        {"tau": "s", "d": None}),
    "an event before a number of seconds": ("x' = -x/tau if t < 100 else 0", {}, ["x"], None, {"tau": "s"}),
    "an event at a frequency": ("x' = 0; when rising(sin(2*pi*f*t)): x = x + d", {}, ["x"], None,
                                {"f": "Hz", "d": None}),
    "a dead time without unit": ("x' = (delay(u, L) - x)/tau", {"u": None}, ["x"], None, {"L": None, "tau": "s"}),
}  # fmt: skip


def made(text, inputs, states, output, parameters, **more):
    text = text if "y =" in text else f"{text}; y = x"
    return equations(text, inputs=inputs, states=states, outputs={"y": output}, parameters=parameters, **more)


@pytest.mark.parametrize("what", FITS)
def test_right_models_of_few_units_are_accepted(what):
    made(*FITS[what])


MISFITS = {
    "minutes with a number that converts nothing": ("x' = (u - 2*x)/tau", {"u": None}, ["x"], None, {"tau": "min"},
                                                    'Write unit = "s"'),
    "minutes the wrong way round": ("x' = -x/(tau/60)", {}, ["x"], None, {"tau": "min"},
                                    "60 converts a unit the wrong way round"),
    "a rate": ("x' = -k*x", {}, ["x"], None, {"k": "1/day"},
               'Write unit = "1/s" and its numbers times 1.15740740741e-05'),
    "a rate in a function": ("x' = u*exp(-k*t)", {"u": None}, ["x"], None, {"k": {"unit": "1/h", "bounds": (1, 2)}},
                             'Write unit = "1/s"'),
    "a speed": ("x' = v; v' = w^2*(u - x) - z*w*v", {"u": None}, ["x", "v"], None, {"w": "rpm", "z": ""},
                'Write unit = "rad/s"'),
    "a damping": ("x' = v; v' = (F - b*v - k*x)/m", {"F": "N"}, ["x", "v"], "m",
                  {"b": "N*min/m", "k": "N/m", "m": "kg"}, '"N*s/m"'),
    "a gain": (LAG, {"u": "V"}, ["x"], "degC", {"k": "degC/mV", "tau": "s"},
               'Write unit = "degC/V" and its numbers times 1000'),
    "a flow": ("x' = (u - c*sqrt(x))/A", {"u": "l/min"}, ["x"], "cm", {"A": "cm^2", "c": None}, "Declare it in cm^3/s"),
    "an angle": ("x' = w; w' = -g*sin(x)", {}, ["x", "w"], "deg", {"g": "1/s^2"},
                 "output 'y' has the unit 'deg', but must be in rad"),
    "a heat": ("x' = (u - G*(x - Ta))/C", {"u": "W", "Ta": None}, ["x"], None, {"G": "W/K", "C": "Wh/K"},
               'Write unit = "J/K"'),
    "degF": ("x' = (u - G*(x - Ta))/C", {"u": "W", "Ta": None}, ["x"], "degF", {"G": "W/K", "C": "J/K"},
             "must be in degC"),
    "kohm and uF": ("x' = (u - x)/(R*C)", {"u": None}, ["x"], None, {"R": "kohm", "C": "uF"}, "1000 times as large"),
    "a dead time": ("x' = (delay(u, L) - x)/tau", {"u": None}, ["x"], None, {"L": "min", "tau": "s"},
                    "A delay must be in s"),
    "two of them": ("x' = (delay(u, L) - x)/tau", {"u": None}, ["x"], None, {"L": "min", "tau": "h"},
                    "its numbers times 60 for 'L'"),
    "an event": ("x' = 0; when rising(t - a): x = 1", {}, ["x"], None, {"a": {"unit": "h", "bounds": (1, 2)}},
                 "bounds = [3600, 7200]"),
    "a play": ("z = play(x, gap); x' = (u - x)/tau; y = z", {"u": None}, ["x", "z"], "rad", {"gap": "deg", "tau": "s"},
               'unit = "rad"'),
    "a power in degC": ("x' = (u - s*x^4)/C", {"u": "W"}, ["x"], "degC", {"s": "W/K^4", "C": "J/K"},
                        "whose zero is not absolute"),
    "a quotient by degC": ("x' = -a/x", {}, ["x"], "degC", {"a": None}, "whose zero is not absolute"),
    "a dB": (LAG, {"u": None}, ["x"], None, {"k": None, "tau": "dB"}, "logarithmic"),
}  # fmt: skip


@pytest.mark.parametrize("what", MISFITS)
def test_declared_units_that_contradict_each_other_are_refused(what):
    *model, told = MISFITS[what]
    with pytest.raises((EquationError, UnitError)) as caught:
        made(*model)
    assert told in str(caught.value)


def test_check_can_be_switched_off_but_a_dead_time_counts_in_seconds():
    made(LAG, {"u": None}, ["x"], None, {"k": None, "tau": "min"}, check=False)
    with pytest.raises(UnitError, match="dead time 'L' has the unit 'min', but dead times are in s"):
        made("x' = delay(u, L)", {"u": None}, ["x"], None, {"L": "min"}, check=False)


def test_a_dead_time_of_python_functions_is_in_seconds():
    with pytest.raises(UnitError, match="dead times are in s"):
        Model(
            name="late", states={"x": None}, inputs={"u": None}, outputs={"y": None},
            parameters=(Declared("L", "min", (0.0, 1.0)),),
            delays=(Delay("late", "u", "L"),), derivative=lambda x, u, p: {"x": u["late"]}, output=lambda x, u,
            p: {"y": x["x"]},
        )  # fmt: skip


@pytest.mark.parametrize(("initial", "told"), [("r*t", 'Write unit = "m/s"'), ("x0", 'Write unit = "m"')])
def test_an_initial_value_is_held_against_the_output(initial, told):
    parameters = {"tau": "s", **({"r": "m/min"} if initial == "r*t" else {"x0": "cm"})}
    with pytest.raises(EquationError) as caught:
        made("x' = -x/tau", {}, {"x": {"initial": initial}}, "m", parameters)
    assert told in caught.value.reason
    assert caught.value.text == initial


@pytest.mark.parametrize(
    ("over", "unit", "told"), [("t", "1/min", '"1/s"'), ("x", "1/min", '"1/s"'), ("x", "1/s", None)]
)
def test_the_values_of_a_table_have_a_unit_too(over, unit, told):
    def build():
        return made(
            f"x' = k({over})*(u - x)", {"u": "V"}, ["x"], "V", {"k": {"bounds": (1, 5)}},
            tables={"k": {"over": [over], "nodes": [0, 10], "unit": unit}},
        )  # fmt: skip

    if told is None:
        build()
    else:
        with pytest.raises(EquationError, match=told):
            build()


def test_a_constant_is_written_anew():
    with pytest.raises(EquationError, match='Write T = "300 s"'):
        made("x' = (u - x)/T", {"u": None}, ["x"], None, {}, constants={"T": "5 min"})


@pytest.mark.parametrize(
    ("needed", "like", "text"),
    [("s", "min", "s"), ("1/s", "1/day", "1/s"), ("degC/V/s", "degC/V/min", "degC/V/s"), ("J/K", "Wh/K", "J/K"),
     ("m/s^2", "1", "m/s^2")],
)  # fmt: skip
def test_a_unit_is_spelled_like_the_declared_one(needed, like, text):
    assert spelled(form_of(units.parse(needed)), like) == text


def test_a_unit_of_another_size_than_any_that_is_known_is_not_spelled():
    assert spelled(form_of(units.parse("furlong^2/week")), "m^2") is None


VALVE = """
q = Kv*R^(u - 1)
h' = (q - k*sqrt(max(h, 0)))/A
y = h
"""


@pytest.mark.parametrize("exponent", ["u - 1", "u^2", "0.5*u - 1"])
def test_a_parameter_whose_power_changes_is_a_number(exponent):
    """Its unit was taken as unknown, and so was that of the flow: Kv of 0.25 L/s was given as 2.5e-4 "L/s"."""

    def valve(unit, **more):
        equations(
            VALVE.replace("u - 1", exponent), inputs={"u": "1"}, states={"h": "m"}, outputs={"y": "m"},
            parameters={"Kv": {"unit": unit, "bounds": (0, 1)}, "R": None, "k": "m^2.5/s", "A": "m^2", **more},
        )  # fmt: skip

    valve("m^3/s")
    valve(None)
    valve("L/s", k="L/s/m^0.5", A="L/m")
    with pytest.raises(EquationError) as caught:
        valve("L/s")
    assert "Write unit = \"m^3/s\", bounds = [0, 0.001] for 'Kv'" in caught.value.reason


def test_a_signal_with_a_fitted_power_may_have_a_hidden_unit():
    """c h^n with h in m and n fitted: numbers are meant in metres, and c has a unit that nobody wrote."""
    equations(
        "h' = u - c*h^n; y = h", inputs={"u": "m/s"}, states={"h": None}, outputs={"y": None},
        parameters={"c": None, "n": None},
    )  # fmt: skip
