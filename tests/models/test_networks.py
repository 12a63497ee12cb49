"""Networks of parts: their equations against closed forms, an independent descriptor system and python-control, and
mistakes."""

import re

import numpy as np
import pytest
from network_descriptor import KINDS, pencil, response

from plantfit.errors import EquationError
from plantfit.models.networks.loops import solved
from plantfit.models.networks.network import network
from plantfit.models.networks.parts import PARTS
from plantfit.models.networks.polynomials import Polynomial, gcd

FUNCTIONS = {
    "sqrt": np.sqrt,
    "smooth_abs": lambda x, w: np.sqrt(x * x + w * w),
    "coulomb": lambda v, f, w: f * np.tanh(v / w),
}


def evaluated(made, values, state, inputs):
    """Rates and outputs of a network at numbers, by Python and not by plantfit."""
    constants = {n: float(c.split()[0]) for n, c in made.constants.items()}
    names = {**FUNCTIONS, **constants, **values, **state, **inputs}
    lines = [line.split(" = ") for line in made.equations.replace("^", "**").splitlines()]
    waiting = {left: right for left, right in lines}
    found = {}
    while waiting:
        ready = {
            left: right for left, right in waiting.items() if not set(re.findall(r"[A-Za-z_]\w*", right)) - set(names)
        }
        assert ready, waiting
        for left, right in ready.items():
            found[left] = eval(right, {"__builtins__": {}}, names)
            names.setdefault(left, found[left])
            del waiting[left]
    return {s: found[f"{s}'"] for s in made.states}, {y: names[y] for y in made.outputs}


def linear(made, values):
    """Matrices A, B, C, D of linear equations, by unit vectors."""
    x, u, y = list(made.states), list(made.inputs), list(made.outputs)
    columns = []
    for moved in [*x, *u]:
        rates, outputs = evaluated(made, values, {s: float(s == moved) for s in x}, {s: float(s == moved) for s in u})
        columns.append([*rates.values(), *outputs.values()])
    m = np.array(columns).T.reshape(len(x) + len(y), len(x) + len(u))
    n = len(x)
    return m[:n, :n], m[:n, n:], m[n:, :n], m[n:, n:]


def of_linear(made, values, s):
    a, b, c, d = linear(made, values)
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


def random_network(rng):
    count = rng.integers(3, 6)
    nodes = ["0", *(f"n{k}" for k in range(count - 1))]
    parts = [("u", "source", "n0", "0")] if rng.random() < 0.7 else [("j", "current_source", "0", "n0")]
    for k in range(rng.integers(3, 9)):
        a, b = rng.choice(count, 2, replace=False)
        parts.append((f"P{k}", str(rng.choice(["resistor", "resistor", "capacitor", "inductor"])), nodes[a], nodes[b]))
    return parts


def written(parts, measured):
    return "\n".join([*(" ".join(p) for p in parts), f"measure v({measured})"])


def ill(parts, values):
    """Whether the descriptor system has no solution, or fewer dynamic states than stores: one is then bound to
    others or to sources."""
    e, a, *_ = pencil(parts, values)
    (sign, low), (_, high) = (np.linalg.slogdet(s * e - a) for s in (1e4, 1e5))
    if sign == 0 or low < -60:
        return True
    return round((high - low) / np.log(10)) < sum(kind in ("capacitor", "inductor") for _, kind, _, _ in parts)


@pytest.mark.thorough
def test_random_networks_answer_as_their_descriptor_system_does_and_no_good_one_is_refused():
    rng = np.random.default_rng(5)
    compared, refused = 0, 0
    for _ in range(400):
        parts = random_network(rng)
        used = sorted({n for _, _, a, b in parts for n in (a, b)} - {"0"})
        node = used[-1]
        values = {name: float(rng.uniform(0.5, 2.0)) for name, *_ in parts}
        made = made_or_told(written(parts, node))
        if isinstance(made, str):
            if "hangs" not in made and "moves nothing" not in made:
                assert ill(parts, values), (parts, made)
                refused += 1
            continue
        assert not ill(parts, values), parts
        for s in (0.3 + 1j, 2.0 - 0.4j):
            own = of_linear(made, values, s)[0, 0]
            assert own == pytest.approx(response(parts, values, node, parts[0][0], s), rel=1e-8, abs=1e-10), parts
        compared += 1
    assert compared > 60
    assert refused > 60


def made_or_told(text):
    try:
        return network(text)
    except EquationError as error:
        return str(error)


RLC = "u source a 0\nR resistor a b\nL inductor b c\nC capacitor c 0\nmeasure v(c), i(L)"


def test_an_rlc_circuit_has_its_closed_form():
    r, inductance, c, s = 3.0, 0.2, 0.05, 0.7 + 5j
    got = of_linear(network(RLC), {"R": r, "L": inductance, "C": c}, s)
    below = inductance * c * s**2 + r * c * s + 1
    assert got[:, 0] == pytest.approx([1 / below, c * s / below])


def test_a_two_mass_drive_has_its_closed_form_and_the_poles_of_python_control():
    made = network("M torque m\nJ1 inertia m\nk torsion_spring m l\nd rotary_damper m l\nJ2 inertia l\nmeasure w(m)")
    v = {"J1": 0.4, "J2": 0.9, "k": 30.0, "d": 0.2}
    s = 0.5 + 8j
    coupling = v["d"] + v["k"] / s
    exact = (v["J2"] * s + coupling) / ((v["J1"] * s + coupling) * (v["J2"] * s + coupling) - coupling**2)
    assert of_linear(made, v, s)[0, 0] == pytest.approx(exact)
    control = pytest.importorskip("control")
    plant = control.ss(*linear(made, v))
    j = v["J1"] * v["J2"] / (v["J1"] + v["J2"])
    poles = np.sort_complex(np.roots([1, v["d"] / j, v["k"] / j]))
    assert np.sort_complex(control.poles(plant))[:2] == pytest.approx(poles[:2], rel=1e-9)


def test_a_gear_turns_inertias_by_its_square_and_a_motor_gives_the_power_that_it_takes():
    text = (
        "V source a 0\nR resistor a b\nK motor b 0 s\nG gear s l\nJ inertia l\nB rotary_damper l 0\nmeasure w(l), "
        "i(K), M(G), v(K)"
    )
    v = {"R": 2.0, "K": 0.1, "G": 5.0, "J": 0.3, "B": 0.05}
    got = of_linear(network(text), v, s := 1.0 + 2j)[:, 0]
    k = v["K"] * v["G"]
    assert got[0] == pytest.approx(k / (v["R"] * (v["J"] * s + v["B"]) + k**2))
    current, torque, voltage = got[1:]
    assert voltage * current == pytest.approx(torque * got[0] * v["G"])
    wheel = network("M torque s\nr wheel s c\nm mass c\nb damper c 0\nmeasure x(c)"
                    .replace("M torque s", "M torque s\nd rotary_damper s 0"))  # fmt: skip
    v = {"d": 0.3, "r": 0.2, "m": 4.0, "b": 1.5}
    got = of_linear(wheel, v, s)[0, 0]
    assert got == pytest.approx(1 / v["r"] / (v["m"] * s + v["b"] + v["d"] / v["r"] ** 2) / s)


TANKS = "P pump 0 t1 by u\nA1 tank t1\nA2 tank t2\nV1 valve t1 t2\nV2 valve t2 0\nmeasure h(t1), h(t2)"


def test_two_tanks_rest_where_torricelli_says():
    made = network(TANKS)
    v = {"P": 2e-6, "A1": 0.02, "A2": 0.015, "V1": 5e-5, "V2": 4e-5}
    u, g = 60.0, 9.81
    q = v["P"] * u
    h2 = q**2 / (2 * g * v["V2"] ** 2)
    h1 = h2 + q**2 / (2 * g * v["V1"] ** 2)
    rates, outputs = evaluated(made, v, {"h_A1": h1, "h_A2": h2}, {"u": u})
    assert list(rates.values()) == pytest.approx([0, 0], abs=1e-7)  # small_level: 1 mm beside 0.4 m
    rates, _ = evaluated(made, v, {"h_A1": h2, "h_A2": h1}, {"u": 0.0})
    assert rates["h_A1"] == pytest.approx(q / v["A1"], rel=1e-4)  # and back, where the second stands higher
    assert outputs == {"h_t1": h1, "h_t2": h2}


def test_two_heat_capacities_follow_scipy():
    from scipy.integrate import solve_ivp

    made = network(
        "H heater plate by u\nC1 heat_capacity plate\nC2 heat_capacity sensor\nR1 heat_resistance plate sensor\n"
        "R2 heat_resistance plate room\nroom_T surroundings room\nmeasure T(sensor)"
    )
    v = {"H": 0.5, "C1": 80.0, "C2": 5.0, "R1": 3.0, "R2": 10.0, "room_T": 21.0}

    def rate(t, x):  # written by hand
        to_sensor, lost = (x[0] - x[1]) / v["R1"], (x[0] - v["room_T"]) / v["R2"]
        return [(v["H"] * 40 - to_sensor - lost) / v["C1"], to_sensor / v["C2"]]

    def own(t, x):
        return list(evaluated(made, v, {"T_C1": x[0], "T_C2": x[1]}, {"u": 40.0})[0].values())

    ends = [solve_ivp(f, (0, 300), [25.0, 21.0], method="LSODA", rtol=1e-9, atol=1e-9).y[:, -1] for f in (rate, own)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-8)
    assert ends[0][0] < 21 + 0.5 * 40 * 10


def test_units_of_all_parts_fit():
    """The checker of equations follows every law."""
    texts = [
        RLC,
        TANKS,
        "q inflow t\nA tank t\nI pipe_inertia t s\nB tank s\nR pipe s out\nh0 level out\nmeasure h(t), q(I)",
        "V source a 0\nR resistor a b\nL inductor b c\nE battery c d\nK motor d 0 s\nJ inertia "
        "s\nF rotary_friction s 0\nM0 constant_torque s\nG gear s l\nk torsion_spring l t\nD "
        "rotary_damper l t\nJ2 inertia t\nrad wheel t z\nks spring z y\ndd damper z y\nm mass "
        "y\nFc friction y 0\nW constant_force y\nmeasure w(s), phi(t), x(y), i(K), M(G), F(Fc)",
        "F force a\nm mass a\nk spring a b\nd damper a b\nv0 velocity b\nmeasure x(a), v(a)",
        "W0 speed a\nk torsion_spring a b\nJ inertia b\nM torque b\nD rotary_damper b 0\nmeasure w(b)",
        "I0 current_source 0 a\nR resistor a 0\nC capacitor a 0\nmeasure voltage(a)",
        "H heater p by u [V]\nQ0 heat_flow p\nC heat_capacity p\nR heat_resistance p m\nR3 heat_resistance m r\nTa "
        "temperature r\n"
        "R4 heat_resistance p w\nTw surroundings w\nmeasure T(p), T(m), Q(R)",
    ]  # fmt: skip
    used = {line.split()[1] for text in texts for line in text.splitlines()}
    assert set(PARTS) <= used
    for text in texts:
        network(text).model()


def test_what_moves_nothing_that_is_measured_is_left_out_and_named():
    made = network("u source a 0\nR resistor a 0\nR1 resistor a b\nC capacitor b 0\nmeasure v(b)")
    assert made.idle == ("R",)
    assert set(made.parameters) == {"R1", "C"}


def test_states_start_where_they_are_measured_or_said():
    text = (
        "P heater p by u\nC1 heat_capacity p\nR1 heat_resistance p s\nC2 heat_capacity s\nR2 heat_resistance p "
        "r\nT0 surroundings r\n"
    )
    made = network(text + "measure T(s)")
    assert {s: e["initial"] for s, e in made.states.items()} == {"T_C1": "T_C1_start", "T_C2": "T_s"}
    assert made.parameters["T_C1_start"]["unit"] == "degC"
    made = network(text + "measure T(s)\nstart T(p) = T0, T(s) = 293.15 K")
    assert made.states["T_C1"]["initial"] == "T0"
    assert made.states["T_C2"]["initial"] == pytest.approx(20)
    assert "T_C1_start" not in made.parameters
    made.model()


def test_values_bounds_and_units_behind_the_nodes():
    made = network(
        "u source a 0\nR resistor a b 4.7 kohm\nC capacitor b 0  1..10 uF\nR2 resistor b 0\nmeasure v(b) as y"
    )
    assert made.parameters["R"]["value"] == pytest.approx(4700)
    assert made.parameters["C"]["bounds"] == pytest.approx((1e-6, 1e-5))
    assert made.parameters["R2"]["bounds"] == PARTS["resistor"].bounds
    assert made.outputs == {"y": "V"}
    assert made.states["v_C"]["initial"] == "y"


GOOD = "u source a 0\nR resistor a b\nC capacitor b 0\n"
MISTAKES = {  # what is written, and what is said of it
    "R1 resitor a b": ["line 1", "no part 'resitor'", "'resistor'"],
    "R1 resistor a": ["line 1", "2 nodes", "has 1", "R1 resistor <from> <to>"],
    "R1": ["line 1", "no kind"],
    "m1 mass 2.0 kg": ["one node", "m1 mass <node>"],
    GOOD + "R2 resistor b b\nmeasure v(b)": ["line 4", "shorted", "node b"],
    GOOD + "R2 resistor b d\nmeasure v(b)": ["line 4", "'d' hangs at R2 alone"],
    GOOD + "R1 resistor x y\nR2 resistor x y\nmeasure v(b)": ["x and y float", "join one of its parts to 0"],
    GOOD + "u2 source a 0\nmeasure v(b)": ["line 4", "u and u2 give one voltage twice", "shorted source"],
    GOOD + "C2 capacitor b 0\nmeasure v(b)": ["line 4", "C and C2 form a loop", "write C and C2 as one"],
    "u source a 0\nR resistor a 0\nC capacitor a 0\nmeasure v(a)": [
        "u and C form a loop",
        "C is no free store",
        "a resistor",
    ],
    "u source a 0\nL1 inductor a b\nL2 inductor b 0\nmeasure i(L1)": [
        "voltage at node 'b'",
        "L1 and L2",
        "a resistor or a capacitor",
    ],
    "P pump 0 t\nA tank t\nV1 valve t s\nV2 valve s 0\nmeasure h(t)": [
        "level at node 's'",
        "V1 and V2",
        "a tank or a pipe",
    ],
    "P pump 0 t\nA tank t\nV1 valve t s\nR1 pipe s 0\nmeasure h(t)": [
        "V1",
        "level there need one another",
        "put tank at its node",
    ],
    "M torque a\nJ1 inertia a\nG gear a b\nJ2 inertia b\nmeasure w(a)": [
        "joined rigidly",
        "J1 and J2 are one store",
        "by a spring",
    ],
    GOOD + "C2 capacitor b d 10 uH\nR2 resistor d 0\nmeasure v(b)": ["line 4", "in F", "uH does not fit"],
    GOOD + "C2 capacitor b d 10\nR2 resistor d 0\nmeasure v(b)": ["line 4", "10 has no unit", "10 F"],
    GOOD + "R2 resistor b 0 10..1 ohm\nmeasure v(b)": ["line 4", "are reversed; write the lower one first"],
    GOOD + "R2 resistor b 0 -1 ohm\nmeasure v(b)": ["line 4", "above 0"],
    GOOD + "R2 resistor b 0 c\nmeasure v(b)": ["line 4", "'c' behind the nodes of R2", "too many nodes"],
    GOOD + "R2 resistor b 0 5 blah\nmeasure v(b)": ["line 4", "blah"],
    GOOD + "J inertia b\nmeasure v(b)": ["line 4", "'b' of J is rotation", "R made it electric"],
    GOOD + "R resistor b 0\nmeasure v(b)": ["line 4", "a part R already, in line 2"],
    GOOD + "b resistor b 0\nmeasure v(b)": ["'b' is the name of a part and of a node"],
    GOOD + "measure T(b)": ["line 4", "T(b) cannot be measured", "v(b) voltage"],
    GOOD + "measure i(b)": ["current is that of a part", "v(b) voltage"],
    GOOD + "measure v(d)": ["no node or part 'd'"],
    GOOD + "measure v b": ["says nothing to measure", "measure v(b) as y"],
    GOOD + "measure v(b), v(b)": ["measured twice"],
    GOOD + "measure v(b) as i_R": ["i_R is also what", "current through R"],
    GOOD: ["nothing is measured", "measure v(a)"],
    "": ["no part"],
    GOOD + "u3 source d 0\nR4 resistor d 0\nmeasure v(b)": ["input u3 moves nothing that is measured"],
    GOOD + "pi resistor b 0\nmeasure v(b)": ["'pi' has a meaning of its own"],
    "u source a 0 5 V": ["u is an input", "delete '5 V'"],
    "C heat_capacity p\nR heat_resistance p 0\nmeasure T(p)": [
        "line 2",
        "node 0, which would be 0 degC",
        "surroundings room",
    ],
    "M torque a\nJ inertia a\nG gear a 0\nmeasure w(a)": ["drives node 0"],
    GOOD + "measure v(b)\nstart v(b) = 2 A": ["line 5", "a start in V is needed, or one of u"],
    GOOD + "measure v(b)\nstart v(a) = 2 V": ["line 5", "v_a is no state", "states are v_C"],
    GOOD + "measure v(b)\nstart v(b)": ["line 5", "says no start"],
    "P pump 0 t by u [blah]\nA tank t\nmeasure h(t)": ["'blah' is not a unit"],
}


@pytest.mark.parametrize("text", MISTAKES, ids=[" ".join(words[:2])[:40] for words in MISTAKES.values()])
def test_a_mistake_is_told_by_line_word_and_what_to_write(text):
    with pytest.raises(EquationError) as told:
        network(text, "circuit.net")
    sentence = str(told.value).splitlines()[0]
    assert sentence.startswith("circuit.net")
    assert [words for words in MISTAKES[text] if words not in sentence] == [], sentence
    assert sentence.endswith(".")


def test_polynomials_divide_exactly_and_have_greatest_common_divisors():
    x, y, z = (Polynomial.symbol(n) for n in "xyz")
    two = Polynomial.number(2)
    a, b, c = x * y + two * z, x - y * y, x + z
    assert (a * b).over(b) == a
    assert gcd(a * b, c * b) in (b, -b)
    assert gcd(two * a * c, two * c) == two * c
    assert gcd(a, b).is_one
    with pytest.raises(ArithmeticError):
        a.over(b)
    assert str(x * y + x * z) == "x*(y + z)"
    assert str(-(x * y) - x * x) == "-x*(x + y)"
    at = {"x": 2, "y": 3, "z": 5}
    for p in (a, b, a * b - c, -(a * a)):
        assert eval(str(p).replace("^", "**"), at) == sum(
            k * np.prod([at[n] ** e for n, e in m]) for m, k in p.terms.items()
        )


def test_a_block_is_solved_exactly():
    from plantfit.models.networks.laws import Equation

    x, one = Polynomial.symbol("r"), Polynomial.number(1)
    rows = [Equation({"p": x, "q": one, "u": -one}, ()), Equation({"p": one, "q": -x}, ())]
    found = {name: (terms, over) for name, terms, over in solved(rows, ["p", "q"])}
    assert found["p"] == ({"u": x}, x * x + one)
    assert found["q"] == ({"u": one}, x * x + one)


def test_every_kind_of_the_independent_system_is_a_part():
    assert set(KINDS) <= set(PARTS)


def test_no_part_has_a_name_that_equations_use():
    from plantfit.models.networks.netlist import RESERVED
    from plantfit.models.text import declarations
    from plantfit.models.text.functions import SPECIAL

    constants = {c for p in PARTS.values() for c in p.constants}
    used = {*declarations.RESERVED, *SPECIAL, *constants}
    assert used - RESERVED == set(), f"add {used - RESERVED} to _USED in src/plantfit/models/networks/netlist.py"
    assert RESERVED - used == set(), f"take {RESERVED - used} out of _USED in src/plantfit/models/networks/netlist.py"
    with pytest.raises(EquationError, match="'max' has a meaning of its own"):
        network("max resistor a b")
