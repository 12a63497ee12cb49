"""An end of a sensor is not named where the record goes on beyond it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from plantfit.trust.diagnosis.judge import beyond_end
from plantfit.trust.diagnosis.plant.carrier import Rows
from plantfit.trust.diagnosis.rounds import Round, Trial, why_not
from plantfit.trust.diagnosis.sentences import _fails

N = 500


def fit_with(kind, measured, shown):
    """A carrier, the fit of a sensor that measured this and of which the model shows that, (n,) each, and its end."""
    n, all_of = len(measured), np.ones(len(measured), bool)
    weight = np.full(n, 0.5)
    rows = Rows(np.full(n, "log"), np.full(n, "y"), np.arange(n), measured, all_of, ~all_of, weight)
    given = SimpleNamespace(outputs=["y"], model=SimpleNamespace(outputs={"y": "m"}))
    carrier: Any = SimpleNamespace(rows=rows, given=given)
    one: Any = SimpleNamespace(residuals=(shown - measured) * weight)
    row = SimpleNamespace(level=True, phrase="an end at {} of the sensor of {}")
    addition: Any = SimpleNamespace(kind=kind, signal="y", place="output", unit="m", candidate=row)
    return carrier, one, addition, all_of


def share(kind, measured, shown):
    """Of samples beyond the end."""
    return beyond_end(*fit_with(kind, measured, shown))


def moving(seed):
    """A signal that moves between about -1 and 1, and its noise."""
    rng, t = np.random.default_rng(seed), np.arange(N)
    y = np.sin(2 * np.pi * t / (60 + 20 * seed)) + 0.3 * np.sin(0.31 * t + seed)
    return y, rng


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("noise", ["before", "behind", "slow", "offset"])
def test_an_end_that_is_there_has_nothing_beyond_it(noise, seed, sign):
    """Whether the noise is that of what it measures or that of its wire, white or slow, or an offset stands behind."""
    y, rng = moving(seed)
    white = 0.02 * rng.standard_normal(N)
    slow = np.convolve(rng.standard_normal(N + 40), np.ones(41) / 41, "valid") * 0.2
    made, at = {
        "before": (np.minimum(y + white, 0.6), np.minimum(y, 0.6)),
        "behind": (np.minimum(y, 0.6) + white, np.minimum(y, 0.6)),
        "slow": (np.minimum(y, 0.6) + slow, np.minimum(y, 0.6)),
        "offset": (np.minimum(y, 0.6) + 0.3 + white, np.minimum(y, 0.6) + 0.3),
    }[noise]
    kind = "sensor_high" if sign > 0 else "sensor_low"
    assert share(kind, sign * made, sign * at) == 0.0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seed", range(6))
def test_an_end_that_a_simulation_which_runs_away_is_held_by_has_samples_beyond_it(seed, sign):
    y, rng = moving(seed)
    away = np.minimum(y + 0.02 * np.arange(N), 0.2)
    found = share("sensor_high" if sign > 0 else "sensor_low", sign * (y + 0.02 * rng.standard_normal(N)), sign * away)
    assert 0.2 < found < 0.6


def test_other_additions_have_no_end():
    y, _ = moving(1)
    assert share("offset", y, np.minimum(y, 0.0)) == 0.0


def test_single_samples_beyond_an_end_are_no_proof():
    y, rng = moving(2)
    made = np.minimum(y, 0.6) + 0.02 * rng.standard_normal(N)
    made[[40, 333]] = 1.4
    assert share("sensor_high", made, np.minimum(y, 0.6)) == 0.0


@pytest.mark.parametrize("there", [True, False])
def test_what_is_said_of_an_end(there):
    y, rng = moving(3)
    made = (np.minimum(y, 0.2) if there else y) + 0.02 * rng.standard_normal(N)
    carrier, one, addition, use = fit_with("sensor_high", made, np.minimum(y, 0.2))
    t = Trial(addition, 0.9, 80.0, (1.0, 0.3), 0.8, (1.0, 0.4), 0.2, 0.01, one)
    assert why_not(t, carrier, 12.0, use, use) == (None if there else "beyond")
    d: Any = SimpleNamespace(carrier=carrier, apart=~use, unseen_blocks=False)
    said = _fails(d, Round((), (t,), (), 12.0), "None")
    assert (said == "") is there
    if not there:
        assert said.startswith(
            "The one addition that was tried does not hold. An end at 0.200 ± 0.010 m of the sensor of y"
        )
        assert said.endswith(" % of the samples lie beyond that end, which such a sensor does not show.")
