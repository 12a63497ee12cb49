"""Static models: robust standard errors where rows are samples with correlated residuals, classical ones else."""

import numpy as np
import pytest
from scipy.signal import lfilter

import plantfit as pf

TRUTH = {"a": 1.0, "b": 2.0}
N = 200


def line(seed, memory, period=0.1, time=None, **options):
    """The answer of y = a + b*u with noise of a correlation of `memory` from sample to sample."""
    rng = np.random.default_rng(seed)
    u = np.sin(np.arange(N) / 15.0)
    e = np.asarray(lfilter([1.0], [1.0, -memory], np.sqrt(1 - memory**2) * rng.standard_normal(N + 100)))[100:]
    model = pf.equations(
        "y = a + b*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name="line", check=False
    )
    data = {"u": u, "y": 1.0 + 2.0 * u + 0.3 * e}
    if time is not None:
        record = pf.from_arrays({"t": time, **data}, time="t", time_unit="s", units={"u": "1", "y": "1"})
    else:
        record = pf.from_arrays(data, period=period, units={"u": "1", "y": "1"})
    return pf.fit(pf.Problem(model, record, {n: (-10.0, 10.0) for n in TRUTH}, **options), seed=1)


def told(answer):
    return next(s for s in answer.findings["verdict"] if s["sentence"].startswith("The data determine"))


def held(answers, name):
    rows = [next(p for p in a.findings["parameters"] if p["name"] == name) for a in answers]
    return sum(r["low"] <= TRUTH[name] <= r["high"] for r in rows)


@pytest.mark.parametrize("time", [None, np.arange(N) * 1.0], ids=["every 0.1 s", "column of whole seconds"])
def test_samples_in_time_get_errors_that_allow_for_their_correlation(time):
    answer, asked, taken = (
        line(1, 0.8, time=time),
        line(1, 0.8, standard_errors="robust"),
        line(1, 0.8, standard_errors="classical"),
    )
    assert answer.findings["standard_errors"] == {
        "kind": "robust",
        "in_time": False,
        "not_weighted": "",
        "estimator": None,
        "filterable": False,
    }
    assert answer.findings["recordings"][0]["timed"]
    assert answer.standard_errors == asked.standard_errors
    assert answer.standard_errors["a"] > 2.0 * taken.standard_errors["a"]
    assert told(answer)["level"] == "info"  # nothing tells correlated noise from what the model lacks
    assert "if the model lacks something" in told(answer)["sentence"]
    assert not any("do not allow for it" in s["sentence"] for s in answer.findings["verdict"])


def test_white_residuals_and_rows_without_time_are_not_touched():
    white = line(1, 0.0)
    assert white.findings["standard_errors"]["kind"] == "classical"
    assert white.standard_errors == line(1, 0.0, standard_errors="classical").standard_errors
    assert told(white)["level"] == "good"
    assert "independent" not in told(white)["sentence"]
    rows = line(1, 0.8, period=1.0)
    assert not rows.findings["recordings"][0]["timed"]
    assert rows.findings["standard_errors"]["kind"] == "classical"
    assert told(rows)["level"] == "warning"
    assert told(rows)["sentence"].endswith("The intervals take residuals as independent, and those of y are not.")


@pytest.mark.slow
def test_intervals_of_correlated_samples_hold():
    answers = [line(seed, 0.8) for seed in range(60)]
    assert held(answers, "a") >= 52  # 52 is the 1 % quantile of the binomial of 60 at 95 %; classical errors held 32
    assert held(answers, "b") >= 52
