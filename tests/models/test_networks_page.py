"""docs/networks.md: equations are those that its parts make, each domain against a closed form (tutorial:
tests/cli/test_cli_new.py)."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_networks import evaluated, of_linear

from plantfit.models.networks.network import network
from plantfit.models.networks.parts import PARTS

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "networks.md").read_text("utf-8")
SECTIONS = {s.split("\n")[0]: re.findall(r"```text\n(.*?)```", s, re.DOTALL) for s in PAGE.split("\n## ")[1:]}
DOMAINS = ("Electric", "Mechanical, along a line", "Mechanical, turning", "Thermal", "Hydraulic")


@pytest.mark.parametrize("section", DOMAINS)
def test_equations_are_those_of_the_parts(section):
    parts, equations = SECTIONS[section]
    made = network(parts)
    assert made.equations == equations.strip()
    made.model()


def moved(section, values, inputs, at):
    """Outputs over time under constant inputs, from the starts of the network, by a tight solver."""
    made = network(SECTIONS[section][0])
    values = {**{n: p["value"] for n, p in made.parameters.items() if "value" in p}, **values}
    begin = [
        values.get(e["initial"], 0.0) if isinstance(e["initial"], str) else e["initial"] for e in made.states.values()
    ]

    def both(x):
        return evaluated(made, values, dict(zip(made.states, x, strict=True)), inputs)

    run = solve_ivp(
        lambda t, x: [*both(x)[0].values()], (0, at[-1]), begin, method="LSODA", rtol=1e-10, atol=1e-12, t_eval=at
    )
    return np.array([[*both(x)[1].values()] for x in run.y.T]).T


def test_the_circuit_rings_as_a_second_order_lag():
    r, inductance, c = 20.0, 0.1, 1e-5
    w, sigma = np.sqrt(1 / (inductance * c) - (r / (2 * inductance)) ** 2), r / (2 * inductance)
    t = np.linspace(1e-4, 0.02, 7)
    v, i = moved("Electric", {"R": r, "L": inductance, "C": c}, {"u": 5.0}, t)
    assert v == pytest.approx(5 * (1 - np.exp(-sigma * t) * (np.cos(w * t) + sigma / w * np.sin(w * t))), rel=1e-6)
    assert i == pytest.approx(5 / (inductance * w) * np.exp(-sigma * t) * np.sin(w * t), abs=1e-7)


def test_the_mass_comes_to_rest_where_the_spring_holds_the_force():
    values = {"m": 2.0, "k": 50.0, "b": 8.0}
    (x,) = moved("Mechanical, along a line", values, {"F": 10.0}, np.array([0.5, 20.0]))
    w, sigma = np.sqrt(50 / 2 - 2.0**2), 2.0
    assert x[0] == pytest.approx(0.2 * (1 - np.exp(-1) * (np.cos(w * 0.5) + sigma / w * np.sin(w * 0.5))))
    assert x[1] == pytest.approx(0.2)


def test_the_two_mass_drive_is_that_of_python_control():
    control = pytest.importorskip("control")
    v = {"Rm": 2.0, "Kt": 0.05, "J1": 1e-4, "N": 10.0, "k": 40.0, "d": 0.02, "J2": 0.02}
    s = control.tf("s")
    shaft = v["d"] + v["k"] / s
    load = shaft / (v["J2"] * s + shaft)  # speed of the load over that of the gear's output
    back = v["J2"] * s * load / v["N"] ** 2
    motor = v["Kt"] / v["Rm"] / (v["J1"] * s + v["Kt"] ** 2 / v["Rm"] + back)
    for at in (1j, 3 + 20j, 100j):
        got = of_linear(network(SECTIONS["Mechanical, turning"][0]), v, at)[:, 0]
        assert got == pytest.approx([motor(at), (motor * load / v["N"])(at)], rel=1e-9)


def test_plate_and_sensor_follow_the_matrix_exponential():
    from scipy.linalg import expm

    p = {"C1": 90.0, "R1": 2.5, "C2": 6.0, "R2": 8.0, "T0": 20.0}
    a = np.array(
        [
            [-(1 / p["R1"] + 1 / p["R2"]) / p["C1"], 1 / p["R1"] / p["C1"]],
            [1 / p["R1"] / p["C2"], -1 / p["R1"] / p["C2"]],
        ]
    )
    rest = np.array([1, 1]) * 0.2 * 50 * p["R2"]
    t = np.array([5.0, 60.0, 3e4])
    (got,) = moved("Thermal", p, {"u": 50.0}, t)
    assert got == pytest.approx([20 + (rest - expm(a * s) @ rest)[1] for s in t], rel=1e-7)
    assert got[-1] == pytest.approx(20 + 0.2 * 50 * 8)


def test_a_tank_runs_empty_when_torricelli_says():
    area, opening, g, begin = 0.03, 2e-5, 9.81, 0.5
    made = network("A tank t\na valve t 0\nq inflow t\nmeasure h(t)\nstart h(t) = 0.5 m")
    v = {"A": area, "a": opening}
    whole = area / opening * np.sqrt(2 * begin / g)

    def rate(t, x):
        return [evaluated(made, v, {"h_A": x[0]}, {"q": 0.0})[0]["h_A"]]

    at = np.array([0.5, 0.8]) * whole
    run = solve_ivp(rate, (0, at[-1]), [begin], method="LSODA", rtol=1e-9, atol=1e-10, t_eval=at)
    assert run.y[0] == pytest.approx(begin * (1 - at / whole) ** 2, rel=2e-3)


def test_the_page_names_every_quantity_and_the_listing_every_part():
    line = next(row for row in PAGE.splitlines() if row.startswith("| `measure"))
    assert [
        d.through.letter
        for d in {p.domain.name: p.domain for p in PARTS.values()}.values()
        if d.through.letter not in line
    ] == []
    assert "plantfit new --parts" in PAGE
