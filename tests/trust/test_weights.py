"""Scales that a user gave are held, the others are estimated, and everyone is told who chose them."""

import json

import numpy as np
import pytest
from test_agreement import two_outputs

from plantfit.errors import SpaceError
from plantfit.findings import read_findings
from plantfit.fitting import fit
from plantfit.problem.measure.scale_source import GIVEN, SPREAD, UNIT, ScaleSource
from plantfit.report import summary_text, write_report


@pytest.mark.parametrize(
    ("given", "held", "estimated"),
    [({"y": 0.2, "w": 3.0}, {"y": 0.2, "w": 3.0}, {}), ({"w": 3.0}, {"w": 3.0}, {"y": 0.05}), (None, {}, {"y": 0.05, "w": 0.4})],
)
def test_given_scales_are_held_and_missing_ones_estimated(given, held, estimated, tmp_path):
    problem = two_outputs(given)
    assert {o: s for o, s in problem.scale_sources.items()} == {o: GIVEN if o in held else SPREAD for o in ("y", "w")}
    found = fit(problem, seed=1)
    assert {o: found.problem.scales[o] for o in held} == held  # to the bit
    assert {o: found.problem.scales[o] for o in estimated} == pytest.approx(estimated, rel=0.15)
    rows = {row["output"]: row for row in found.findings["weights"]}
    for o in ("y", "w"):
        assert rows[o]["scale"] == found.problem.scales[o]
        assert rows[o]["who"] == ("given" if o in held else f"estimated from the residuals in {rows[o]['rounds']} rounds")
    # with the scales in force the residuals of each output are what the scores say
    rmse = found.score("fit")
    expected = np.mean([(rmse[o] / found.problem.scales[o]) ** 2 for o in ("y", "w")])
    assert found.best.cost == pytest.approx(expected, rel=1e-6)
    [sentence] = [v["sentence"] for v in found.findings["verdict"] if "count as 1" in v["sentence"]]
    text, page = summary_text(found.findings), write_report(found.findings, tmp_path / "r.html").read_text()
    for o in ("y", "w"):
        assert f"{o} {found.problem.scales[o]:.3g} ({rows[o]['who']})" in sentence
        assert rows[o]["who"] in text
        assert rows[o]["who"] in page


def test_given_scales_change_the_answer():
    """Squares of the state weigh nothing in one fit, and almost all in the other."""
    light, heavy = (fit(two_outputs({"y": 0.05, "w": w}), seed=1) for w in (100.0, 0.001))
    assert light.score("fit")["y"] < heavy.score("fit")["y"]
    assert heavy.score("fit")["w"] < light.score("fit")["w"]


def test_estimated_scales_are_stable_and_do_not_depend_on_the_units():
    found = fit(two_outputs(), seed=1)
    assert all(source.settled and source.kind == "residuals" for source in found.problem.scale_sources.values())
    assert {o: found.score("fit")[o] for o in ("y", "w")} == pytest.approx(dict(found.problem.scales), rel=1e-4)


def test_one_output_and_variants_keep_who_chose():
    problem = two_outputs({"w": 3.0})
    assert problem.with_scales({"y": 1.0}).scale_sources == {"y": GIVEN, "w": GIVEN}
    estimated = ScaleSource("residuals", 3)
    assert problem.with_scales({"y": 1.0}, estimated).scale_sources == {"y": estimated, "w": GIVEN}
    assert problem.scale_sources == {"y": SPREAD, "w": GIVEN}
    assert problem.with_simulator(problem.predictor.stepping().refined(2)).scale_sources == problem.scale_sources
    with pytest.raises(SpaceError, match="scales names 'z'"):
        two_outputs({"z": 1.0})
    assert UNIT.kind == "unit"


def test_findings_made_before_there_were_weights_still_load():
    record = json.loads(json.dumps(fit(two_outputs(), seed=1).findings))
    for row in record["runs"]:
        del row["ended"]
    del record["weights"], record["agreement"]
    old = read_findings(record)
    assert old.weights == []
    assert old.agreement is None
    assert "count as 1" not in summary_text({**record, "verdict": []})
