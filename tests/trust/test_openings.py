"""What opens flat directions: ranks that are known, and standard errors against Monte Carlo."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from plantfit.errors import ModelError
from plantfit.models.library.pendubot_terms import base_values
from plantfit.trust import combinations
from plantfit.trust.identify.added_measurements import Measurement, openings

import jax.numpy as jnp

NAMES = ("m1", "m2", "lc1", "lc2", "I1", "I2")
LOWER, UPPER = np.array([0.001, 0.001, 0.001, 0.001, 1e-4, 1e-4]), np.array([0.4, 0.4, 0.15, 0.3, 1e-3, 1e-3])
TRUTH = np.array([0.21, 0.1, 0.12, 0.15, 0.00053, 0.00077])
G = 9.81


def period(i, m, lc):
    return 2 * jnp.pi * jnp.sqrt((i + m * lc**2) / (G * m * lc))


def with_known_mass(p, mass=0.05, at=0.25):
    """Coefficients after a point mass was added to link 2."""
    m2 = p["m2"] + mass
    lc2 = (p["m2"] * p["lc2"] + mass * at) / m2
    return base_values(
        {**p, "m2": m2, "lc2": lc2, "I2": p["I2"] + p["m2"] * (p["lc2"] - lc2) ** 2 + mass * (at - lc2) ** 2}
    )


SCALE1, SCALE2 = (
    Measurement("link 1 on a scale", lambda p: p["m1"], 5e-4),
    Measurement("link 2 on a scale", lambda p: p["m2"], 5e-4),
)
SWING2 = Measurement("link 2 swung on its own", lambda p: period(p["I2"], p["m2"], p["lc2"]), 1e-3)
SWING1 = Measurement("link 1 swung on its own", lambda p: period(p["I1"], p["m1"], p["lc1"]), 1e-3)
ALONE1 = Measurement(
    "the torque of link 1 alone", lambda p: [p["m1"] * p["lc1"], p["I1"] + p["m1"] * p["lc1"] ** 2], [1e-4, 1e-5]
)
ADDED = Measurement("a known mass on link 2", with_known_mass, [1e-5, 1e-5, 1e-4, 1e-4])


@pytest.fixture(scope="module")
def pendubot():
    return combinations(base_values, NAMES, LOWER, UPPER)


@pytest.fixture(scope="module")
def spread(pendubot):
    return np.diag((0.01 * pendubot.function(TRUTH)) ** 2)


def test_what_opens_a_direction_and_what_does_not(pendubot, spread):
    found = openings(pendubot, spread, TRUTH, [SCALE1, SCALE2, SWING2, SWING1, ALONE1, ADDED])
    opened = {o.measurements[0]: (o.opened, o.determined) for o in found.alone}
    assert opened["link 1 on a scale"] == (1, ("m1",))
    assert opened["link 2 on a scale"] == (1, ("m2", "lc2", "I2"))
    # its period is 2 pi sqrt(b2 / (g b5)), known already; a known mass changes every coefficient by a known amount
    assert opened["link 2 swung on its own"] == opened["a known mass on link 2"] == (0, ())
    assert opened["link 1 swung on its own"][0] == 1  # (b1 - l1^2 m2) / (b4 - l1 m2) tells m2
    assert opened["the torque of link 1 alone"][0] == 1
    assert found.together is not None
    assert found.together.still_open == 0
    assert len(found.together.measurements) == 2
    assert "link 1 on a scale" in found.together.measurements


def test_sentences_and_table_say_it(pendubot, spread):
    found = openings(pendubot, spread, TRUTH, [SCALE1, SCALE2, SWING2])
    assert found.sentences[0] == "link 1 on a scale: opens 1 of 2 flat directions; determined is then m1 to ±0.0005."
    assert found.sentences[2].startswith("link 2 swung on its own: opens nothing")
    assert "so that all parameters are determined" in found.sentences[3]
    table = found.table()
    assert table["columns"] == ["Extra measurement", "Opened", *NAMES]
    assert table["rows"][0] == ["the record alone", "0", *["open"] * 6]
    assert table["rows"][1][2] == "0.0005"
    assert all(len(row) == 8 for row in table["rows"])


def test_nothing_opens_everything_when_a_direction_stays(pendubot, spread):
    found = openings(pendubot, spread, TRUTH, [SCALE2, SWING2])
    assert found.together is None
    assert found.sentences[-1] == "No set of these measurements opens every flat direction."


def test_standard_errors_agree_with_monte_carlo(pendubot, spread):
    # small, so that linear is right
    rng, exact, sd = (np.random.default_rng(0), pendubot.function(TRUTH), np.sqrt(np.diag(spread)) / 10)
    small = openings(
        pendubot,
        spread / 100,
        TRUTH,
        [Measurement("a", lambda p: p["m1"], 1e-4), Measurement("b", lambda p: p["m2"], 1e-4)],
    )
    assert small.together is not None
    estimates = []
    for _ in range(300):
        b, m1, m2 = exact + sd * rng.normal(size=4), TRUTH[0] + 1e-4 * rng.normal(), TRUTH[1] + 1e-4 * rng.normal()

        def miss(x, b=b, m1=m1, m2=m2):
            p = x * TRUTH
            values = np.array(list(base_values(dict(zip(NAMES, p, strict=True)), 0.15).values()), dtype=float)
            return np.r_[(values - b) / sd, (p[0] - m1) / 1e-4, (p[1] - m2) / 1e-4]

        estimates.append(least_squares(miss, np.ones(6)).x * TRUTH)
    np.testing.assert_allclose(np.std(estimates, axis=0), small.together.standard_error, rtol=0.15)


def test_a_measurement_that_cannot_be_is_told(pendubot, spread):
    with pytest.raises(ModelError, match="sd is 0"):
        openings(pendubot, spread, TRUTH, [Measurement("m", lambda p: p["m1"], 0.0)])
    with pytest.raises(ModelError, match="one or 2"):
        openings(pendubot, spread, TRUTH, [Measurement("m", lambda p: [p["m1"], p["m2"]], [1.0, 1.0, 1.0])])
    with pytest.raises(ModelError, match="positive definite"):
        openings(pendubot, np.zeros((4, 4)), TRUTH, [])
