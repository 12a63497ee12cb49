"""Units through expressions: what fits, what does not, and where the error points."""

import pytest

from plantfit.errors import EquationError
from plantfit.models import equations

UNITS = {"a": "m", "b": "m", "c": "cm", "s": "s", "angle": "rad", "turned": "deg", "share": "%", "n": "", "w": "rad/s",
         "rpm": "rpm",
         "T": "degC", "T2": "K", "f": "Hz", "v": "m/s", "unknown": None}  # fmt: skip


def build(text, unit, **options):
    """A static model y = text with y in `unit`, reading only the names in the text."""
    names = [n for n in UNITS if n in set("".join(c if c.isalnum() else " " for c in text).split())]
    constants = {"one_m": "1 m", "two": "2 1", "half": 0.5}
    return equations(
        f"y = {text}", inputs={n: UNITS[n] for n in names}, outputs={"y": unit}, constants=constants, **options
    )


FITS = [
    ("a + b - 2*a", "m"), ("a*b", "m^2"), ("a/s", "m/s"), ("a/s^2", "V*A*s/(kg*m)"), ("a^2 + b*b", "m^2"),
    ("sqrt(a*b)", "m"),
    ("(a^2*b^2)^half", "m^2"), ("a^two", "m^2"), ("sin(angle)", "1"), ("exp(share)", ""), ("sin(w*t)", ""),
    ("exp(-t/s)", ""), ("a + one_m", "m"), ("a + 0", "m"), ("max(a, 0)", "m"), ("0", "m"), ("a if a > 0 else -b", "m"),
    ("where(a > b, 0, a)", "m"), ("sign(a)*b", "m"), ("smooth_sign(a, one_m)", ""), ("atan2(a, b)", "rad"),
    ("clip(a, -b, one_m)", "m"),
    ("step(a - b)", ""), ("n + 1", ""), ("angle + 1", "rad"), ("T - T2", "degC"), ("T + T2", "degC"),
    ("unknown + a", "m"),
    ("unknown*a + s", "s"),
    ("sin(unknown)", ""), ("unknown^a^0", "m"), ("delay(a, 3)", "m"), ("1 if a > 0 and n or not s else 2", ""),
    ("abs(a) + floor(b) + relu(a) + deadzone(a, -b, b)", "m"), ("f*s", "1"), ("n^n", ""), ("a^(1/3)*a^(2/3)", "m"),
    ("half*a", "V"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "unit"), FITS)
def test_fitting_units_pass(text, unit):
    assert build(text, unit).outputs == {"y": unit}


MISFITS = [
    # text after "y = ", unit of y, column, parts of the message
    ("a + s", "m", 6, ("'+' joins m and s", "different kinds")),
    ("unknown + a + s", "V", 14, ("correct the unit of 'a' (m)",)),
    ("b*(a - c)", "m^2", 9, ("'-' joins m and cm", "1 cm is 0.01 m")),
    ("angle + turned", "rad", 10, ("joins rad and deg", "0.0174533")),
    ("w - rpm", "rad/s", 6, ("rpm", "0.10472")),
    ("f + w", "Hz", 6, ("turn/s",)),
    ("a > s", "", 6, ("'>'",)),
    ("min(a, b, s)", "m", 4, ("'min'",)),
    ("a if n else s", "m", 6, ("'if-else'",)),
    ("a + 1", "m", 8, ("The number 1 has no unit", "in constants, as in offset = '1 m'")),
    ("2.5 - a", "m", 4, ("The number 2.5",)),
    ("1 - share", "%", 4, ("'1 %'",)),
    ("1 - a/c", "", 4, ("1 m/cm is 100", "Declare what is divided there in one unit")),
    ("sin(turned)", "", 8, ("an angle in rad", "deg")),
    ("exp(2*a)", "", 8, ("without unit", "in m")),
    ("log(a/c)", "", 8, ("without unit",)),
    ("2^a", "", 6, ("An exponent", "in m")),
    ("a^n", "m", 5, ("not a fixed number",)),
    ("a*b", "m", 4, ("Output 'y' must be in m", "in m²")),
    ("c", "m", 4, ("1 cm is 0.01 m",)),
    ("3", "V", 4, ("Output 'y' must be in V", "no unit")),
    ("delay(a, s)", "m", 13, ("second",)),
    ("smooth_sign(v, 0.01)", "", 19, ("The number 0.01",)),
]


@pytest.mark.parametrize(("text", "unit", "column", "parts"), MISFITS)
def test_misfit_is_shown_where_it_is(text, unit, column, parts):
    with pytest.raises(EquationError) as caught:
        build(text, unit)
    assert (caught.value.line, caught.value.column) == (0, column)
    for part in parts:
        assert part in caught.value.reason


@pytest.mark.parametrize(("text", "unit"), [(m[0], m[1]) for m in MISFITS if "delay" not in m[0]])
def test_check_can_be_switched_off(text, unit):
    assert build(text, unit, check=False).text == f"y = {text}"


def motor(**changes):
    units = {"k": "rad/s^2/V", "d": "1/s", "Td": "s", "w0": "rad/s"}
    return equations(
        "drag = d*w\nw' = k*delay(V, Td) - drag\nq' = w\nw_rpm = factor*w",
        inputs={"V": changes.get("V", "V")},
        states={
            "w": {"unit": changes.get("w", "rad/s"), "initial": "w0"},
            "q": {"unit": changes.get("q", "rad"), "initial": 3},
        },
        outputs={"w_rpm": "rpm", "q": changes.get("q_out", "rad")},
        parameters={n: changes.get(n, u) for n, u in units.items()},
        constants={"factor": "9.549296585513721 rpm*s/rad"},
    )


def test_consistent_dynamic_model_passes():
    assert set(motor().states) == {"w", "q"}


@pytest.mark.parametrize(
    ("changes", "line", "column", "part"),
    [
        ({"q": "deg", "q_out": "deg"}, 2, 5, "The derivative of 'q' must be in deg/s"),
        ({"d": "1/min"}, 1, 20, "'-' joins"),
        ({"Td": "ms"}, 1, 16, "A delay must be in s"),
        ({"V": "mV"}, 1, 20, "'-' joins"),
        ({"w0": "rpm"}, 0, 0, "The initial value of 'w' must be in rad/s"),
        ({"q_out": "deg"}, 0, 0, "Output 'q' must be in deg"),
        ({"w": "rpm", "w0": "rpm"}, 3, 8, "Output 'w_rpm' must be in rpm, but this is in rpm²·s/rad"),
    ],
)
def test_misfits_of_a_dynamic_model(changes, line, column, part):
    with pytest.raises(EquationError) as caught:
        motor(**changes)
    assert part in caught.value.reason
    assert (caught.value.line, caught.value.column) == (line, column)
