"""Temperatures in degC and K, pH and decibels: everywhere converted right or refused in one sentence, never silently
taken."""

import numpy as np
import pytest

import plantfit as pf
import plantfit.recording as rec
from plantfit import units
from plantfit.errors import EquationError, UnitError
from plantfit.problem import Experiment, Problem

T = np.arange(0.0, 50.0, 1.0)


def heated(output="T = x", unit="degC", initial="T", state="K", **more):
    constants = {"zero": "273.15 K", **more.pop("constants", {})}
    return pf.equations(
        f"x' = (Ta - x)/tau\n{output}", inputs={"Ta": state}, states={"x": {"unit": state, "initial": initial}},
        outputs={"T": unit}, parameters={"tau": {"unit": "s", "bounds": (1, 100)}}, constants=constants, **more,
    )  # fmt: skip


def test_a_state_in_kelvin_is_no_output_in_degC():
    with pytest.raises(
        EquationError, match=r"Output 'T' must be in °C, but this is in K; .*write it - zero, with zero = '273.15 K'"
    ):
        heated()
    with pytest.raises(
        EquationError, match=r"initial value of 'x' must be in K, but this is in °C; .*write it \+ zero"
    ):
        heated("T = x - zero")
    assert heated("T = x - zero", initial="T + zero").outputs == {"T": "degC"}
    with pytest.raises(EquationError, match="must be in K"):
        heated("T = x", "K", initial="Tc", constants={"Tc": "20 degC"})


def record(unit, shift):
    truth = 350.0 - 50.0 * np.exp(-T / 20.0)
    return rec.from_arrays(
        T, signals={"Ta": (np.full(len(T), 350.0 - shift), unit), "T": (truth - shift, unit)}, name="run"
    )


@pytest.mark.parametrize(("unit", "shift"), [("K", 0.0), ("degC", 273.15)])
@pytest.mark.parametrize("model", [heated("T = x", "K", "T"), heated("T = x - zero", "degC", "T + zero")])
@pytest.mark.thorough
def test_recordings_are_converted_and_the_truth_comes_back(model, unit, shift):
    assert pf.fit(Problem(model, record(unit, shift))).values["tau"] == pytest.approx(20.0, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("T if T > T2 else T", "joins °C and K"),
        ("min(T, T2)", "joins °C and K"),
        ("T if n > 0 else T2", "joins °C and K"),
        ("n*E/(R*T)", "divides by a temperature in °C"),
        ("n*T2/T", "divides by a temperature in °C"),
        ("s*T^4", "power is of a temperature in °C"),
        ("k(T) + k(T2)", "argument must be in °C"),
        ("a*(T - T2)", "difference of 'T' in °C and 'T2' in K is multiplied"),
        ("(T2 - T)*n", "declare both in one unit"),
        ("n*(-(T - T2) + Rp*a*dT)", "If 'T2' is a difference of temperatures, its unit is delta_degC"),
        ("(T - zero)^2*n", "0 degC is 273.15 K"),
    ],
)
def test_expressions_that_take_degC_for_kelvin_are_refused(text, said):
    with pytest.raises(EquationError, match=said):
        expression(text)


PASS = [
    "T - T2", "T + T2", "T - T", "n*E/(R*(T + zero))", "n*E/(R*T2)", "s*(T + zero)^4", "T2^4*s", "T2 - zero + dT",
    "T + dT", "(T + T)/2",
    "Rp*a*T2 + T", "n*(T - T)/(T - T)", "T^2*n", "a*(T - dT)", "a*(T + zero - T2)", "a*(T2 - zero - T)", "a*(T + T2)",
]  # fmt: skip


@pytest.mark.parametrize("text", PASS)
def test_differences_sums_and_absolute_temperatures_pass(text):
    expression(text)


EXCHANGE = "x' = (Ta - x)/tau; T = x"


@pytest.mark.parametrize(("state", "input", "output"), [("K", "degC", "K"), ("degC", "K", "degC"), (None, "K", "degC")])
def test_a_rate_by_a_difference_of_two_zeros_is_refused(state, input, output):
    with pytest.raises(EquationError, match="is multiplied, is a rate or is a condition"):
        pf.equations(
            EXCHANGE, inputs={"Ta": input}, states={"x": state}, outputs={"T": output}, parameters={"tau": "s"}
        )


def test_an_intermediate_difference_of_two_zeros_is_refused_where_it_is_used():
    text = "gap = Ta - x; x' = G*gap/C; T = x"
    with pytest.raises(EquationError, match="difference of 'Ta' in °C and 'x' in K"):
        pf.equations(
            text, inputs={"Ta": "degC"}, states={"x": "K"}, outputs={"T": "K"}, parameters={"G": "W/K", "C": "J/K"}
        )


@pytest.mark.parametrize(
    ("room", "measured", "refused"),
    [
        ("K", "degC", True), ("degC", "K", True), ("degC", "degC", False), ("K", "K", False), ("C", "K", False),
        (None, "degC", False),
        ("V", "degC", False),
    ],
)  # fmt: skip
def test_recordings_in_two_zeros_are_refused_where_the_model_has_no_units(room, measured, refused):
    model = pf.equations(EXCHANGE, inputs=["Ta"], states=["x"], outputs=["T"], parameters=["tau"])
    t = np.arange(30.0)
    recording = pf.Recording(
        t, {"Ta": pf.Signal(20.0 + np.sin(t), room), "T": pf.Signal(300.0 + 0.0 * t, measured)}, "r"
    )
    if refused:
        with pytest.raises(
            EquationError, match=r'declare both in one unit, as in (Ta|x) = "K", to which recordings are converted'
        ):
            Problem(model, recording, {"tau": (1.0, 10.0)})
    else:
        Problem(model, recording, {"tau": (1.0, 10.0)})


def expression(text):
    """An intermediate value of any unit, reading only the names in the text."""
    words = set("".join(c if c.isalnum() else " " for c in text).split())
    named = {
        "T": "degC",
        "T2": "K",
        "dT": "delta_degC",
        "n": "",
        "E": "J/mol",
        "R": "J/mol/K",
        "s": "1/K^4",
        "a": "W/K",
        "Rp": "K/W",
    }
    return pf.equations(
        f"i = {text}\ny = 1 if i > i else 0", inputs={n: u for n, u in named.items() if n in words}, outputs={"y": ""},
        constants={"zero": "273.15 K"}, tables={"k": {"over": ["T"], "nodes": [[0, 10]],
                                                      "unit": "K"}} if "k" in words else None,
    )  # fmt: skip


def test_a_difference_and_a_temperature_do_not_convert_and_their_errors_do():
    for a, b in (("delta_degC", "degC"), ("degC", "delta_degC")):
        with pytest.raises(UnitError, match="differences of temperatures; they cannot be converted"):
            units.factor_offset(a, b)
    assert units.factor("degC", "K") == 1.0
    assert units.factor("degF", "delta_degC") == pytest.approx(5 / 9)
    assert units.factor_offset("degC", "K") == (1.0, 273.15)
    assert units.factor_offset("delta_degC", "K") == (1.0, 0.0)


def test_pH_is_no_picohenry_and_logarithmic_units_are_refused():
    assert not units.compatible("pH", "H")
    assert not units.compatible("pH", "")
    for unit in ("dB", "dBm", "decade", "octave", "Np"):
        with pytest.raises(UnitError, match="logarithmic"):
            units.parse(unit)
    with pytest.raises(UnitError, match="logarithmic"):
        pf.equations("y = u", inputs={"u": "dB"}, outputs={"y": "dB"})


def test_a_column_in_decibels_is_refused_where_the_model_has_another_unit(tmp_path):
    (tmp_path / "r.csv").write_text("t [s],L [dB],u\n0,1,1\n1,2,2\n2,3,3\n")
    r = rec.read_csv(tmp_path / "r.csv", signals={"L": "L [dB]", "u": "u"})
    parameters = {"g": {"bounds": (0, 2)}}
    for unit in ("V", ""):
        model = pf.equations("L = g*u", inputs={"u": None}, outputs={"L": unit}, parameters=parameters)
        with pytest.raises(UnitError, match=f"'L' is in 'dB', which is logarithmic, and the model's is in {unit!r}"):
            Problem(model, r)
    assert pf.fit(Problem(pf.equations("L = g*u", inputs=["u"], outputs=["L"], parameters=parameters), r)).values[
        "g"
    ] == pytest.approx(1.0)


def test_before_in_another_zero_needs_its_unit():
    model = pf.equations(
        "T = delay(Ta, L)",
        inputs={"Ta": "K"},
        outputs={"T": "K"},
        parameters={"L": {"unit": "s", "bounds": (0, 40), "value": 20.0}},
    )

    def early(before):
        return Problem(model, Experiment(record("degC", 273.15), before=before), {"L": (1, 40)}).predict(
            np.array([20.0])
        )["T"][0]

    with pytest.raises(UnitError, match=r"in 'degC' but the model in 'K'.*before = \{ Ta = \"20 degC\" \}"):
        early({"Ta": 20.0})
    assert early({"Ta": "20 degC"}) == pytest.approx(293.15)
    assert early({"Ta": "300 K"}) == pytest.approx(300.0)
    with pytest.raises(UnitError, match="cannot be converted to the model's 'K'"):
        early({"Ta": "3 bar"})
    with pytest.raises(UnitError, match="not a number with a unit"):
        early({"Ta": "warm"})


def test_what_cleaning_makes_a_difference_is_not_shifted_again():
    r = record("degC", 273.15)
    assert rec.convert_units(rec.detrend(r, "T"), {"T": "K"})["T"].mean() == pytest.approx(0.0, abs=1e-9)
    assert rec.convert_units(rec.subtract(r, "T", "Ta"), {"T": "K"})["T"][0] == pytest.approx(-50.0)
    assert rec.convert_units(rec.subtract(r, "T", 0.5), {"T": "K"})["T"][0] == pytest.approx(299.5)
    deviations = pf.equations(
        "T = g*Ta", inputs={"Ta": "degC"}, outputs={"T": "degC"}, parameters={"g": {"unit": "", "bounds": (0, 2)}}
    )
    r = rec.subtract(rec.detrend(r, "T"), "Ta", "Ta")
    assert Problem(deviations, r).experiments["run"].recording["T"].mean() == pytest.approx(0.0, abs=1e-9)


def test_bounds_of_a_parameter_in_another_unit_are_converted_as_temperatures_or_differences():
    model = pf.equations(
        "T = n*0 + Ta",
        inputs={"n": ""},
        outputs={"T": "K"},
        parameters={"Ta": {"unit": "K", "bounds": (200, 400)}},
        check=False,
    )
    r = rec.from_arrays(T, signals={"n": T, "T": (T, "K")})
    problem = Problem(model, r, {"Ta": pf.Parameter((10.0, 30.0), "degC")})
    np.testing.assert_allclose([problem.space.lower[0], problem.space.upper[0]], [283.15, 303.15])
    problem = Problem(model, r, {"Ta": pf.Parameter((10.0, 30.0), "delta_degC")})
    np.testing.assert_allclose([problem.space.lower[0], problem.space.upper[0]], [10.0, 30.0])


HEATED = {"states": {"x": {"unit": "K", "initial": "T0"}}, "parameters": {"tau": {"unit": "s", "bounds": (1, 100)}}}


def plant(text, output="K", **inputs):
    """A state x in K, with the inputs that the text reads."""
    own = {"Ts": "degC", "q": "W", "dT": "delta_degC"} | inputs
    read = set("".join(c if c.isalnum() else " " for c in text).split())
    constants = {"T0": "300 K", "zero": "273.15 K", "g": "2", "R": "1 K/W"}
    return pf.equations(
        text, inputs={n: u for n, u in own.items() if n in read}, outputs={"T": output}, constants=constants, **HEATED
    )


@pytest.mark.parametrize(
    ("formula", "unit", "said"),
    [
        ("g*x", "degC", r"write \(x - zero\) for 'x'"), ("x/g", "degC", r"write \(x - zero\) for 'x'"),
        ("g*Ts", "K", r"write \(Ts \+ zero\) for 'Ts'"), ("-2*Ts", "K", r"write \(Ts \+ zero\)"),
        ("(Ts + Ts)/2", "K", r"write \(Ts \+ zero\)"), ("0.5*Ts + 0.5*Ts", "K", r"write \(Ts \+ zero\)"),
        ("g*Ts + R*q", "K", r"write \(Ts \+ zero\)"), ("Ts - x", "K", "has the difference of 'Ts' in °C and 'x' in K"),
        ("x - Ts", "degC", "has the difference of"), ("x - Ts", "delta_degC", "has the difference of"),
    ],
)  # fmt: skip
def test_outputs_are_no_multiples_of_temperatures_from_another_zero(formula, unit, said):
    with pytest.raises(EquationError, match=said):
        plant(f"x' = (T0 - x)/tau\nT = {formula}", unit)


@pytest.mark.parametrize(
    ("formula", "unit"),
    [
        ("g*x", "K"), ("g*(x - zero)", "degC"), ("g*Ts", "degC"), ("g*Ts + zero", "K"), ("g*(Ts + zero)", "K"),
        ("Ts + R*q", "degC"),
        ("Ts - dT", "degC"), ("g*dT", "K"), ("g*dT", "degC"), ("x + g*dT", "K"), ("x - zero + g*dT", "degC"),
        ("g*(Ts - Ts)", "K"),
        ("(Ts + Ts)/2", "degC"), ("Ts - Ts", "delta_degC"), ("x - T0", "K"), ("R*q", "K"), ("R*q", "degC"),
    ],
)  # fmt: skip
def test_outputs_that_count_from_one_zero_pass(formula, unit):
    plant(f"x' = (T0 - x)/tau\nT = {formula}", unit)


@pytest.mark.parametrize(
    "rate", ["(g*Ts - x)/tau", "(0.5*Ts + 0.5*T0 - x)/tau", "(Ts/2 - x + T0/2)/tau", "-(x - g*Ts)/tau"]
)
def test_a_multiple_of_another_zero_is_told_in_rates(rate):
    with pytest.raises(EquationError, match="difference of 'Ts' in °C and 'x' in K"):
        plant(f"x' = {rate}\nT = x")
    plant(f"x' = {rate.replace('Ts', '(Ts + zero)')}\nT = x")


@pytest.mark.parametrize("event", ["rising(x - Ts): x = T0", "falling(g*Ts - x): x = T0", "rising(x - T0): x = g*Ts"])
def test_events_do_not_compare_two_zeros(event):
    with pytest.raises(EquationError, match=r"0 degC is 273\.15 K"):
        plant(f"x' = (T0 - x)/tau\nwhen {event}\nT = x")
    plant(f"x' = (T0 - x)/tau\nwhen {event.replace('Ts', '(Ts + zero)')}\nT = x")


def test_an_initial_value_is_no_multiple_of_another_zero():
    def begun(initial):
        states = {"x": {"unit": "K", "initial": initial}}
        return pf.equations(
            "x' = -(x - zero)/tau\nT = x - zero", states=states, outputs={"T": "degC"},
            constants={"zero": "273.15 K", "g": "2"},
            parameters={"tau": {"unit": "s", "bounds": (1, 100)}},
        )  # fmt: skip

    with pytest.raises(EquationError, match=r"initial value of 'x' is in K, .*write \(T \+ zero\) for 'T'"):
        begun("g*T")
    begun("g*(T + zero)")
    begun("g*T + zero")


@pytest.mark.parametrize(
    "text",
    ["barg", "bar_g", "bar(g)", "bar (g)", "barG", "mbarg", "kPa_g", "kPag", "kPa(g)", "psig", "bar rel", "barü"],
)
def test_a_pressure_above_that_of_the_surroundings_is_no_pressure(text):
    plain = units.gauge(text)
    assert plain is not None
    with pytest.raises(UnitError, match=f"counts from the pressure of the surroundings; write '{plain}'"):
        units.parse(text)
    assert units.dimension(f"{text}/s") == units.dimension("bar/s")  # a difference
    with pytest.raises(UnitError, match="surroundings"):
        pf.equations("y = u", inputs={"u": text}, outputs={"y": text})


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("bara", "bar"), ("bar(a)", "bar"), ("bar abs", "bar"), ("psia", "psi"), ("kPa(abs)", "kPa"),
        ("mbar_a", "mbar"), ("bar", "bar"),
        ("barad", "barad"), ("g", "g"), ("Pa", "Pa"), ("bag", "bag"), ("mg", "mg"), ("Pa*g", "Pa*g"),
    ],
)  # fmt: skip
def test_absolute_pressures_and_other_units_keep_their_meaning(text, plain):
    assert units.gauge(text) is None
    assert units.equal(text, plain)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("Celsius", "degC"), ("celsius", "degC"), ("centigrade", "degC"), ("° Celsius", "degC"),
        ("deg Celsius", "degC"), ("Deg C", "degC"),
        ("degc", "degC"), ("degrees C", "degC"), ("degree_Celsius", "degC"), ("Fahrenheit", "degF"), ("deg F", "degF"),
        ("degf", "degF"),
        ("Kelvin", "K"), ("kelvin", "K"), ("delta_degC", "delta_degC"), ("W/Kelvin", "W/K"), ("%/degc", "%/degC"),
        ("deg/s", "deg/s"),
        ("F", "F"), ("C", "C"), ("deg", "deg"),
    ],
)  # fmt: skip
def test_temperatures_are_spelled_as_people_write_them(text, unit):
    assert str(units.parse(text)) == str(units.parse(unit))


def of_file(tmp_path, header, **options):
    (tmp_path / "r.csv").write_text(f"t [s],{header},u\n" + "\n".join(f"{i},{300 + i},{i % 3}" for i in range(9)))
    model = pf.equations(
        "y = g*u", inputs={"u": None}, outputs={"y": options.pop("model")}, parameters={"g": {"bounds": (0, 300)}}
    )
    recording = rec.read_csv(tmp_path / "r.csv", signals={"y": header, "u": "u"}, **options)
    (experiment,) = Problem(model, recording).experiments.values()
    return experiment.recording["y"][0]


@pytest.mark.parametrize(
    ("header", "options", "said"),
    [
        ("p [barg]", {"model": "bar"}, r'write units = \{ y = "bar" \}, .* amount = -1.01325'),
        ("p [psig]", {"model": "kPa"}, r'units = \{ y = "psi" \}, .* amount = -14.6959'),
        ("p [barg]", {"model": "bar", "units": {"y": "psi"}}, "surroundings"),
        ("T [C]", {"model": "degC"}, r'write degC in the header, or units = \{ y = "degC" \}'),
        ("T [F]", {"model": "K"}, r'units = \{ y = "degF" \}'),
        ("T [C]", {"model": "V"}, "correct one of them"),
        ("T [F]", {"model": "K", "units": {"y": "degC"}}, "says 'F', but units says 'degC'"),
        ("L [dB]", {"model": "V", "units": {"y": "V"}}, "is in 'dB', which is logarithmic, but units says 'V'"),
    ],
)  # fmt: skip
def test_columns_of_another_zero_are_refused_with_the_line_to_write(tmp_path, header, options, said):
    with pytest.raises(UnitError, match=said):
        of_file(tmp_path, header, **options)


@pytest.mark.parametrize(
    ("header", "options", "first"),
    [
        ("p [barg]", {"model": "bar", "units": {"y": "bar"}}, 300.0), ("p [barg]", {"model": None}, 300.0),
        ("p [bar abs]", {"model": "kPa"}, 30000.0), ("T [C]", {"model": "K", "units": {"y": "degC"}}, 573.15),
        ("T [Celsius]", {"model": "K"}, 573.15), ("T [Kelvin]", {"model": "degC"}, 26.85),
        ("T [Fahrenheit]", {"model": "degC"}, 148.8888889),
    ],
)  # fmt: skip
def test_columns_whose_zero_is_known_are_converted(tmp_path, header, options, first):
    assert of_file(tmp_path, header, **options) == pytest.approx(first)


def test_a_factor_makes_no_other_zero_and_squares_of_degrees_mean_nothing():
    r = record("degC", 273.15)
    with pytest.raises(UnitError, match=r'write \{ step = "convert_units", units = \{ T = "degF" \} \}'):
        rec.scale(r, "T", 1.8, "degF")
    assert rec.scale(r, "T", 1.02)["T"][0] == pytest.approx(1.02 * r["T"][0])
    assert rec.scale(rec.from_arrays(T, signals={"n": (T, "counts")}), "n", 0.1, "degC").signals["n"].unit == "degC"
    with pytest.raises(UnitError, match="whose zero is not nothing, so that its mean square means nothing"):
        rec.moving_rms(r, "T", "q", 4.0)
    assert rec.moving_rms(rec.detrend(r, "T"), "T", "q", 4.0).signals["q"].unit == units.difference_of("degC")
    assert rec.moving_rms(record("K", 0.0), "T", "q", 4.0).signals["q"].unit == "K"


def test_a_start_with_a_unit_is_named_first():
    with pytest.raises(
        EquationError, match=r'name it, as in constants = \{ x_0 = "20 degC" \}, and write initial = "x_0"'
    ):
        heated("T = x", "K", initial="20 degC")
    with pytest.raises(EquationError, match="An operator is missing"):
        heated("T = x", "K", initial="20 warm")
    heated("T = x", "K", initial="x_0", constants={"x_0": "293 K"})
