"""Substeps of a model that reads tables are a loop: the same bits as written out, from a program of one size."""

import numpy as np
import pytest

import plantfit.simulate.steps.intervals as intervals
from plantfit.cases.steam.dynamic_runs import finely
from plantfit.cases.steam.problems import dynamic_problem
from plantfit.rig.steam_chamber import SteamChamberRig

import jax


def problem(steps):
    rig = SteamChamberRig()
    made = {(r := rig.record(u, 2, seconds)).recording.name: r.recording for u, seconds in ((60, 8.0), (100, 6.0))}
    return finely(dynamic_problem(made), steps)


def functions(steps):
    made = problem(steps)
    z = np.random.default_rng(1).random((3, made.space.dimension))
    return made, {
        "residuals": z[0],
        "blocks": z[0],
        "costs": z,
    }


def bits(steps):
    made, given = functions(steps)
    found = [made.compiled[name](z, made.arguments) for name, z in given.items()]
    return [np.asarray(a) for a in jax.tree.leaves(found)]


def size(name, steps):
    """Characters of the program before XLA, in which native loops are one call each."""
    made, given = functions(steps)
    return len(str(jax.make_jaxpr(getattr(made.evaluator, name))(given[name], made.arguments)))


@pytest.mark.parametrize("steps", [2, 5])
@pytest.mark.thorough
def test_the_bits_are_those_of_substeps_that_are_written_out(monkeypatch, steps):
    looped = bits(steps)
    monkeypatch.setattr(intervals, "UNROLLED_TABLES", intervals.UNROLLED)
    for a, b in zip(looped, bits(steps), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["residuals", "blocks", "costs"])
def test_programs_do_not_grow_with_the_substeps(name):
    assert size(name, 8) < 1.1 * size(name, 2)


def test_only_what_is_pulled_back_is_written_out():
    """Pulled back, a loop is slower by a third."""
    stepping = problem(8).predictor.stepping()
    assert intervals._written_out(stepping, pulled=True) == intervals.UNROLLED
    assert intervals._written_out(stepping, pulled=False) == intervals.UNROLLED_TABLES == 1
