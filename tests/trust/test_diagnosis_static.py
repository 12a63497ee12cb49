"""What a static model lacks is named: a part of a characteristic, a curve of an input; nothing where it is right."""

import numpy as np
import pytest

from plantfit import Problem, Recording, Signal, equations
from plantfit.errors import ModelError
from plantfit.fitting import fit
from plantfit.models.extensions import KINDS, with_extensions
from plantfit.models.extensions.parts import unit_of_part
from plantfit.problem.measure.experiment import Experiment
from plantfit.trust.diagnosis import diagnose, diagnosis_record

ROWS = 80


def problem_of(text, inputs, outputs, bounds, data):
    units = {**inputs, **outputs}
    recording = Recording(np.arange(float(ROWS)), {n: Signal(v, units[n]) for n, v in data.items()}, "r")
    return Problem(
        equations(text, inputs=inputs, outputs=outputs, parameters={n: {} for n in bounds}), recording, bounds
    )


def pump(rng, fault):
    flow, speed = rng.uniform(0, 50, ROWS), rng.uniform(0.5, 1, ROWS)
    head = 30 * speed**2 - 0.006 * flow**2 - 0.1 * fault * flow * speed + rng.normal(0, 0.1, ROWS)
    units = {"Q": "m^3/h", "w": "1"}, {"H": "m"}
    return problem_of("H = H0*w^2 - a*Q^2", *units, {"H0": (1, 100), "a": (0, 1)}, {"Q": flow, "w": speed, "H": head})


def heat_pump(rng, fault):
    cold, hot, power = rng.uniform(263, 288, ROWS), rng.uniform(303, 328, ROWS), rng.uniform(0.8, 3, ROWS)
    heat = 0.45 * hot / (hot - cold) * (power - 0.2 * fault) + rng.normal(0, 0.05, ROWS)
    units = {"Tc": "K", "Th": "K", "P": "kW"}, {"q": "kW"}
    data = {"Tc": cold, "Th": hot, "P": power, "q": heat}
    return problem_of("q = eta*Th/(Th - Tc)*P", *units, {"eta": (0.1, 1)}, data)


def valve(rng, fault):
    drop, lift = rng.uniform(0.2, 3, ROWS), rng.uniform(0.1, 1, ROWS)
    flow = 6 * lift ** (1 + 0.4 * fault) * np.sqrt(drop) + rng.normal(0, 0.05, ROWS)
    units = {"dp": "bar", "h": "1"}, {"q": "m^3/h"}
    return problem_of("q = kv*h*sqrt(dp)", *units, {"kv": (0.1, 50)}, {"dp": drop, "h": lift, "q": flow})


def drag(rng, fault):
    w = rng.uniform(-200, 200, ROWS)
    torque = 0.05 * np.sign(w) + 1e-3 * w + 3e-6 * fault * w * np.abs(w) + rng.normal(0, 0.005, ROWS)
    bounds = {"Fc": (0, 1), "b": (0, 0.1)}
    return problem_of("M = Fc*sign(w) + b*w", {"w": "rad/s"}, {"M": "N*m"}, bounds, {"w": w, "M": torque})


def dry(rng, fault):
    w = rng.uniform(-200, 200, ROWS)
    torque = 0.05 * fault * np.sign(w) + 1e-3 * w + rng.normal(0, 0.005, ROWS)
    return problem_of("M = b*w", {"w": "rad/s"}, {"M": "N*m"}, {"b": (0, 0.1)}, {"w": w, "M": torque})


def curved_line(rng, fault):
    u = rng.uniform(0, 10, ROWS)
    y = 2 + 1.5 * u + 0.05 * fault * u**2 + rng.normal(0, 0.1, ROWS)
    return problem_of("y = k*u + c", {"u": "A"}, {"y": "N"}, {"k": (0, 10), "c": (-10, 10)}, {"u": u, "y": y})


def dead_zone(rng, fault):
    u = rng.uniform(-10, 10, ROWS)
    y = 2 * np.sign(u) * np.maximum(np.abs(u) - 1.2 * fault, 0) + rng.normal(0, 0.1, ROWS)
    return problem_of("y = k*u", {"u": "V"}, {"y": "rad/s"}, {"k": (0, 10)}, {"u": u, "y": y})


def limit(rng, fault):
    u = rng.uniform(0, 10, ROWS)
    y = 2 * np.minimum(u, 7 if fault else 99) + 1 + rng.normal(0, 0.1, ROWS)
    return problem_of("y = k*u + c", {"u": "A"}, {"y": "N"}, {"k": (0, 10), "c": (-10, 10)}, {"u": u, "y": y})


def sensor(rng, fault):
    temperature = rng.uniform(0, 100, ROWS)
    y = 0.3 * fault + 0.04 * temperature + rng.normal(0, 0.02, ROWS)
    return problem_of("y = k*T", {"T": "degC"}, {"y": "V"}, {"k": (0, 1)}, {"T": temperature, "y": y})


def thermistor(rng, fault):
    temperature = rng.uniform(273, 373, ROWS)
    ohm = 1e4 * np.exp(3900 * (1 / temperature - 1 / 298.15)) + 300 * fault
    data = {"R": ohm, "T": temperature + rng.normal(0, 0.1, ROWS)}
    bounds = {"R0": (5e3, 2e4), "B": (2e3, 6e3)}
    return problem_of("T = 1/(1/298.15 + log(R/R0)/B)", {"R": "1"}, {"T": "K"}, bounds, data)


# what lacks what: the names that may stand beside it explain exactly or nearly the same
PLANTS = {
    pump: ("part of H by Q times w", set(), -0.1),
    heat_pump: ("offset of P", {"dead zone of P"}, 0.2),
    valve: ("power of h on q", set(), 0.4),
    drag: ("part of M by the square of w with its sign", set(), 3e-6),
    dry: ("part of M by the sign of w", set(), 0.05),
    curved_line: ("part of y by the square of u", set(), 0.05),
    dead_zone: ("dead zone of u", set(), 1.2),
    limit: ("saturation of u", {"upper end of the sensor of y"}, 7.0),
    sensor: ("offset of y", {"offset of T"}, 0.3),
    thermistor: ("offset of R", set(), 300.0),
}


def found(problem):
    answer = fit(problem)
    return diagnose(answer.problem, answer.best.x)


def seeds(first, count):
    return [s if s == first else pytest.param(s, marks=pytest.mark.thorough) for s in range(first, first + count)]


@pytest.mark.parametrize("seed", seeds(0, 4))
@pytest.mark.parametrize("plant", PLANTS, ids=lambda p: p.__name__)
def test_what_a_characteristic_lacks_is_named(plant, seed):
    name, alike, value = PLANTS[plant]
    told = found(plant(np.random.default_rng(seed), 1.0))
    assert told.rounds[0].found
    named = {t.extension.name: t for t in told.rounds[0].found}
    assert name in named
    assert set(named) <= {name, *alike}
    one = named[name]
    assert one.explained > 0.6
    assert one.standard_error is not None
    assert one.value == pytest.approx(value, abs=4 * one.standard_error, rel=0.02)
    sentence = diagnosis_record(told)["verdict"][0]["sentence"]
    assert "likely missing" in sentence
    assert "{" not in sentence


@pytest.mark.parametrize("seed", seeds(20, 4))
@pytest.mark.parametrize("plant", PLANTS, ids=lambda p: p.__name__)
def test_of_a_right_characteristic_nothing_is_named(plant, seed):
    told = found(plant(np.random.default_rng(seed), 0.0))
    assert not told.found
    assert "missing" not in " ".join(s["sentence"] for s in diagnosis_record(told)["verdict"])


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["in proportion", "heavy"])
def test_few_rows_in_any_order_name_nothing_that_is_not_there(noise):
    """Twelve rows of three parameters: of few rows the gain of likelihood is more than chi-squared by chance."""
    named = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        u, v = np.sort(rng.uniform(1, 10, 12)), rng.uniform(20, 60, 12)
        y = 1 + 0.5 * u + 0.1 * v
        e = 0.02 * y * rng.standard_normal(12) if noise == "in proportion" else 0.1 * rng.standard_t(3, 12)
        signals = {"u": Signal(u, "A"), "v": Signal(v, "degC"), "y": Signal(y + e, "N")}
        model = equations(
            "y = c + a*u + b*v",
            inputs={"u": "A", "v": "degC"},
            outputs={"y": "N"},
            parameters={"a": {}, "b": {}, "c": {}},
        )
        bounds = {"c": (-10, 10), "a": (0, 10), "b": (0, 1)}
        named += bool(found(Problem(model, Recording(np.arange(12.0), signals, "r"), bounds)).found)
    assert named <= 1


@pytest.mark.thorough
def test_a_plant_at_rest_is_a_static_one():
    """A motor's speeds at rest over its voltage, of the model that is a state: its dead zone is named."""
    rng = np.random.default_rng(3)
    u = rng.uniform(-10, 10, ROWS)
    w = 5 * np.sign(u) * np.maximum(np.abs(u) - 1.5, 0) + rng.normal(0, 0.3, ROWS)
    model = equations(
        "w' = (K*u - w)/T", states={"w": "rad/s"}, inputs={"u": "V"}, outputs={"w": "rad/s"},
        parameters={"K": {"unit": "rad/s/V"}, "T": {"unit": "s", "value": 0.1}},
    )  # fmt: skip
    rows = Recording(np.arange(float(ROWS)), {"u": Signal(u, "V"), "w": Signal(w, "rad/s")}, "r")
    told = found(Problem(model, {"r": Experiment(rows, steady=True)}, {"K": (0.1, 50)}))
    assert [t.extension.name for t in told.rounds[0].found] == ["dead zone of u"]
    assert told.found[0].value == pytest.approx(1.5, abs=0.1)


def test_records_over_time_beside_others_at_rest_are_refused_in_a_sentence():
    t = np.arange(60) * 0.1
    model = equations(
        "x' = (K*u - x)/T\ny = x", states=["x"], inputs=["u"], outputs=["y"], parameters={"K": {}, "T": {}}
    )
    rows = Recording(t, {"u": Signal(np.sin(t), None), "y": Signal(np.cos(t), None)}, "a")
    both = {"a": Experiment(rows), "b": Experiment(rows, steady=True)}
    problem = Problem(model, both, {"K": (0.1, 9), "T": (0.1, 9)})
    with pytest.raises(ModelError, match="all over time or all at rest"):
        diagnose(problem, np.array([0.5, 0.5]))


def test_parts_are_their_closed_forms_with_units_of_their_own():
    model = equations(
        "y = a*u*v/v", inputs={"u": "m/s", "v": "1"}, outputs={"y": "N"}, parameters={"a": {"unit": "N*s/m"}}
    )
    at, p = {"u": -3.0, "v": 2.0, "t": 0.0}, {"a": 1.0}
    wanted = {"proportional": -3.0, "square": 9.0, "signed_square": -9.0, "sign": -1.0}
    for kind, shape in wanted.items():
        made = with_extensions(model, {kind: {"y with u": (-1, 1)}})
        assert float(made.output({}, at, {**p, f"{kind}_y_with_u": 0.5})["y"]) == pytest.approx(-3.0 + 0.5 * shape)
    made = with_extensions(model, {"product": {"y with u and v": (-1, 1)}})
    assert float(made.output({}, at, {**p, "product_y_with_u_and_v": 0.5})["y"]) == pytest.approx(-6.0)
    made = with_extensions(model, {"power": {"y with v": (-1, 1)}})
    given = {**p, "power_y_with_v": 0.5, "reference_y_with_v": 0.5}
    assert float(made.output({}, at, given)["y"]) == pytest.approx(-6.0)
    units = {kind: unit_of_part(model, kind, "y with u") for kind in wanted}
    assert units == {"proportional": "N/(m/s)", "square": "N/(m/s)^2", "signed_square": "N/(m/s)^2", "sign": "N"}
    assert unit_of_part(model, "product", "y with u and v") == "N/(m/s)"
    assert unit_of_part(model, "square", "y with v") == "N"


@pytest.mark.parametrize(("kind", "pair"), [("square", "y with q"), ("product", "y with u"), ("sign", "u with y")])
def test_a_part_of_what_there_is_not_is_refused(kind, pair):
    model = equations("y = a*u*v", inputs=["u", "v"], outputs=["y"], parameters={"a": {}})
    with pytest.raises(ModelError, match=r"one of its (pairs of an output and an input|outputs with two inputs)"):
        with_extensions(model, {kind: {pair: (-1, 1)}})
    assert kind in KINDS


@pytest.mark.parametrize(("offset", "noise", "unit", "told"), [
    (-273.15, 0.05, "K", True), (273.15, 0.05, "K", True), (-271.0, 0.05, "K", False), (-270.0, 40.0, "K", False),
    (273.15, 0.05, "m", False),
])  # fmt: skip
def test_an_offset_by_which_two_units_lie_apart_is_told_as_that(offset, noise, unit, told):
    """Only of temperatures, and only where the offset is known closely."""
    rng = np.random.default_rng(1)
    inlet, power = rng.uniform(280, 360, ROWS), rng.uniform(0, 5, ROWS)
    outlet = inlet + 2.0 * power + offset + noise * rng.standard_normal(ROWS)
    data = {"a": inlet, "P": power, "b": outlet}
    found_one = found(problem_of("b = a + k*P", {"a": unit, "P": "kW"}, {"b": unit}, {"k": (0.1, 10)}, data))
    assert any(t.extension.name == "offset of b" for t in found_one.rounds[0].found)
    said = " ".join(s["sentence"] for s in diagnosis_record(found_one)["verdict"])
    assert ("K and degC lie 273.15 K apart" in said) is told
