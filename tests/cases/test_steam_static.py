"""The static task and the sections of its page, on short records of the rig."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lsim

from plantfit.cases.steam.problems import opening_costs, static_problem
from plantfit.cases.steam.sections.static_section import static_section
from plantfit.cases.steam.sections.uncertainty_section import (
    constant_uncertainty,
    pressure_budget,
    table_uncertainty,
    uncertainty_section,
    zero_left_in,
)
from plantfit.cases.steam.static_task import (
    STEP,
    DeadTimeHeld,
    as_long_as,
    beginning,
    delay_study,
    early_dead_times,
    joint,
    two_step,
    two_step_by,
)
from plantfit.report.case_page import render_case_page
from plantfit.rig.steam_chamber import SteamChamberRig

import jax.numpy as jnp


@lru_cache(maxsize=1)
def rig_runs():
    rig = SteamChamberRig(noise=0.01)
    return {(r := rig.record(u, 2, duration)).recording.name: r for u, duration in ((60, 40.0), (100, 30.0))}


@lru_cache(maxsize=1)
def fitted():
    recordings = {n: r.recording for n, r in rig_runs().items()}
    return recordings, joint(recordings), two_step(recordings)


def test_the_static_model_is_the_transfer_function_of_the_paper():
    recording = rig_runs()["opening60"].recording
    problem = static_problem({"step": recording})
    p = {"k": 0.3, "A1": 25.0, "A2": 20.0, "Td": 0.5}
    y = problem.predict(problem.space.vector({f"{n}[step]": v for n, v in p.items()}))["y"]
    late = np.where(recording.t >= 0.5, 60.0, 0.0)
    fine = np.linspace(0, 60, 60001)
    _, reference, _ = lsim(([p["k"]], [p["A2"], p["A1"], 1.0]), 60.0 * (fine >= 0.5), fine)
    np.testing.assert_allclose(y, np.interp(recording.t, fine, reference), atol=2e-3)
    assert late[4] == 0.0


def test_the_joint_fit_is_as_good_as_scipy_finds_from_many_starts():
    _, found, _ = fitted()
    recording = rig_runs()["opening100"].recording
    t, y = recording.t[1:], recording["y"][1:]

    def off(p):
        k, a1, a2, late = p
        roots = np.roots([a2, a1, 1.0]).astype(complex)
        s = np.maximum(t - late, 0.0)
        shape = 1.0 + (roots[1] * np.exp(roots[0] * s) - roots[0] * np.exp(roots[1] * s)) / (roots[0] - roots[1])
        return 100.0 * k * np.real(shape) - y

    rng, box = np.random.default_rng(0), (np.array([0.1, 0.1, 0.1, 0.0]), np.array([20.0, 1000.0, 1000.0, 1.0]))
    starts = [np.array([0.2, 45.0, 15.0, 0.5]) * rng.uniform(0.6, 1.4, 4) for _ in range(6)]
    best = min(np.mean(least_squares(off, s, bounds=box).fun ** 2) for s in starts)
    assert found.costs["opening100"] == pytest.approx(best, rel=1e-4)


def test_two_steps_cost_a_little_more_and_hold_the_dead_time():
    recordings, whole, steps = fitted()
    assert whole.total <= steps.total * (1 + 1e-9)
    assert steps.total < 1.3 * whole.total
    assert all(c["Td"] >= 0.1 for c in steps.constants.values())
    problem = static_problem(recordings)
    z = problem.space.cube([steps.constants[str(c.recording)][c.parameter] for c in problem.space.coordinates])
    assert sum(opening_costs(problem, z).values()) == pytest.approx(steps.total, rel=1e-9)


def test_other_methods_reach_the_same_cost():
    recordings, _, steps = fitted()
    few = {"opening100": recordings["opening100"]}
    found = two_step_by(few, "lbfgsb", runs=2, budget=800, seed=1)
    assert found.runs.shape == (1, 2)
    assert found.total == pytest.approx(steps.costs["opening100"], rel=0.02)


def test_searches_with_the_dead_time_held_share_programs_and_keep_the_costs_of_their_own_problem():
    recordings, late = fitted()[0], {"opening60": 0.43, "opening100": 0.7312}
    longest = recordings["opening60"]
    held = DeadTimeHeld(static_problem({STEP: longest}))
    z = np.random.default_rng(0).uniform(0.0, 0.3, (5, 3))
    for name, recording in recordings.items():
        filled = as_long_as(recording, longest)
        assert len(filled.t) == len(longest.t)
        assert np.all(np.abs(np.diff(filled.t) - 0.1) < 1e-9)
        shared = held.objective(static_problem({STEP: filled}, dead_time=late[name]), late[name])
        own = static_problem({STEP: recording}, dead_time=late[name])
        np.testing.assert_allclose(shared.costs(jnp.asarray(z)), own.costs(z), rtol=1e-14)
        assert shared.value_and_gradient is not None
        (f, g), (own_f, own_g) = shared.value_and_gradient(z[0]), own.value_and_gradient(z[0])
        assert f == pytest.approx(own_f, rel=1e-14)
        np.testing.assert_allclose(g, own_g, rtol=1e-12)
    programs = [held.free.compiled[n]._programs for n in ("costs", "values_and_gradients")]
    assert [len(p) for p in programs] == [1, 1]


def test_early_dead_times_hold_the_truth():
    recordings, _, _ = fitted()
    for name, found in early_dead_times(recordings).items():
        low, high = found.interval
        assert low <= rig_runs()[name].truth["parameters"]["Td"] <= high
        assert high - low < 0.25
    assert len(beginning(recordings["opening60"])) == 21


def test_a_study_of_delays_tells_coverage_and_width():
    found = delay_study(0.002, 16, 60.0, range(4))
    assert found.coverage >= 0.5
    assert found.half_width < 0.05
    assert abs(found.bias) < 0.02
    assert found.told == 1.0


@pytest.mark.thorough
def test_the_page_says_what_was_found():
    recordings, whole, steps = fitted()
    truth = {n: r.truth["parameters"] for n, r in rig_runs().items()}
    static = static_section(
        [whole, steps], early_dead_times(recordings), truth, [delay_study(0.002, 16, 60.0, range(2))]
    )
    constants = constant_uncertainty(recordings["opening100"])
    tables = table_uncertainty(recordings["opening100"], steps.constants["opening100"])
    section = uncertainty_section("100", tables, ["k[7]", "Td"], zero_left_in(recordings["opening100"]), constants)
    assert pressure_budget().expanded() == pytest.approx(0.1424, abs=5e-5)
    rng = np.random.default_rng(4)
    drawn = np.abs(rng.uniform(-0.039, 0.039, 200_000) + rng.uniform(-0.117, 0.117, 200_000))
    table = next(t for t in section["tables"] if "table 4" in t["caption"])
    for row in table["rows"]:
        # the paper's 68, 95, 99.7 %
        assert float(row[3].rstrip(" %")) == pytest.approx(float(row[2].rstrip(" %")), abs=0.5)
        assert float(row[5].rstrip(" %")) == pytest.approx(100 * np.mean(drawn < float(row[4])), abs=0.3)
    assert section["tables"][0]["rows"][-1][6] == "0.1424"
    assert [row[0] for row in section["tables"][-1]["rows"]] == ["k[7]", "Td"]
    gain = next(i for i, n in enumerate(constants.names) if n.startswith("k"))
    limit = np.sqrt(0.002**2 + 0.006**2) / np.sqrt(6)  # two triangles, in shares
    shown = np.sqrt(
        sum(constants.systematic[f"{n}, span"][gain] ** 2 for n in ("pressure transducer", "analog input card"))
    )
    assert shown == pytest.approx(constants.values[gain] * limit, rel=1e-3)
    page = render_case_page({"title": "x", "sections": [static, section]})
    assert "0.1424" in page


@pytest.mark.slow
def test_the_whole_static_task_by_the_papers_methods():
    recordings = {n: r.recording for n, r in SteamChamberRig().records(1).items()}
    reference = two_step(recordings)
    assert reference.total == pytest.approx(0.3442, rel=0.03)
    totals = [two_step_by(recordings, m, runs=10, budget=n).total for m, n in (("lbfgsb", 400), ("cmaes", 2000))]
    assert totals[0] == pytest.approx(totals[1], rel=0.01)
    assert totals[0] == pytest.approx(reference.total, rel=0.02)
