"""Loops around plants with dead time of their own, against actuators that are late, closed forms and a tight solver."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.control import Gains, pid
from plantfit.errors import ModelError, SimulationError
from plantfit.models.library.steam_chamber import steam_chamber
from plantfit.models.model import Declared
from plantfit.models.parts.tables import Table
from plantfit.models.text.equations import equations
from plantfit.simulate.loop.closed_loop import Controller, closed_loop
from plantfit.simulate.loop.sensors import Actuator
from plantfit.simulate.simulator import Simulator

import jax
import jax.numpy as jnp

PERIOD = 0.1
GAINS = Gains(1.2, 0.4, 0.1, filter_time=0.2)
OPEN = Controller(lambda y, p: (), lambda state, y, reference, p: (state, reference))


def lag(text="y' = (K*delay(u, Td) + 0.3*delay(u, Tb) - y)/tau", parameters=("K", "tau", "Td", "Tb")):
    return equations(
        text + "\nz = y", inputs=["u"], states=["y"], outputs=["z"], parameters=list(parameters), name="lag"
    )


def one(gain=2.0, tau=3.0, late=0.0, later=0.0):
    return {"K": gain, "tau": tau, "Td": late, "Tb": later}


@pytest.mark.thorough
def test_whole_samples_are_those_of_a_late_actuator():
    plain = lag("y' = (K*u - y)/tau", ("K", "tau"))
    late = lag("y' = (K*delay(u, Td) - y)/tau", ("K", "tau", "Td"))
    for stepper, counts in (("exact", (0, 7)), ("rosenbrock", (7,))):
        loop = closed_loop(
            late, pid(PERIOD, lower=-1, upper=1), period=PERIOD, longest_delay=1.0, stepper=stepper, substeps=4
        )
        for samples in counts:
            other = closed_loop(plain, pid(PERIOD, lower=-1, upper=1), period=PERIOD, actuator=Actuator(delay=samples),
                                stepper=stepper,
                                substeps=4)  # fmt: skip
            a = loop.simulate(GAINS, {"K": 2.0, "tau": 3.0, "Td": samples * PERIOD}, 1.0, samples=200)
            b = other.simulate(GAINS, {"K": 2.0, "tau": 3.0}, 1.0, samples=200)
            np.testing.assert_allclose(a.y, b.y, rtol=0, atol=1e-12)
            np.testing.assert_allclose(a.command, b.command, rtol=0, atol=1e-11)


@pytest.mark.parametrize("stepper", ["exact", "rk4"])
def test_two_dead_times_between_samples(stepper):
    """Open loop by superposition of the exact responses to every step of the input."""
    loop = closed_loop(lag(), OPEN, period=PERIOD, longest_delay=1.0, stepper=stepper, substeps=4)
    u = np.random.default_rng(1).normal(size=80)
    for late, later in ((0.37, 0.912), (0.912, 0.37), (0.05, 0.05), (0.999, 0.0)):
        seen = loop.simulate((), one(late=late, later=later), u)
        jumps, at = np.diff(np.r_[0.0, u]), PERIOD * np.arange(80)

        def answer(gain, delay, jumps=jumps, at=at):
            since = np.maximum(at[:, None] - at[None, :] - delay, 0.0)
            return gain * (1 - np.exp(-since / 3.0)) @ jumps

        np.testing.assert_allclose(seen.y, answer(2.0, late) + answer(0.3, later), atol=1e-9)


@pytest.mark.thorough
def test_batches_over_dead_times_and_their_derivative():
    loop = closed_loop(lag(), pid(PERIOD, lower=-1, upper=1), period=PERIOD, longest_delay=1.0)
    times = np.array([0.0, 0.43, 1.0, 1.3])  # the last one is longer than any that may be

    def last(late):
        return loop.simulate(GAINS, one(late=late, later=0.11), 1.0, samples=60).y[-1]

    many = jax.vmap(last)(jnp.asarray(times))
    np.testing.assert_allclose(many[:3], [last(t) for t in times[:3]], rtol=1e-12)
    assert np.isnan(many[3])
    slope = (last(0.43 + 1e-6) - last(0.43 - 1e-6)) / 2e-6
    np.testing.assert_allclose(jax.jit(jax.grad(last))(0.43), slope, rtol=1e-6)


def steam(nodes, openings):
    plain = steam_chamber(nodes=nodes, opening_nodes=openings)
    td = Table("Td", ("u",), (tuple(openings),), "s")
    parameters = tuple(
        Declared("Td", "s", (0.1, 1.0), shape=td.shape) if p.name == "Td" else p for p in plain.parameters
    )
    return replace(plain, parameters=parameters, tables=(*plain.tables, td))


def test_a_dead_time_over_the_input_against_a_tight_solver():
    """Tables over pressure and opening, bilinear by scipy, integrated piece by piece by Radau."""
    nodes, openings = [0.0, 10.0, 20.0], [10.0, 50.0, 100.0]
    k = np.array([[0.9, 0.4, 0.2], [0.8, 0.35, 0.19], [0.7, 0.3, 0.17]])
    a1 = np.array([[40.0, 30.0, 20.0], [35.0, 25.0, 18.0], [30.0, 22.0, 15.0]])
    a2, td = 0.4 * a1, np.array([0.83, 0.44, 0.21])
    u = np.repeat([60.0, 25.0, 80.0, 33.0], 25)
    model = steam(nodes, openings)
    loop = closed_loop(model, OPEN, period=PERIOD, actuator=Actuator(0, 100), substeps=20)
    seen = loop.simulate((), {"k": k, "A1": a1, "A2": a2, "Td": td}, u)

    def table(values, y, opening):
        rows = [np.interp(opening, openings, row) for row in values]
        return np.interp(y, nodes, rows)

    x, ys = np.zeros(2), []
    past = lambda n: u[n] if n >= 0 else 0.0  # noqa: E731
    for n, now in enumerate(u):
        ys.append(x[0])
        count = np.interp(now, openings, td) / PERIOD
        whole = int(np.floor(count + 1e-9))
        share = count - whole
        for length, opening in ((share, past(n - whole - 1)), (1 - share, past(n - whole))):

            def rate(_, s, v=opening):
                return [s[1], (table(k, s[0], v) * v - s[0] - table(a1, s[0], v) * s[1]) / table(a2, s[0], v)]

            if length > 1e-12:
                x = solve_ivp(rate, (0, length * PERIOD), x, method="Radau", rtol=1e-9, atol=1e-11).y[:, -1]
    np.testing.assert_allclose(seen.y, ys, atol=2e-6)
    with pytest.raises(SimulationError, match="only closed loops follow"):
        Simulator.of(model)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: closed_loop(lag(), OPEN, period=PERIOD, longest_delay=-1.0), "longest_delay = -1"),
        (lambda: loop_at(1.2), r"the dead time 'Td' is 1.2; the loop keeps inputs for 1 s"),
        (lambda: loop_at(-0.1), "times of 0 s or more"),
        (
            lambda: closed_loop(steam([0.0, 20.0], [10.0, 90.0]), OPEN, period=PERIOD, stepper="exact"),
            "or its dead time changes",
        ),
        (
            lambda: closed_loop(load(), OPEN, period=PERIOD, input="u", longest_delay=1.0),
            "delays 'v', which this loop does not drive",
        ),
        (
            lambda: closed_loop(seen_late(), OPEN, period=PERIOD, longest_delay=1.0),
            "an output reads a delayed input itself",
        ),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()


def test_a_table_of_dead_time_is_over_the_delayed_input():
    plain = steam_chamber(nodes=[0.0, 20.0], opening_nodes=[10.0, 90.0])
    td = Table("Td", ("x1",), ((0.0, 20.0),), "s")
    parameters = tuple(Declared("Td", "s", shape=td.shape) if p.name == "Td" else p for p in plain.parameters)
    with pytest.raises(ModelError, match="delays by 'Td'"):
        replace(plain, parameters=parameters, tables=(*plain.tables, td))


def loop_at(late):
    return closed_loop(lag(), OPEN, period=PERIOD, longest_delay=1.0).simulate((), one(late=late), 1.0, samples=3)


def load():
    return equations(
        "y' = u + delay(v, Td) - y\nz = y",
        inputs=["u", "v"],
        states=["y"],
        outputs=["z"],
        parameters=["Td"],
        name="load",
    )


def seen_late():
    return equations(
        "y' = u - y\nz = y + delay(u, Td)", inputs=["u"], states=["y"], outputs=["z"], parameters=["Td"], name="seen"
    )
