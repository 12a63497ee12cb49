"""Recordings of several lengths are simulated by one program, with the bits that each has alone."""

from typing import Any

import numpy as np
import pytest

from plantfit.models import equations
from plantfit.models.model import Declared
from plantfit.problem import Problem, checked_cost
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.check import tight
from plantfit.simulate.records.of_one_length import as_long_as_others
from plantfit.simulate.simulator import Drive

LENGTHS = {"long": 90, "short": 31, "middle": 50}


def problem(hold, lengths=LENGTHS, late="delay(u, L)", **settings):
    box = {"K": (0.1, 5.0), "tau": (0.1, 5.0), "L": (0.0, 1.0)}
    model = equations(
        f"x' = (K*{late} - x - 0.1*x^3)/tau; y = exp(0.1*x) + 0.01*u",
        inputs={"u": None},
        states={"x": None},
        outputs={"y": None},
        parameters={n: Declared(n, None, b) for n, b in box.items() if n in ("K", "tau") or "L" in late},
        name="late",
    )
    records = {}
    for k, (name, n) in enumerate(lengths.items()):
        t, rng = 0.1 * np.arange(n), np.random.default_rng(k)
        u = np.repeat(rng.random(-(-n // (3 + k))), 3 + k)[:n]
        records[name] = Recording(t, {"u": Signal(u, None), "y": Signal(rng.random(n), None)}, name)
    return Problem(model, records, hold={"u": hold}, **settings)


@pytest.mark.parametrize("hold", ["previous", "linear"])
@pytest.mark.further(1)
def test_one_program_serves_all_and_its_bits_are_those_of_each_alone(hold):
    made, values = problem(hold), np.array([1.3, 0.7, 0.234])
    program = made.compiled["outputs"]
    for name, n in LENGTHS.items():
        y = made.predict(values, name)["y"]
        assert y.shape == (n,)
        np.testing.assert_array_equal(y, program(made.space.tree(values, name), made.parts.whole[name])["y"])
    made = problem(hold)
    for name in LENGTHS:
        made.predict(values, name)
    assert len(made.compiled["outputs"]._programs) == 1


def test_a_recording_much_shorter_than_another_keeps_its_own_length():
    drives = problem("previous", {"long": 400, "short": 31}).parts.whole
    assert as_long_as_others(drives["short"], drives.values()) is drives["short"]
    assert len(as_long_as_others(drives["short"], [drives["short"]]).t) == 31


def test_times_of_its_own_keep_their_number():
    drives = problem("previous", late="u", initial_time=-1.0).parts.whole
    assert isinstance(drives["short"], Drive)
    assert as_long_as_others(drives["short"], drives.values()) is drives["short"]


@pytest.mark.parametrize("hold", ["previous", "linear"])
@pytest.mark.parametrize("late", [0.0, 0.234, 1.0])  # 1.0: edges that fall behind the end of a short record
@pytest.mark.thorough
def test_the_tight_solver_follows_all_by_one_program_with_the_bits_of_each_alone(hold, late):
    made = problem(hold)
    simulator, drives = made.predictor.stepping(), {n: made.data["drive"][n] for n in LENGTHS}
    p = {"K": 1.3, "tau": 0.7, "L": late}
    program: Any = tight._compiled(simulator).record
    for drive in drives.values():
        alone = tight.follow(simulator, p, drive)
        beside = tight.follow(simulator, p, drive, others=drives.values())
        assert alone.stopped is beside.stopped is None
        np.testing.assert_array_equal(alone.states, beside.states)
        np.testing.assert_array_equal(alone.outputs["y"], beside.outputs["y"])
    program.clear_cache()
    for drive in drives.values():
        tight.follow(simulator, p, drive, others=drives.values())
    assert len(program._programs) == 1


@pytest.mark.thorough
def test_a_cost_is_checked_by_one_program_for_records_of_all_lengths():
    made = problem("previous")
    program: Any = tight._compiled(made.predictor.stepping()).record
    program.clear_cache()
    checked_cost(made, np.full(made.space.dimension, 0.4))
    assert len(program._programs) == 1
