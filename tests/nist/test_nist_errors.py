"""Standard errors of models without time: the certified standard deviations of NIST StRD to four digits."""

import re

import pytest
from nist_specs import FOLDER, MODELS, ordered, study

from plantfit.fitting import fit


def certified_errors(name):
    text = (FOLDER / f"{name}.dat").read_text()
    return {n: float(e) for n, e in re.findall(r"^ *(b\d) = +\S+ +\S+ +\S+ +(\S+) *$", text, re.MULTILINE)}


def fitted(name, folder):
    loaded = study(name, folder, start=2)
    return fit(loaded.problem, "least_squares", seed=1, settings={"agree": 1, "max_steps": 2000}, budget=40_000)


@pytest.mark.parametrize("name", sorted(set(MODELS) - {"Lanczos3"}))
@pytest.mark.further(4)
def test_standard_errors_are_the_certified_ones(name, tmp_path):
    found = fitted(name, tmp_path)
    rows = found.findings["parameters"]
    errors = ordered(name, found.values | {})  # the order of interchangeable terms
    place = {v: n for n, v in found.values.items()}
    expected = certified_errors(name)
    local = {r["name"]: r["standard_error"] for r in rows}
    for target, value in errors.items():
        source = next(n for v, n in place.items() if abs(abs(v) - abs(value)) <= 1e-12 * abs(value))
        assert local[source] == pytest.approx(expected[target], rel=1e-4), (target, local)


def test_without_time_no_sentence_speaks_of_dynamics(tmp_path):
    found = fitted("Chwirut2", tmp_path)
    assert found.findings["standard_errors"] == {
        "kind": "classical",
        "in_time": False,
        "not_weighted": "",
        "estimator": None,
        "filterable": False,
    }
    assert "dynamics" not in found.verdict
    assert "sample to the next" not in found.verdict
