"""Ends of open ranges: the data set them, and neither the room in which they are followed nor a refit that was lost."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks import coverage

NAME = "motor by speed"


def lower_ends(seeds):
    """How many parameters are called flat, and those of them that have a lower end."""
    flat, ended = 0, []
    for seed, rows in zip(seeds, coverage.fits(NAME, seeds), strict=True):
        for name, (status, low, _, value) in rows.items():
            flat += status == "flat"
            if status == "flat" and low is not None and low > 1e-9 * value:
                ended.append((seed, name, low))
    return flat, ended


@pytest.mark.parametrize("seed", [2, 10])
def test_what_voltage_and_speed_leave_open_has_no_lower_end(seed):
    """Kt/(L*J), R/L + b/J and (R*b + Kt*Kb)/(L*J) are all that is known: an inertia as small as you like goes with a
    large inductance and little friction. It was "Jm is at least 1.71e-9": the torque constant stood at the edge of the
    room there."""
    flat, ended = lower_ends([seed])
    assert flat >= 4
    assert ended == []


@pytest.mark.slow
def test_of_twenty_motors_one_range_in_fifty_at_most_has_a_false_end():
    flat, ended = lower_ends(range(1, 21))
    assert flat >= 95
    assert len(ended) <= 2, ended
