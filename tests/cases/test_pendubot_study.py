"""The paper's study on the virtual rig: optimum against scipy, runs against the optimum, sections whole, 99 % of a
thousand runs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from plantfit.cases.pendubot.paper_study import METHODS, paper_study
from plantfit.cases.pendubot.sections.paper_section import errata_section, gap_section, record_section, results_section
from plantfit.cases.pendubot.sections.pose_figures import POSES, poses_figure, scheme_figure
from plantfit.cases.pendubot.stagnation import causes, stagnation, valley
from plantfit.cases.pendubot.study_runs import CLOSE, floor_of, method_runs, triangle_of
from plantfit.cases.pendubot.torque import CALM, torque_record, write_record
from plantfit.cases.shared.files import unpack
from plantfit.models.library.pendubot import pendubot_regression
from plantfit.problem import Problem
from plantfit.recording import read
from plantfit.report.case_page import render_case_page
from plantfit.rig import PendubotRig
from plantfit.spec import load


@pytest.fixture(scope="module")
def made():
    return torque_record()


@pytest.fixture(scope="module")
def problem(made):
    return Problem(pendubot_regression(), made.recording)


@pytest.fixture(scope="module")
def floor(problem):
    return floor_of(problem, proven=False)


@pytest.fixture(scope="module")
def swarm(problem, floor):
    return method_runs(problem, floor, "pso", {"population": 50}, 20, 10_000, 3)


def test_the_file_gives_the_study_the_same_record(made, tmp_path):
    write_record(made, tmp_path)
    again = read(tmp_path / "torque.csv")
    assert all(np.array_equal(again[n], made.recording[n]) for n in made.recording.signals)


def test_optimum_is_that_of_scipy_on_all_samples(made, problem, floor):
    """Every sample and physical parameters, from five starts; no compression."""
    model, space, recording = problem.model, problem.space, made.recording
    columns = model.columns({n: recording[n] for n in model.signals})
    rng, ends = np.random.default_rng(5), []
    for _ in range(5):
        start = space.lower + rng.uniform(0.1, 0.9, 6) * (space.upper - space.lower)
        found = least_squares(
            lambda p: columns @ np.array(model.coefficient_values(dict(zip(space.names, p, strict=True))),
                                         dtype=float) - recording["tau1"],
            start, bounds=(space.lower, space.upper), x_scale=space.upper, max_nfev=60,
        )  # fmt: skip
        ends.append(np.sqrt(np.mean(found.fun**2)))
    assert floor.rmse <= min(ends) * (1 + 1e-9)
    assert min(ends) < floor.rmse * (1 + 1e-5)


def test_gaps_are_not_negative_and_refined_by_least_squares(problem, floor, swarm):
    assert np.all(swarm.gap > -1e-9)
    assert swarm.share_close[0] == 1.0
    found = stagnation(problem, floor, swarm, 10_000)
    assert found.refined > 0.5
    assert found.distance > 0.05  # far from the optimum at almost the same misfit
    other = replace(found, refined=0.5)
    told = causes({"PSO": replace(found, refined=0.8), "SSA": replace(found, refined=1.0, last=0.9), "CGA": other})
    assert sum("least squares does not come within" in s for s in told) == 2
    assert any("SSA: half of the runs still improved after 90 % of the budget" in s for s in told)
    assert len(set(told)) == len(told)
    both = causes({"PSO": replace(found, refined=1.0, last=0.3), "CGA": replace(found, refined=1.0, last=0.4)})
    assert len(both) == 2  # one sentence for both, not one for each
    assert (
        "PSO and CGA: half of the runs made their last improvement above 1e-07 in the first 30 % and 40 % of the budget"
        in both[1]
    )


def test_every_run_of_bounded_least_squares_reaches_the_optimum(problem, floor):
    found = method_runs(problem, floor, "least_squares", {"agree": 3}, 20, 5000, 3)
    assert np.all(np.abs(found.gap) < 1e-6)


def test_width_of_the_valley_is_where_the_gap_is_reached(problem, floor):
    """Across the valley the misfit grows to CLOSE at the width told; triangle and samples agree there."""
    z = problem.space.cube([floor.values[n] for n in problem.space.names])
    residuals, jacobian = problem.compressed(z)
    direction = np.linalg.svd(jacobian)[2][0]
    step = valley(problem, floor).across
    quadratic = np.mean((residuals + jacobian @ (step * direction)) ** 2) - 2 * np.mean(
        residuals * (jacobian @ (step * direction))
    )
    assert np.sqrt(quadratic) == pytest.approx(floor.rmse * (1 + CLOSE), rel=1e-9)
    assert triangle_of(problem).n == len(next(iter(problem.experiments.values())).recording)


def test_sections_are_whole_and_make_a_page(made, problem, floor, swarm):
    sections = [
        record_section(made, floor),
        results_section(made, problem, floor, [swarm]),
        gap_section([swarm], ["told"]),
        errata_section(),
    ]
    assert json.loads(json.dumps(sections, allow_nan=False)) == sections
    for section in sections:
        for table in section.get("tables", ()):
            assert all(len(row) == len(table["columns"]) for row in table["rows"])
    page = render_case_page({"title": "t", "subtitle": "s", "sections": sections})
    assert "Virtual rig: tables 2 to 4" in page
    assert "888.4771" in page  # the paper's seconds for a run of PSO


def test_the_poses_are_the_papers_and_y_leads_through_them(made):
    """Equation 16 at rest: (b2 + b3)/b2 (theta1 - pi/2) + theta2, with link 2 on end in every pose."""
    recording, truth = made.run.recording, made.run.truth
    b, l1 = truth["base"], truth["constants"]["l1"]
    figure = poses_figure(recording, b, l1, truth["constants"]["g"])
    [y] = [line for line in figure["data"] if line.get("name") == "y_f"]
    chains = [line for line in figure["data"] if line.get("hovertemplate", "").startswith("at ")]
    assert len(chains) == len(POSES)
    for time, theta1, chain in zip(POSES, np.pi / 2 + np.array([0.0, 1.0, -1.0]) * np.pi / 6, chains, strict=True):
        expected = (b["b2"] + l1 * b["b5"]) / b["b2"] * (theta1 - np.pi / 2) + (np.pi / 2 - theta1)
        assert np.interp(time, y["x"], y["y"]) == pytest.approx(expected, abs=2e-4)
        assert chain["x"][1] == pytest.approx(l1 * np.cos(theta1), abs=1e-4)
        assert chain["x"][2] == pytest.approx(chain["x"][1], abs=1e-4)  # link 2 on end
    names = {note["text"] for note in scheme_figure(truth["parameters"])["layout"]["annotations"]}
    assert {"theta2", "l1", "l2", "m1, I1 at lc1", "m2, I2 at lc2"} <= names


@pytest.mark.slow
def test_a_thousand_tuned_runs_of_each_method_come_within_a_thousandth(made, tmp_path):
    folder = unpack("pendubot", tmp_path / "pendubot")
    write_record(made, folder)
    study = load(folder / "torque.toml")
    assert study.plan.budget == 50 * 200
    optimum = floor_of(study.problem)
    for method in METHODS:
        found = method_runs(
            study.problem, optimum, method, study.plan.settings[method], 1000, study.plan.budget, study.plan.seed
        )
        assert found.share_close[0] >= 0.99, (method, found.share_close)
    exact = method_runs(study.problem, optimum, "least_squares", {"agree": 1}, 1000, study.plan.budget, study.plan.seed)
    # one descent alone ends in another minimum, 1.4e-4 above, in 12 of 100 runs
    assert np.mean(np.abs(exact.gap) < 1e-6) >= 0.8
    assert np.max(exact.gap) < 1e-3


@pytest.mark.slow
def test_tuned_runs_on_the_calm_record(tmp_path):
    """PSO and CGA reach 99 % of a thousand; SSA falls short of it, but is far above its default settings."""
    folder = unpack("pendubot", tmp_path / "pendubot")
    write_record(torque_record(weights=PendubotRig().weights), folder, CALM)
    study = load(folder / "calm.toml")
    optimum = floor_of(study.problem)

    def share(method, settings):
        return method_runs(
            study.problem, optimum, method, settings, 1000, study.plan.budget, study.plan.seed
        ).share_close[0]

    assert study.plan.budget == 50 * 200
    assert share("pso", study.plan.settings["pso"]) >= 0.99
    assert share("cga", study.plan.settings["cga"]) >= 0.99
    assert share("salp_swarm", study.plan.settings["salp_swarm"]) >= max(
        0.75, share("salp_swarm", {"population": 50}) + 0.03
    )


@pytest.mark.slow
def test_the_small_demo_tells_its_story(made, tmp_path):
    folder = unpack("pendubot", tmp_path / "pendubot")
    write_record(made, folder)
    study = paper_study(folder / "torque.toml", made, 20, 10, 10)
    calm = next(s for s in study.sections if "calmer" in s["title"])
    rows = {row[0]: row for row in calm["tables"][0]["rows"]}
    assert rows["bounded least squares"][5] == "100.0 %"
    assert float(rows["SSA as printed"][2]) > float(rows["PSO"][2])
