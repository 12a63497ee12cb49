"""Residuals of a model at rest that are of several sizes are told, and those of one size are not."""

import numpy as np
import pytest

from plantfit import Problem, Recording, Signal, equations
from plantfit.findings.residuals import ResidualTest, Sizes
from plantfit.fitting import fit
from plantfit.report.sections.sentences import whiteness
from plantfit.trust.validate.residuals.sizes import ROWS, sizes

DRAWS = {
    "normal": lambda rng, n: rng.normal(size=n),
    "four degrees": lambda rng, n: rng.standard_t(4, n),
    "laplace": lambda rng, n: rng.laplace(size=n),
    "outliers": lambda rng, n: np.where(rng.random(n) < 0.03, 10.0, 1.0) * rng.normal(size=n),
}


def told(draws, rows, seeds, grows):
    """Share of the tables in which sizes are told."""
    rng, count = np.random.default_rng(rows), 0
    for _ in range(seeds):
        simulated = np.exp(rng.uniform(0, np.log(30), rows))
        count += sizes(draws(rng, rows) * (simulated if grows else 1.0), simulated) is not None
    return count / seeds


@pytest.mark.parametrize("kind", DRAWS)
@pytest.mark.parametrize("rows", [30, 200])
def test_one_size_is_not_told_as_several(kind, rows):
    assert told(DRAWS[kind], rows, 1000, grows=False) <= 0.012


@pytest.mark.parametrize(("rows", "least"), [(30, 0.4), (60, 0.8), (200, 0.99)])
def test_errors_in_per_cent_are_told(rows, least):
    assert told(DRAWS["normal"], rows, 300, grows=True) >= least


def test_sizes_are_those_of_the_lowest_and_highest_third():
    rng = np.random.default_rng(1)
    simulated = rng.uniform(1, 10, 300)
    found = sizes(np.where(simulated > 4, 0.2, 1.0) * rng.normal(size=300), simulated)
    assert found is not None
    assert found.low == pytest.approx(1.0, rel=0.2)
    assert found.high == pytest.approx(0.2, rel=0.2)


def test_few_rows_and_one_level_tell_none():
    rng = np.random.default_rng(2)
    few = np.linspace(1, 30, ROWS - 1)
    assert sizes(few * rng.normal(size=len(few)), few) is None
    assert sizes(rng.normal(size=100), np.full(100, 3.0)) is None
    many = np.linspace(1, 30, 4 * ROWS)
    assert sizes(many * rng.normal(size=len(many)), many) is not None
    gaps = np.where(np.arange(len(many)) % 5, np.nan, many * rng.normal(size=len(many)))
    assert sizes(gaps, many) is None


def thermistor(error, seed=1, rows=120, **how):
    """The verdict of its constants from a table, with errors of 1 % or of one size."""
    rng = np.random.default_rng(seed)
    temperature = rng.uniform(273, 363, rows)
    resistance = 10.0 * np.exp(3950 * (1 / temperature - 1 / 298.15))
    resistance = resistance + error(resistance) * rng.normal(size=rows)
    table = Recording(np.arange(float(rows)), {"T": Signal(temperature, "K"), "R": Signal(resistance, "ohm")}, "table")
    model = equations(
        "R = R0*exp(B*(1/T - 1/Tr))", inputs={"T": "K"}, outputs={"R": "ohm"}, constants={"Tr": "298.15 K"},
        parameters={"R0": {"unit": "ohm"}, "B": {"unit": "K"}},
    )  # fmt: skip
    return fit(Problem(model, table, {"R0": (1, 100), "B": (500, 9000)}, **how)).findings["verdict"]


def test_the_report_tells_where_they_are_larger():
    test = {"recording": "r", "output": "R", "lags_s": [], "autocorrelation": [], "white": True, "p_value": 0.5}
    large = ResidualTest(**test, sizes=Sizes(low=0.1, high=0.9, p_value=1e-6))
    small = ResidualTest(**test, sizes=Sizes(low=0.9, high=0.1, p_value=1e-6))
    assert "not of one size: larger where the model is highest." in whiteness(large)
    assert "not of one size: larger where the model is lowest." in whiteness(small)
    assert "one size" not in whiteness(ResidualTest(**test))


def in_words(verdict):
    return [s["sentence"] for s in verdict if "one size" in s["sentence"]]


def test_a_thermistor_with_errors_in_per_cent_is_told_that_its_intervals_are_too_small():
    verdict = thermistor(lambda r: 0.01 * r)
    determined, sized = in_words(verdict)
    assert determined.startswith("The data determine 2 of 2 parameters")
    assert determined.endswith("The intervals take residuals as of one size, and those of R are not.")
    assert sized.startswith("The residuals of R are not of one size: 0.0")
    assert 'write standard_errors = "robust"' in sized
    assert all(s["level"] == "warning" for s in verdict if "one size" in s["sentence"])


def test_nothing_is_said_of_errors_of_one_size_or_beside_robust_intervals():
    assert not in_words(thermistor(lambda r: 0.1))
    assert not in_words(thermistor(lambda r: 0.01 * r, standard_errors="robust"))
