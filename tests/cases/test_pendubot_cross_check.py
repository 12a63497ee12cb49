"""One record of the virtual pendubot backwards and forwards, and the section that tells of it."""

import numpy as np
import pytest

from plantfit.cases.pendubot.cross_check import ForwardFit, cross_check, forward_fit, inverse_fit
from plantfit.cases.pendubot.sections.cross_check_section import cross_check_section
from plantfit.estimate import Estimate
from plantfit.report.case_page import render_case_page
from plantfit.rig import PendubotRig

RIG = PendubotRig()
TRUTH = np.array(list(RIG.base.values()))


def test_the_section_says_in_words_and_numbers_what_differs():
    inverse = inverse_fit(RIG.record(seed=2).recording, RIG)
    e = inverse.estimate
    forward = Estimate(e.names, e.values + 5.0 * e.standard_error * [0, 1, 0, 0], 0.49 * e.covariance)
    section = cross_check_section(inverse, ForwardFit(forward, 0.31, ()), RIG.base)
    told = " ".join(section["sentences"])
    assert "Plain least squares differs from instrumental variables" in told
    assert "The inverse fit differs from the forward fit by more than chance" in told
    assert "most in b2" in told
    assert "are 0.7 of the inverse fit's" in told
    assert "0.31 encoder steps" in told
    assert "Against the truth the inverse fit is off by" in told
    assert "of its standard errors at most (b2)" in told
    assert "more than 3 is no chance" in told  # forward: planted five standard errors off
    calm = cross_check_section(inverse, ForwardFit(Estimate(e.names, TRUTH, e.covariance), 0.31, ()), RIG.base)
    assert "no chance" not in " ".join(calm["sentences"])
    rows = section["tables"][0]["rows"]
    assert [row[0] for row in rows] == ["b1", "b2", "b4", "b5"]
    assert float(rows[1][8]) == pytest.approx(25.0 / 1.49, rel=0.01)
    page = render_case_page({"title": "Pendubot", "sections": [section]})
    assert "Backwards and forwards (virtual rig)" in page


@pytest.mark.slow
def test_the_pendubot_has_the_same_parameters_forwards_and_backwards():
    record = RIG.record(seed=3).recording
    forward, inverse = forward_fit(record), inverse_fit(record, RIG)
    d = forward.estimate.values - TRUTH
    assert d @ np.linalg.solve(forward.estimate.covariance, d) < 18.5  # 0.1 % of chi-squared with 4 degrees of freedom
    assert np.all(forward.estimate.standard_error < [2e-3, 0.03, 5e-5, 0.03] * TRUTH)
    assert 0.27 < forward.rmse < 0.35  # rounding leaves 0.29 steps
    assert cross_check(inverse.estimate, forward.estimate).p_value > 1e-3
