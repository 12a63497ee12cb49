"""Columns without a unit whose names end in one that is not the model's."""

import numpy as np
import pytest

from plantfit.errors import UnitError
from plantfit.spec import parse

T = np.arange(100) * 0.01
VALUES = np.where(np.arange(100) // 20 % 2 == 0, 1.0, 2.0)


def _study(folder, header, need, recording="", signal="w"):
    np.savetxt(
        folder / "r.csv", np.column_stack([T, VALUES, T]), delimiter=",", header=f"t [s],{header},y", comments=""
    )
    unit = f'{{ {signal} = "{need}" }}' if need else f'["{signal}"]'
    text = f"""name = "x"
[recording.a]
file = "r.csv"
signals = {{ {signal} = "{header}", y = "y" }}
{recording}
[model]
equations = "x' = (K*{signal} - x)/tau; y = x"
inputs = {unit}
states = ["x"]
outputs = ["y"]
check_units = false
[parameters]
K = {{ bounds = [0.1, 30] }}
tau = {{ bounds = [0.05, 2] }}
"""
    return parse(text, folder / "x.toml").problem.experiments["a"].recording[signal]


@pytest.mark.parametrize(
    ("header", "need", "told"),
    [
        ("f_Hz", "rad/s", 'Write units = { w = "turn/s" } if a cycle is one turn, or units = { w = "rad/s" } if'),
        ("f_kHz", "rad/s", 'Write units = { w = "kiloturn/s" } if a cycle is one turn'),
        ("u_mV", "V", 'Write units = { w = "mV" }, or units = { w = "V" } if its numbers are in V.'),
        ("T_degC", "K", 'Write units = { w = "degC" }, or'),
        ("duty_pct", "1", 'Write units = { w = "%" }, or'),
        ("u_dB", "V", "ends in 'dB'.*Levels are not converted"),
        ("u_dB", "1", "ends in 'dB'.*declare 'w' without a unit to compute with levels"),
        ("p_dBm", "W", "ends in 'dBm'"),
    ],
)
def test_another_unit_than_the_models_is_refused_with_the_line_to_write(tmp_path, header, need, told):
    with pytest.raises(UnitError, match=told.replace("{", r"\{").replace("}", r"\}")):
        _study(tmp_path, header, need)


@pytest.mark.parametrize(
    ("line", "factor", "zero"),
    [('"turn/s"', 2 * np.pi, 0.0), ('"rad/s"', 1.0, 0.0), ('"rpm"', 2 * np.pi / 60, 0.0)],
)
def test_the_line_decides_and_a_cycle_is_two_pi(tmp_path, line, factor, zero):
    got = _study(tmp_path, "f_Hz", "rad/s", f"units = {{ w = {line} }}")
    np.testing.assert_allclose(got, factor * VALUES + zero)


@pytest.mark.parametrize(
    ("header", "need", "recording"),
    [
        ("u_V", "V", ""),
        ("f_Hz", "1/s", ""),
        ("f_Hz", None, ""),
        ("u_dB", None, ""),
        ("T_degC", "delta_degC", ""),
        ("q_kg", "V", ""),  # of another kind: the name is about something else
        ("feedB", "V", ""),
        ("f_Hz", "rad/s", 'clean = [{ step = "scale", signal = "w", factor = 1.0 }]'),
    ],
)
def test_what_fits_is_treated_or_has_no_unit_is_taken_as_it_is(tmp_path, header, need, recording):
    np.testing.assert_array_equal(_study(tmp_path, header, need, recording), VALUES)
