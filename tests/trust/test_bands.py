"""Bands of predictions against closed forms, and how often they hold the plant and its readings."""

import numpy as np
import pytest
from scipy.stats import norm

import plantfit as pf
from plantfit.errors import SpaceError
from plantfit.trust.intervals.bands import bands


def line(rng, n=60, noise=0.3):
    u = rng.uniform(-1, 1, n)
    model = pf.equations(
        "y = a + b*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name="line", check=False
    )
    record = pf.from_arrays(
        {"u": u, "y": 1 + 2 * u + noise * rng.standard_normal(n)}, period=1.0, units={"u": "1", "y": "1"}
    )
    return pf.fit(pf.Problem(model, record, {"a": (-10.0, 10.0), "b": (-10.0, 10.0)}), seed=1)


def over(u):
    return pf.from_arrays({"u": u}, period=1.0, units={"u": "1"})


def test_bands_of_a_straight_line_are_those_of_its_covariance():
    answer = line(np.random.default_rng(0))
    u = np.linspace(-3, 3, 9)
    band = answer.bands(over(u), draws=4000)["y"]
    X = np.stack([np.ones(9), u], axis=1)
    spread = np.sqrt(np.einsum("ni,ij,nj->n", X, np.asarray(answer.covariance), X))
    noise = answer.score("fit")["y"]
    assert band.value == pytest.approx(X @ [answer.values["a"], answer.values["b"]])
    for low, high, sd in ((band.low, band.high, spread), (band.read_low, band.read_high, np.hypot(spread, noise))):
        assert high - low == pytest.approx(2 * norm.ppf(0.975) * sd, rel=0.12)
        assert 0.5 * (high + low) == pytest.approx(band.value, abs=0.15 * np.max(sd))


@pytest.mark.thorough
def test_in_60_records_the_plant_and_its_readings_lie_where_they_are_said_to():
    plant, reading = 0, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        band = line(rng).bands(over(np.full(200, 1.5)), seed=seed)["y"]
        plant += band.low[0] <= 1 + 2 * 1.5 <= band.high[0]
        reading.append(band.held(4.0 + 0.3 * rng.standard_normal(200)))
    assert 52 <= plant <= 60  # binomial(60, 0.95): 53 to 60 in 95 % of seeds
    assert np.mean(reading) == pytest.approx(0.95, abs=0.025)


def test_readings_of_two_plants_are_a_mixture():
    band = bands(lambda v: {"y": np.full(3, v[0])}, np.array([[0.0], [0.0], [10.0], [10.0]]), {"y": 1.0}, 0.9)["y"]
    # a tenth of one bell lies below the lower end: half of the readings are of each plant
    assert band.read_low == pytest.approx(np.full(3, norm.ppf(0.1)), abs=1e-6)
    assert band.read_high == pytest.approx(np.full(3, 10 + norm.ppf(0.9)), abs=1e-6)


def test_the_same_seed_gives_the_same_bands_and_wrong_wishes_are_refused():
    answer = line(np.random.default_rng(1))
    one, same, other = (answer.bands(draws=50, seed=s)["y"] for s in (1, 1, 2))
    assert np.array_equal(one.read_low, same.read_low)
    assert not np.array_equal(one.read_low, other.read_low)
    with pytest.raises(SpaceError, match=r"give 0\.5 to"):
        answer.bands(level=2.0)


def test_the_plant_of_an_unseen_recording_begins_beside_what_is_measured_first():
    """A tank that empties: bands of a new recording that began at its first reading held 0 of 40 true first levels."""
    t, k, noise = np.arange(0.0, 20.0, 0.5), 0.1, 0.05

    def record(rng, start, name):
        y = start * np.exp(-k * t) + noise * rng.standard_normal(len(t))
        return pf.Recording(t, {"h": pf.Signal(y, "m")}, name)

    model = pf.equations(
        "x' = -k*x\nh = x",
        states={"x": {"unit": "m", "initial": "h"}}, outputs={"h": "m"}, parameters={"k": {"unit": "1/s"}},
    )  # fmt: skip
    rng = np.random.default_rng(4)
    answer = pf.fit(pf.Problem(model, {"a": record(rng, 1.0, "a"), "b": record(rng, 2.0, "b")}, {"k": (0.01, 1.0)}))
    band, true = answer.bands(record(rng, 1.5, "new"), draws=100)["h"], 1.5 * np.exp(-k * t)
    assert np.all((band.low[[0, 10]] <= true[[0, 10]]) & (true[[0, 10]] <= band.high[[0, 10]]))
    assert band.high[0] - band.low[0] == pytest.approx(2 * norm.ppf(0.975) * noise, rel=0.4)
    fitted = answer.bands("a", draws=20)["h"]
    assert fitted.high[0] - fitted.low[0] < noise  # the fit has estimated where it begins
