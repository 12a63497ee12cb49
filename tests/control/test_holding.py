"""Regulators that hold an equilibrium: poles and sensitivity by identities, starts against what no input could
catch, fresh plants."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import stick, straight
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.control.holding.design import designed, hold
from plantfit.control.holding.linear_loop import controller_of, largest_sensitivity, near, poles
from plantfit.control.holding.point import held_point, moving_poles, reach_seconds, slow_time
from plantfit.control.holding.told import regulator, verdict
from plantfit.control.linear.kalman import kalman_observer
from plantfit.control.linear.linear_plant import linearised
from plantfit.control.linear.lqr import lqr
from plantfit.errors import SimulationError, SpecError
from plantfit.findings.results.held_plant import HoldWishes
from plantfit.findings.verdict import Sentence
from plantfit.holding import Held, _of_the_fit, _one_input, _Plants, _seconds
from plantfit.models.text.equations import equations
from plantfit.recording import from_arrays
from plantfit.spec.tables import ControlTable

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

ASKED = HoldWishes(
    {"q": 0.0}, "u", 0.01, -0.3, 0.3, "q", 0.1, 1.0, 3.0, 0.02, {"q": 0.2, "w": 1.0}, {"q": 0.0, "w": 0.0},
    {"q": 1e-4, "w": 1e-3}
)  # fmt: skip


def family(n, seed, spread=0.05):
    rng = np.random.default_rng(seed)
    return {k: v * np.r_[1.0, np.exp(spread * rng.normal(size=n))] for k, v in {"a": 20.0, "b": 50.0, "c": 0.3}.items()}


def one():
    return linearised(stick(), {"a": 20.0, "b": 50.0, "c": 0.3}, {"q": 0.0})


@pytest.mark.parametrize("weights", [(1.0, 0.1), (100.0, 0.01), (0.01, 1.0)])
@pytest.mark.thorough
def test_poles_are_those_of_one_sample_of_plant_and_controller(weights):
    """By exact derivatives of both together; and 1 + L is the closed over the open characteristic polynomial."""
    plants = family(4, 1, 0.3)
    design = designed(one(), ASKED, *weights)
    linear, c = near(stick(), plants, np.zeros(2), np.zeros(1), ASKED.period), controller_of(design.parameters)
    found = poles(linear, c)
    w = np.geomspace(0.01, np.pi / ASKED.period, 200)
    z = np.exp(1j * w * ASKED.period)
    for i in range(5):
        a, b, seen = linear.A[i], linear.B[i], linear.C[i]
        free = design.parameters._replace(lower=jnp.array([-np.inf]), upper=jnp.array([np.inf]))
        start, back = ravel_pytree(design.controller.init({"q": jnp.zeros(())}, free))

        def moved(s, a=a, b=b, seen=seen, free=free, back=back):
            state, u = design.controller.update(back(s[2:]), {"q": (seen @ s[:2])[0]}, {}, free)
            return jnp.concatenate([a @ s[:2] + b[:, 0] * u["u"], ravel_pytree(state)[0]])

        whole = np.asarray(jax.jacfwd(moved)(jnp.concatenate([jnp.zeros(2), jnp.zeros_like(start)])))
        own = np.linalg.eigvals(whole)
        assert found[i] == pytest.approx(np.max(np.abs(own)), rel=1e-7)
        opened = np.r_[np.linalg.eigvals(a), np.linalg.eigvals(c.F)]
        closed = own[np.argsort(np.abs(own))[::-1]][:4]  # the others are 0: the command of the last sample
        one_plus = np.prod(z[:, None] - closed, axis=1) / np.prod(z[:, None] - opened, axis=1)
        truth = float(np.max(1.0 / np.abs(one_plus)))
        assert largest_sensitivity(linear, c, w, ASKED.period)[i] == pytest.approx(truth, rel=1e-5)


def test_an_output_that_reads_the_input_is_part_of_the_loop():
    """An accelerometer beside the angle: the force that the filter takes it to read is another one on another plant."""
    plant = equations(
        "x' = v\nv' = x - 0.2*v + k*u\na = x - 0.2*v + k*u\nz = x", inputs=["u"], states=["x", "v"], outputs=["a", "z"],
        parameters=["k"],
        name="p",
    )  # fmt: skip
    period, force = 0.1, np.array([1.0, 1.02, 1.5])
    best = linearised(plant, {"k": 1.0}, {"x": 0.0, "v": 0.0}, {"u": 0.0})
    filter_ = kalman_observer(best, period, {"v": 1.0}, {"a": 0.05, "z": 0.05})
    design = lqr(best, period, np.diag([1.0, 0.1]), {"u": 0.05}, estimator=filter_)
    linear, c = near(plant, {"k": force}, np.zeros(2), np.zeros(1), period), controller_of(design.parameters)
    w = np.geomspace(0.01, np.pi / period, 200)
    z, found, ms = np.exp(1j * w * period), poles(linear, c), largest_sensitivity(linear, c, w, period)
    start, back = ravel_pytree(design.controller.init({"a": jnp.zeros(()), "z": jnp.zeros(())}, design.parameters))
    for i, k in enumerate(force):
        a, b, seen = linear.A[i], linear.B[i], linear.C[i]

        def moved(s, opened=1.0, a=a, b=b, seen=seen, k=k):
            y = seen @ s[:2] + jnp.array([k, 0.0]) * s[2]
            state, u = design.controller.update(back(s[3:]), {"a": y[0], "z": y[1]}, {}, design.parameters)
            acts = opened * jnp.reshape(u["u"], (1,))
            return jnp.concatenate([a @ s[:2] + b @ acts, acts, ravel_pytree(state)[0]])

        at = jnp.concatenate([jnp.zeros(3), jnp.zeros_like(start)])
        closed, opened = (np.linalg.eigvals(np.asarray(jax.jacfwd(moved)(at, f))) for f in (1.0, 0.0))
        assert found[i] == pytest.approx(np.max(np.abs(closed)), rel=1e-7)
        one_plus = np.prod(z[:, None] - closed, axis=1) / np.prod(z[:, None] - opened, axis=1)
        assert ms[i] == pytest.approx(float(np.max(1.0 / np.abs(one_plus))), rel=1e-5)
    assert (found < 1.0).tolist() == [True, True, False]


@pytest.fixture(scope="module")
def found():
    return hold(straight(), family(20, 1), family(60, 2), ASKED)


def test_no_start_is_caught_that_no_input_within_the_limits_could(found):
    """The plant is linear: the part along its unstable mode has to be less than the input can hold back."""
    for i in range(0, 61, 5):
        p = {k: float(v[i]) for k, v in found.plants.items()}
        a = np.array([[0.0, 1.0], [p["a"], -p["c"]]])
        values, left = (np.real(v) for v in np.linalg.eig(a.T))
        k = int(np.argmax(values))
        bound = abs(left[1, k] * p["b"]) * 0.3 / values[k] / abs(left[0, k])
        for far in found.best.caught[i]:
            assert far <= bound
            assert far >= 0.75 * bound  # a filter, a sampling and a grid of starts stand between


def test_all_plants_of_the_family_are_held_and_fresh_ones_too(found):
    assert found.best.share(ASKED) >= 0.95
    assert np.all(found.best.stable)
    assert float(np.real(found.unstable[0])) == pytest.approx(4.324, abs=1e-3)  # of q'' = 20 q - 0.3 q'
    fresh = near(straight(), family(1000, 77), np.zeros(2), np.zeros(1), ASKED.period)
    assert np.mean(poles(fresh, controller_of(found.best.design.parameters)) < 1.0) >= 0.999
    told = [s.sentence for s in verdict(found, "that the data allow")]
    assert told[0].startswith("Of 61 plants that the data allow, 100 % return to the point from q 0.1 ")
    assert any("a deviation doubles in 0.16 s" in sentence for sentence in told)
    row = regulator(found, found.best)
    assert row.share == 1.0
    assert row.below == pytest.approx(found.best.caught[0, 0])


def test_responses_begin_at_the_lean_and_end_at_the_point(found):
    seen = found.responses(found.best)
    np.testing.assert_allclose(seen["y"][:, 0], 0.1)
    assert np.max(np.abs(seen["y"][:, -30:])) < 0.02
    assert np.max(np.abs(seen["u"])) <= 0.3 + 1e-12


@pytest.mark.thorough
def test_what_cannot_be_held_is_said():
    plants = {k: v[:3] for k, v in family(3, 1).items()}
    leaning = replace(ASKED, at={"q": 0.2}, upper=-0.2)
    with pytest.raises(SimulationError, match=r"Holding the point takes u = -0.079.*, beyond its limits -0.3 to -0.2"):
        hold(stick(), plants, plants, leaning)
    alone = equations(
        "q' = a*q\nw' = u - w", inputs=["u"], states=["q", "w"], outputs=["q", "w"], parameters=["a"], name="alone"
    )
    with pytest.raises(SimulationError, match=r"No regulator exists for the inputs \['u'\]"):
        hold(alone, {"a": np.ones(3)}, {"a": np.ones(3)}, ASKED)
    falling = equations(
        "q' = w\nw' = a + u*w", inputs=["u"], states=["q", "w"], outputs=["q"], parameters=["a"], name="falling"
    )
    with pytest.raises(SimulationError, match=r"has no equilibrium near x0"):
        hold(falling, {"a": np.ones(3)}, {"a": np.ones(3)}, ASKED)


def test_the_horizon_is_found_where_an_input_acts_by_its_square():
    """A magnet that holds a ball: from an input of 0 nothing shows which way to go. Its poles are +-sqrt(2 g/x)."""
    model = equations(
        "x' = v\nv' = 9.81 - q*(i/x)^2\ny = x", inputs=["i"], states=["x", "v"], outputs=["y"], parameters=["q"],
        name="magnet",
    )  # fmt: skip
    known: Any = SimpleNamespace(model=model, values={"q": np.array([9.56e-4])})
    seconds, why = _seconds(known, {"x": 0.009}, "i", (0.0, 3.0), 0.001, 0.001)
    assert seconds == pytest.approx(10 / np.sqrt(2 * 9.81 / 0.009), rel=0.1)
    assert why == "10 times the slowest time of the plant there"


CHAINS = {
    "hover": ("z' = v\nv' = k*u^2 - 0.09*abs(v)*v - 9.81\ny = z", ["z", "v"], 0.1, (4.0, 15.0), 2.0),
    "tank": ("z' = k*u - 0.3\ny = z", ["z"], 0.1, (0.0, 10.0), 2.0),
    "three": ("z' = v\nv' = a\na' = k*u\ny = z", ["z", "v", "a"], 3.0, (-2.0, 2.0), 0.5),
    "servo": ("z' = v\nv' = k*u - 5*v\ny = z", ["z", "v"], 20.0, (-3.0, 3.0), 1.0),
    # the same double integrator with its states mixed: no entry of its matrix is 0
    "mixed": ("z' = z - w\nw' = z - w + k*u\ny = z\nx = w", ["z", "w"], 2.0, (-3.0, 3.0), 0.0),
}


@pytest.mark.parametrize(
    "name", ["hover", "tank", "three", *(pytest.param(n, marks=pytest.mark.slow) for n in ("servo", "mixed"))]
)
@pytest.mark.thorough
def test_plants_of_integrators_are_held_within_the_time_that_is_proposed(name):
    """Their poles at 0 tell no time; the regulator is replayed on the equations, integrated by scipy."""
    text, states, k, limits, point = CHAINS[name]
    outputs = ["y", "x"] if name == "mixed" else ["y"]
    model = equations(text, inputs=["u"], states=states, outputs=outputs, parameters=["k"], name=name)
    plants = {"k": k * np.array([1.0, 1.001, 0.999])}
    known: Any = SimpleNamespace(model=model, values=plants)
    seconds, why = _seconds(known, {"z": point}, "u", limits, 1.0, 0.05)
    assert why == "10 times the time in which u within its limits moves z by 1"
    asked = HoldWishes(
        {"z": point}, "u", 0.05, *limits, "z", 0.5, 1.0, seconds, 0.1, dict.fromkeys(outputs, 1.0),
        dict.fromkeys(outputs, 0.0), dict.fromkeys(outputs, 1e-3), share=0.9,
    )  # fmt: skip
    design = hold(model, plants, plants, asked)
    assert design.best.share(asked) == 1.0
    for lean in (-0.5, 0.5):
        y = replayed(design, k, lean, seconds)
        assert np.max(np.abs(y[-len(y) // 10 :] - point)) < 0.1


def replayed(design, k, lean, seconds):
    """The first output (N,) of the plant `k`, begun `lean` off the point, by scipy between samples."""
    law, w = design.best.design, design.wishes
    rate = {
        "hover": lambda x, u: [x[1], k * u**2 - 0.09 * abs(x[1]) * x[1] - 9.81],
        "tank": lambda x, u: [k * u - 0.3],
        "three": lambda x, u: [x[1], x[2], k * u],
        "servo": lambda x, u: [x[1], k * u - 5 * x[1]],
        "mixed": lambda x, u: [x[0] - x[1], x[0] - x[1] + k * u],
    }[design.model.name]
    update = jax.jit(law.controller.update)
    x, seen = design.plant.x0 + lean * np.eye(len(design.plant.x0))[0], []
    state = None
    for _ in range(round(seconds / w.period)):
        measured = dict(zip(design.plant.outputs, map(jnp.asarray, x), strict=False))
        state = law.controller.init(measured, law.parameters) if state is None else state
        state, u = update(state, measured, {}, law.parameters)
        seen.append(x[0])
        u = float(np.clip(u["u"], w.lower, w.upper))
        x = solve_ivp(lambda _, x, u=u: rate(x, u), (0, w.period), x, rtol=1e-8, atol=1e-10).y[:, -1]
    return np.array(seen)


def test_poles_at_zero_are_told_from_slow_ones_in_any_coordinates():
    """A chain of three among others, mixed by random matrices: its poles are known to the third root of rounding."""
    rng = np.random.default_rng(5)
    for scale in (1e-3, 1.0, 1e3):
        a = np.diag([0.0, 0.0, 0.0, -2.0, 0.5]) + np.diag([1.0, 1.0, 0.0, 0.0], 1)
        turn = np.linalg.qr(rng.normal(size=(5, 5)))[0]
        found = np.sort(np.real(moving_poles(scale * turn @ a @ turn.T)))
        np.testing.assert_allclose(found, scale * np.array([-2.0, 0.5]), rtol=1e-6)
    assert len(moving_poles(np.zeros((3, 3)))) == 0
    np.testing.assert_allclose(moving_poles(np.diag([-1e-4, -1.0])), [-1e-4, -1.0])


def test_the_time_that_an_input_takes_is_the_closed_form():
    for n in (1, 2, 3):
        states = [f"x{i}" for i in range(n)]
        text = "".join(f"x{i}' = x{i + 1}\n" for i in range(n - 1)) + f"x{n - 1}' = 2*u + k\ny = x0"
        model = equations(text, inputs=["u"], states=states, outputs=["y"], parameters=["k"], name="chain")
        plant = linearised(model, {"k": 0.0}, {})
        closed = (0.3 * math.factorial(n) / (2.0 * 0.7)) ** (1 / n)
        assert reach_seconds(plant, "x0", 0.3, 0.7) == pytest.approx(closed, rel=1e-3)
    away = equations("x' = u\nz' = -2*z + k\ny = z", inputs=["u"], states=["x", "z"], outputs=["y"],
                     parameters=["k"], name="away")  # fmt: skip
    apart = linearised(away, {"k": 0.0}, {})
    assert reach_seconds(apart, "z", 0.3, 0.7) == np.inf
    assert slow_time(apart, "z", 0.3, 0.7) == (0.5, False)


@pytest.mark.thorough
def test_a_point_beyond_a_current_limit_is_found_from_inputs_all_over_the_range():
    """At 0 V the back EMF of a turning motor is beyond its limit, so that no slope shows what the voltage does."""
    motor = equations(
        "i = sat((u - 0.045*w)/1.1, -m, m)\nw' = (0.045*i - 1.2e-4*w)/3e-4\ny = w", inputs=["u"],
        states=["w"], outputs=["y"], parameters=["m"], name="motor",
    )  # fmt: skip
    at, u = held_point(motor, {"m": 4.0}, {"w": 300.0}, "u", -24.0, 24.0)
    assert at == {"w": 300.0}
    assert u["u"] == pytest.approx(1.1 * 1.2e-4 * 300 / 0.045 + 0.045 * 300, abs=1e-6)
    with pytest.raises(SimulationError, match=r"has no equilibrium near x0"):
        held_point(motor, {"m": 0.4}, {"w": 300.0}, "u", -24.0, 24.0)


def two_inputs():
    model = equations(
        "z' = v\nv' = k*(u*b)^2 - 9.81\ny = z", inputs={"u": None, "b": "V"}, states=["z", "v"], outputs=["y"],
        parameters=["k"], name="copter",
    )  # fmt: skip
    seen = from_arrays(
        np.arange(3.0), signals={"u": (np.array([0.5, 0.6, 0.7]), None), "b": (np.array([14.0, 15.0, 17.0]), "V")}
    )
    return _Plants(model, {"k": np.array([0.1])}, seen, "copter")


def test_inputs_beside_the_one_that_is_driven_are_held():
    """At their median, or as asked for: the throttle that hovers is that of the battery's voltage."""
    for inputs, b, told in (
        ({}, 15.0, {"inputs.b": "15 V, its median in the recording"}),
        ({"b": "12000 mV"}, 12.0, {}),
    ):
        proposed: dict[str, str] = {}
        known = _one_input(two_inputs(), ControlTable(input="u", inputs=inputs), proposed)
        assert list(known.model.inputs) == ["u"]
        assert proposed == told
        at, u0 = held_point(known.model, {"k": 0.1}, {"z": 2.0}, "u", 0.1, 1.0)
        assert at["v"] == pytest.approx(0.0, abs=1e-9)
        assert u0["u"] == pytest.approx(np.sqrt(98.1) / b)
        plant = linearised(known.model, {"k": 0.1}, at, u0)
        np.testing.assert_allclose(plant.B[:, 0], [0.0, 0.2 * u0["u"] * b**2])


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, 'The model has the inputs u, b, and one loop has one; name it in the study file ([control] input = "u")'),
        ({"input": "u", "inputs": {"c": 1.0}}, "[control] inputs names 'c'; the other inputs are ['b']."),
        ({"input": "x"}, "There is no input 'x'; the model has u, b."),
    ],
)
def test_an_input_that_is_not_known_or_not_chosen_is_said(asked, said):
    with pytest.raises(SpecError) as e:
        _one_input(two_inputs(), ControlTable(**asked), {})
    assert said in str(e.value)


def test_an_input_that_was_not_recorded_has_to_be_given():
    known = two_inputs()
    bare = replace(known, recording=from_arrays(np.arange(3.0), signals={"u": (np.ones(3), None)}))
    with pytest.raises(SpecError, match=r"The recording has no b; say where it is held \(\[control\] inputs = \{ b = "):
        _one_input(bare, ControlTable(input="u"), {})


def test_what_the_study_says_against_its_model_stands_first(found, tmp_path):
    doubt = Sentence(level="warning", sentence="The model lacks something: what is promised below may not hold.")
    held = Held("cart", found, {}, doubts=(doubt,))
    assert held.verdict[0]["sentence"] == doubt.sentence
    assert held.verdict[1:] == Held("cart", found, {}).verdict
    head = held.to_c(tmp_path).header.read_text("utf-8")
    assert doubt.sentence in head
    assert held.verdict[1]["sentence"] in head


def test_a_fit_that_determines_nothing_is_said_to_say_nothing():
    (nothing,) = _of_the_fit(("a",), True)
    assert nothing.level == "bad"
    assert "The data determine none of the parameters, so that the fit says nothing about the plant" in nothing.sentence
    (some,) = _of_the_fit(("a", "c"), False)
    assert some.level == "warning"
    assert some.sentence.startswith("a, c are not determined by the data: the plants spread")
    assert _of_the_fit((), False) == []


@pytest.mark.parametrize(("unit", "said"), [("N*m", " N*m"), (None, "")])
def test_limits_that_do_not_hold_the_point_have_the_unit_of_the_input(unit, said):
    model = equations(
        "q' = w\nw' = a*sin(q) - c*w + b*u", inputs={"u": unit}, states=["q", "w"], outputs=["q"],
        parameters=["a", "b", "c"], name="stick",
    )  # fmt: skip
    plants = family(1, 1)
    with pytest.raises(SimulationError) as e:
        hold(model, plants, plants, replace(ASKED, at={"q": -np.arcsin(0.9)}))
    assert f"Holding the point takes u = 0.36{said}, beyond its limits -0.3 to 0.3{said}; choose" in str(e.value)
