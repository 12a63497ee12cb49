"""Budgets against the paper's figures, the GUM's own examples and exact distributions."""

import numpy as np
import pytest

from plantfit.errors import RecordingError
from plantfit.trust.stated_errors.uncertainty_budget import type_a, type_b, uncertainty_budget

PAPER = [type_b("pressure transducer", 0.001 * 39, "bar"), type_b("analog input card", 0.003 * 39, "bar")]


def test_the_steam_paper_is_reproduced_and_its_misprints_are_found():
    budget = uncertainty_budget(PAPER)
    assert [round(r["expanded"], 4) for r in budget.rows()] == [0.0450, 0.1351]  # table 5 prints the second as "1351"
    assert [round(r["standard"], 4) for r in budget.rows()] == [0.0225, 0.0675]
    assert round(budget.expanded(), 4) == 0.1424
    # the text calls this dy_B with the factor 2 in it already; the combined standard uncertainty is half
    assert round(budget.combined, 4) == 0.0712


def test_the_interval_by_monte_carlo_is_the_exact_one_of_a_trapezoid():
    half, error = uncertainty_budget(PAPER).monte_carlo(seed=1)
    a, b = 0.117, 0.039  # the sum of two even errors: flat to a - b, then falling to a + b
    exact = (a + b) - np.sqrt(2 * a * b * 0.05 * 2)  # the tails beyond it hold 5 %
    tails = (a + b - exact) ** 2 / (4 * a * b)
    assert tails == pytest.approx(0.05)
    assert half == pytest.approx(exact, abs=4 * error)
    assert half < 0.1424  # a factor of 2 is safe here, and wider than it must be


def test_type_a_and_effective_degrees_of_freedom():
    readings = [5.007, 4.994, 5.005, 4.990, 4.999]  # JCGM 100, table H.2: voltages, mean 4.9990, s(mean) 0.0032
    source = type_a("V", readings, "V")
    assert source.standard == pytest.approx(0.0032, abs=5e-5)
    # JCGM 100, H.1.6: end gauge, u in nm with degrees of freedom 18, 25.6, 50, 2 (and 12 contributions of none)
    parts = [
        ("standard", 25, 18),
        ("repeats", 5.8, 24),
        ("random", 3.9, 5),
        ("systematic", 6.7, 8),
        ("expansion", 2.9, 50),
        ("temperature", 16.6, 2),
    ]
    gauge = uncertainty_budget([type_b(n, u, "nm", "normal", k=1.0, degrees_of_freedom=f) for n, u, f in parts])
    assert gauge.combined == pytest.approx(32, abs=0.5)
    assert gauge.degrees_of_freedom == pytest.approx(16.7, abs=0.8)
    assert gauge.coverage_factor(0.99) == pytest.approx(2.92, abs=0.02)


@pytest.mark.parametrize(
    ("shape", "divisor"), [("rectangular", 3**0.5), ("triangular", 6**0.5), ("u-shaped", 2**0.5), ("normal", 2.0)]
)
def test_draws_have_the_spread_of_their_shape(shape, divisor):
    source = type_b("x", 3.0, shape=shape)
    errors = source.draw(np.random.default_rng(0), 100_000)
    assert source.standard == pytest.approx(3.0 / divisor)
    assert np.std(errors) == pytest.approx(source.standard, rel=0.01)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.03)
    if shape != "normal":
        assert np.max(np.abs(errors)) <= 3.0


def test_sensitivities_and_shares():
    budget = uncertainty_budget(
        [
            type_b("a", 3.0, "K", "normal", k=1.0, sensitivity=2.0),
            type_b("b", 16.0, "V", "normal", k=1.0, sensitivity=0.5),
        ],
        "bar",
    )
    assert budget.combined == pytest.approx(10.0)
    assert [r["share"] for r in budget.rows()] == pytest.approx([0.36, 0.64])
    assert budget.degrees_of_freedom == np.inf
    assert budget.coverage_factor() == pytest.approx(1.96, abs=1e-3)


def test_wrong_sources_are_refused():
    with pytest.raises(RecordingError, match="type A needs two at least"):
        type_a("x", [1.0])
    with pytest.raises(RecordingError, match="shape 'square'"):
        type_b("x", 1.0, shape="square")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(RecordingError, match="limit = -1"):
        type_b("x", -1.0)
    with pytest.raises(RecordingError, match="at least one source"):
        uncertainty_budget([])
    with pytest.raises(RecordingError, match="twice"):
        uncertainty_budget([PAPER[0], PAPER[0]])


def test_a_source_in_another_unit_needs_a_sensitivity():
    with pytest.raises(RecordingError, match="'a' is in mV and the result in V: write its limit in V, or give its"):
        uncertainty_budget([type_b("a", 1.0, "mV"), type_b("b", 1.0, "V")], "V")
    with pytest.raises(RecordingError, match="sensitivity in V/K"):
        uncertainty_budget([type_b("a", 1.0, "V"), type_b("b", 1.0, "K")])
    mixed = uncertainty_budget([type_b("a", 1.0, "V"), type_b("b", 1.0, "K", sensitivity=0.002)])
    assert mixed.combined == pytest.approx(np.hypot(1.0, 0.002) / np.sqrt(3.0))
