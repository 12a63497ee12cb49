"""A frequency in Hz where an angular frequency is meant."""

import pytest

from plantfit import Parameter, Problem, from_arrays
from plantfit.errors import EquationError
from plantfit.models import equations

SWINGS = "x' = v; v' = {}"


def swinging(force, unit="Hz", **constants):
    """x in m and its velocity, with a parameter f in `unit`."""
    return equations(
        SWINGS.format(force), states={"x": "m", "v": "m/s"}, outputs={"x": "m"}, constants=constants,
        inputs={"a": "m/s^2"} if "a*" in force else {}, parameters={"f": unit},
    )  # fmt: skip


@pytest.mark.parametrize(
    "force",
    ["a*sin(f*t)", "a*cos(t*f + 0.3)", "a*sin(2*f*t)", "a*tan(-f*t)", "a*sin(f*(t - delay_)) ", "a*sin(g)"],
)
def test_cycles_where_an_angle_is_meant_are_refused(force):
    text = force + "\ng = f*t" if "g)" in force else force
    constants = {"delay_": "0.2 s"} if "delay_" in force else {}
    with pytest.raises(EquationError, match=r"Write 2\*pi\*f for 'f' here, or declare 'f' in rad/s"):
        swinging(text, **constants)


@pytest.mark.parametrize(
    "force",
    [
        "a*sin(2*pi*f*t)", "a*sin(6.28*f*t)", "a*cos(f*t*2*pi + 0.3)", "a*sin(turn*f*t)", "a*sin(g)\ng = 2*pi*f*t",
        "a*sin(w*t)\nw = 2*pi*f", "a*exp(-f*t)", "a*sin(one*f*t)", "a*sin(t*f/free)", "a*(f/rate)",
    ],
)  # fmt: skip
def test_angular_frequencies_and_rates_are_not(force):
    given = {"turn": 6.283185307, "one": "1 rad", "free": 3.0, "rate": "2 1/s"}
    swinging(force, **{n: v for n, v in given.items() if n in force})


@pytest.mark.parametrize("number", ["1e308", "1e17", "5", "2"])
def test_numbers_that_are_no_multiple_of_pi_turn_nothing(number):
    with pytest.raises(EquationError, match="counts cycles"):
        swinging(f"a*sin({number}*f*t)")


@pytest.mark.parametrize("unit", ["1/s", "rad/s", None])
def test_other_units_are_not_taken_for_cycles(unit):
    swinging("a*sin(f*t)", unit)


@pytest.mark.parametrize("unit", ["rpm", "1/min", "turn/s"])
def test_units_of_turns_do_not_pass_for_angles(unit):
    with pytest.raises(EquationError, match="takes an angle in rad"):
        swinging("a*sin(f*t)", unit)


def test_the_square_of_a_frequency_in_hz_is_no_stiffness():
    with pytest.raises(EquationError, match=r"Write \(2\*pi\*f\)\^2, or declare 'f' in rad/s"):
        swinging("-f^2*x - 0*v")
    for right in ("-(2*pi*f)^2*x", "-4*pi^2*f^2*x", "-f*f*x*cubed/cubed_of"):
        swinging(right, **({"cubed": "1 s", "cubed_of": "1 s"} if "cubed" in right else {}))
    swinging("-f^2*x", "rad/s")
    # eddy currents: a loss that grows with the square of a frequency
    equations("T' = k*f^2/C", inputs={"f": "Hz"}, states={"T": "K"}, outputs={"T": "K"},
              parameters={"k": "W*s^2", "C": "J/K"})  # fmt: skip
    equations("T' = k*f^2/C", inputs={"f": "Hz"}, states={"T": "K"}, outputs={"T": "K"},
              parameters={"k": "W/Hz^2", "C": "J/K"})  # fmt: skip


def test_two_pi_makes_a_frequency_fit_beside_rad_per_s_and_back():
    def follower(right, unit):
        return equations(f"w' = ({right} - w)/tau", inputs={"f": "Hz"}, states={"w": unit}, outputs={"w": unit},
                         parameters={"tau": "s"})  # fmt: skip

    follower("2*pi*f", "rad/s")
    with pytest.raises(EquationError, match=r"or multiply it by 2\*pi"):
        follower("f", "rad/s")
    equations("f = w/(2*pi)", inputs={"w": "rad/s"}, outputs={"f": "Hz"})
    with pytest.raises(EquationError, match="Hz"):
        equations("f = w", inputs={"w": "rad/s"}, outputs={"f": "Hz"})


def test_units_that_the_problem_gives_are_looked_at_too():
    model = equations("y = A*sin(f*t)", outputs={"y": "V"}, parameters={"A": "V", "f": None})
    recording = from_arrays(period=0.1, signals={"y": ([0.0, 0.1, 0.2, 0.1], "V")})
    Problem(model, recording, {"A": (0.1, 2.0), "f": Parameter((0.1, 2.0), unit="rad/s")})
    with pytest.raises(EquationError, match=r"Write 2\*pi\*f"):
        Problem(model, recording, {"A": (0.1, 2.0), "f": Parameter((0.1, 2.0), unit="Hz")})
