"""The chamber as one plant, its linear models and the table of sensitivities."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.cases.steam.closed_loop import linear_model
from plantfit.cases.steam.problems import dynamic_problem
from plantfit.cases.steam.sections.screening_section import GROUPS, PAPER, screening_section
from plantfit.cases.steam.whole_plant import FINE, plants_of, true_plant, whole_plant
from plantfit.rig.steam_chamber import OPENINGS, SteamChamberRig, simulated, smooth_truth
from plantfit.simulate.loop.closed_loop import Controller, closed_loop

OPEN = Controller(lambda y, p: (), lambda state, y, reference, p: (state, reference))


def truth_point(problem):
    """The rig's truth as a cube point."""
    values = {}
    for c in problem.space.coordinates:
        table = smooth_truth(float(c.recording.removeprefix("opening")))[c.parameter]
        values[c.name] = float(table[c.index]) if c.index else float(table)
    return problem.space.cube(problem.space.vector(values))


@pytest.fixture(scope="module")
def problem():
    rig = SteamChamberRig()
    return dynamic_problem({f"opening{u}": rig.record(u, 1, duration=8.0).recording for u in OPENINGS}, weighted=True)


def test_the_whole_plant_steps_as_the_rig_does(problem):
    """A step to an opening of the records in an open loop: that of the rig's own simulator, tables of that opening
    alone."""
    loop = closed_loop(whole_plant(), OPEN, period=0.1, output="y", input="u", substeps=4)
    plants = plants_of(problem, [truth_point(problem)])
    for opening in (10.0, 50.0):
        t = 0.1 * np.arange(600)
        own = simulated(smooth_truth(opening), t, np.full(600, opening), 8)
        # the plant's tables at a valve between 0 and 10 % are those of 10 %
        seen = loop.simulate((), {n: v[0] for n, v in plants.items()}, np.full(600, opening))
        np.testing.assert_allclose(seen.y, own, atol=2e-3)


def test_linear_models_have_the_gain_of_the_static_curve():
    plant = {n: v[0] for n, v in true_plant(smooth_truth, OPENINGS).items()}
    found = linear_model(plant)
    assert found is not None
    linear, late = found
    u = float(linear.u0[0])

    def rest(v):
        y = 15.0
        for _ in range(200):
            y = np.interp(v, OPENINGS, [np.interp(y, np.linspace(0, 20, 10), k) for k in plant["k"].T]) * v
        return y

    assert rest(u) == pytest.approx(15.0, abs=1e-6)
    gain = float((linear.C @ np.linalg.solve(-linear.A, linear.B))[0, 0])
    assert gain == pytest.approx((rest(u + 1e-4) - rest(u - 1e-4)) / 2e-4, rel=1e-4)
    assert late == pytest.approx(np.interp(u, OPENINGS, plant["Td"]))
    assert true_plant(smooth_truth)["k"].shape == (1, 10, len(FINE))


def test_table_3_has_a_row_for_each_method_and_group(problem):
    z = truth_point(problem)
    section = screening_section(problem, {"CMA-ES": z, "L-BFGS-B, exact": z})
    rows = section["tables"][0]["rows"]
    assert [r[:2] for r in rows] == [[m, g] for m in ("CMA-ES", "L-BFGS-B, exact") for g in GROUPS]
    assert rows[2][4] == "0.07307" == f"{PAPER['cmaes'][2][0]:.4g}"
    assert rows[4][4] == "–"  # noqa: RUF001  (the paper has no exact derivatives)
