"""Ends of open ranges: the data set them, and neither the room in which they are followed nor a refit that was lost."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks import coverage

NAME = "motor by speed"


def false_ends(seeds):
    """How many parameters are open, and the ends that are told of them: there are none but a largest Kb."""
    still_open, ended = 0, []
    for seed, rows in zip(seeds, coverage.fits(NAME, seeds), strict=True):
        for name, (status, low, high, value) in rows.items():
            if status == "determined":
                continue
            still_open += 1
            if low is not None and low > 1e-9 * value:
                ended.append((seed, name, "low", low))
            if status != "flat" and name != "Kb":
                ended.append((seed, name, "high", high))
    return still_open, ended


@pytest.mark.parametrize("seed", [2, 3, 10])
@pytest.mark.further(1)
def test_what_voltage_and_speed_leave_open_has_no_end(seed):
    """Kt/(L*J), R/L + b/J and (R*b + Kt*Kb)/(L*J) are all that is known: an inertia as small as you like goes with a
    large inductance and little friction. It was "Jm is at least 1.71e-9": the torque constant stood at the edge of the
    room there; and "Cm: the data allow 0 to 0.026", where the linear problem ends, and no refit had come."""
    still_open, ended = false_ends([seed])
    assert still_open >= 6
    assert ended == []


@pytest.mark.parametrize("seed", [4, 7, 8, 11])
@pytest.mark.further(1)
def test_a_friction_near_zero_may_grow_by_decades_and_take_what_the_motor_constant_gives(monkeypatch, seed):
    """Kb + R*b/Kt is known, and b stands at 1e-8. It was "Kb = 0.0916, determined" in a quiet record, and 0 to 0.038:
    by its logarithm b seems to do nothing."""
    monkeypatch.setitem(coverage.RIGS, NAME, replace(coverage.RIGS[NAME], noise=0.05))
    [rows] = coverage.fits(NAME, [seed])
    status, low, high, _ = rows["Kb"]
    assert status in ("weak", "flat")
    assert low == 0.0
    assert high > coverage.MOTOR["Kb"]


@pytest.mark.parametrize("seed", [3, 9, 12])
@pytest.mark.thorough
def test_a_cost_that_is_flat_up_to_a_wall_ends_at_the_wall(seed):
    """Kb has an end at about 0.092, up to which others make up for it. As of a parabola the end was told where a
    quarter of the way from the last place inside to the first outside were: 0 to 0.0775, and the truth is 0.09."""
    [rows] = coverage.fits(NAME, [seed])
    _, low, high, _ = rows["Kb"]
    assert low <= coverage.MOTOR["Kb"] <= high


@pytest.mark.slow
def test_of_forty_motors_one_end_in_a_hundred_at_most_is_false():
    still_open, ended = false_ends(range(21, 61))
    assert still_open >= 250
    assert len(ended) <= 5, ended
