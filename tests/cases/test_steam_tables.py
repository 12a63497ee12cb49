"""The steam page's section on tables: its figure of visits, and the whole on four openings."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.cases.steam.sections.tables_figures import LOOKS, visits_figure
from plantfit.cases.steam.sections.tables_section import SURFACE, tables_section
from plantfit.fitting import fit
from plantfit.report.case_page import render_case_page
from plantfit.rig.offered import record_rig
from plantfit.rig.steam_chamber import TABLES, SteamChamberRig
from plantfit.spec import load
from plantfit.trust.stated_errors.parameter_uncertainty import propagate


def test_figure_of_visits_leaves_unvisited_nodes_empty():
    samples = np.tile(np.r_[np.full(7, 100), 0, 0, 0], (2, 1))
    statuses = {n: [["determined"] * 7 + ["not visited"] * 3] * 2 for n in TABLES}
    made = visits_figure(samples, statuses, [10.0, 50.0])
    assert made["data"][0]["z"][0] == [2.0, 2.0]
    assert made["data"][0]["z"][8] == [None, None]
    assert made["data"][1]["z"][8] == [list(LOOKS).index("not visited")] * 2


@pytest.mark.slow
def test_shared_surface_predicts_what_is_determined_and_the_page_says_what_is_not():
    runs = SteamChamberRig().records(3, (40, 50, 70, 100))
    truth = {n: np.array([r.truth["parameters"][n] for r in runs.values()]) for n in TABLES}
    made = tables_section({n: r.recording for n, r in runs.items()}, truth, every=20)
    compared, blind, errors = made["tables"]
    assert [row[-1] for row in compared["rows"][:3]] == ["cannot"] * 3
    surface = next(row for row in errors["rows"] if row[0] == SURFACE)
    assert float(surface[-1]) < 6.0  # (k u - y)/A1, which the records determine
    assert float(surface[1]) > 2.0 * float(surface[-1])  # k, which they do not
    assert len(blind["columns"]) == 5
    assert "What the tables mean" in render_case_page({"title": "steam", "sections": [made]})


@pytest.mark.slow
def test_a_valve_that_moves_under_pressure_tells_k_a1_and_a2_apart(tmp_path):
    """docs/operating-point-tables.md: of one step few of 31 are determined, of openings that change under pressure
    most, and they hold."""
    openings = "10%,25%,15%,35%,20%,45%,30%,46%,20%,40%,5%"
    made = record_rig("steam_chamber", {"tables_of": 40}, seed=3, excitation=openings, duration=660.0)
    study = load(made.save(tmp_path / "moved.csv", study=True)["study"])
    answer = fit(study.problem, "least_squares", budget=study.plan.budget, seed=1, errors=study.errors)
    rows = answer.findings["parameters"]
    assert sum(r["status"] == "determined" for r in rows) >= 21
    combined = propagate(answer.problem, answer, study.errors).combined
    true = {n: np.ravel(d["value"]) for n, d in made.truth["determined"].items()}
    z = [
        (r["value"] - true[r["parameter"]][r["index"][0] if r["index"] else 0]) / s
        for r, s in zip(rows, combined, strict=True)
    ]
    known = np.array([v for v, r in zip(z, rows, strict=True) if r["status"] == "determined"])
    assert np.sum(np.abs(known) > 1.96) <= 4  # of 24; five or more in 1 of 80 times
    assert np.max(np.abs(known)) < 4.0
