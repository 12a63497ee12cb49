"""First looks at recordings of known transfer functions: delay, frequency response, the best linear model, and what
cannot be looked at."""

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit.errors import RecordingError
from plantfit.first_look import baseline, data_of, frequency_response, look, reaction_delay
from plantfit.first_look.baseline import without
from plantfit.first_look.linear import fit_linear
from plantfit.recording.record import Recording, Signal

H, NOISE = 0.1, 0.1
POLE = np.exp(H * (-0.8 + 4j))
DENOMINATOR = np.real(np.poly([POLE, POLE.conjugate()]))
LAG = np.exp(-H / 0.6)
PLANTS = {
    "first order": ([1 - LAG], [1, -LAG], 0),
    "dead time": ([1 - LAG], [1, -LAG], 4),
    "resonance": ([sum(DENOMINATOR) / 2] * 2, DENOMINATOR, 0),
}


def recorded(plant, seed, n=600, y=None):
    top, bottom, late = PLANTS[plant]
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], size=n // 10 + 1), 10)[:n]
    answer = lfilter(np.r_[np.zeros(1 + late), top], bottom, u) if y is None else y(u)
    return Recording(
        H * np.arange(n), {"u": Signal(u, "V"), "y": Signal(3 + answer + NOISE * rng.normal(size=n), "K")}, "r"
    )


def halves(recording):
    first = np.arange(len(recording)) < 0.6 * len(recording)
    return data_of(recording, ["u"], "y", first, ~first)


@pytest.mark.parametrize("plant", PLANTS)
def test_the_delay_is_right_within_a_sample(plant):
    for seed in range(20):
        found = reaction_delay(halves(recorded(plant, seed)), 0)
        assert found.value == pytest.approx(H * PLANTS[plant][2], abs=H + 1e-9)


@pytest.mark.parametrize("plant", PLANTS)
def test_the_best_linear_model_comes_to_the_noise_on_unseen_samples(plant):
    for seed in range(2):
        found = baseline([halves(recorded(plant, seed))])
        assert found.rmse["unseen"] == pytest.approx(NOISE, rel=0.15)
        assert found.chosen.order >= (2 if plant == "resonance" else 1)
        assert found.chosen.step(0, 400)[-1] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("plant", PLANTS)
def test_the_disc_of_the_frequency_response_holds_the_truth_as_often_as_stated(plant):
    top, bottom, late = PLANTS[plant]
    held = []
    for seed in range(30):
        found = frequency_response(data_of(recorded(plant, seed, n=4000), ["u"], "y"))[0]
        q = np.exp(-2j * np.pi * found.f * H)
        true = np.polyval(np.r_[np.zeros(1 + late), top][::-1], q) / np.polyval(np.array(bottom)[::-1], q)
        held.append(np.mean(np.abs(found.response - true) <= found.radius))
    assert 0.93 <= np.mean(held) <= 0.97


def test_a_delay_where_none_reacts_is_none():
    none = [reaction_delay(halves(recorded("first order", seed, y=np.zeros_like)), 0).value for seed in range(30)]
    assert sum(v is not None for v in none) <= 2  # 1 % by design


@pytest.mark.parametrize("late", [0, 4])
def test_the_delay_of_an_integrating_plant_is_found(late):
    found = []
    for seed in range(20):
        recording = recorded("first order", seed, y=lambda u: np.cumsum(np.r_[np.zeros(1 + late), u])[: len(u)] * H)
        found.append(reaction_delay(halves(recording), 0))
    assert all(f.both and f.value == pytest.approx(late * H, abs=H + 1e-9) for f in found)


def test_of_an_output_that_wanders_by_itself_no_reaction_is_told():
    walks = [
        reaction_delay(
            halves(
                recorded(
                    "first order", s, y=lambda u, s=s: np.cumsum(np.random.default_rng(99 + s).normal(size=len(u)))
                )
            ),
            0,
        ).value
        for s in range(30)
    ]
    assert walks.count(None) >= 28


def test_a_linear_model_cannot_follow_a_plant_that_is_not():
    found = baseline([halves(recorded("first order", 1, y=lambda u: np.abs(lfilter([1 - LAG], [1, -LAG], u))))])
    assert found.rmse["unseen"] > 2 * NOISE


def test_the_sentences_have_figures_and_units():
    said = [v.sentence for v in look(recorded("dead time", 0), ["u"], ["y"]).verdict]
    assert said[0].startswith("y reacts to u after 0.4 s")
    assert "of the unseen y: RMSE 0." in said[-1]
    assert " K, simulated from the inputs alone." in said[-1]


def changed(**signals):
    good = recorded("first order", 0)
    return Recording(good.t, {**good.signals, **{n: Signal(v, "V") for n, v in signals.items()}}, "r")


@pytest.mark.parametrize(
    ("recording", "words"),
    [
        (changed(u=np.ones(600)), "input u never moves"),
        (changed(y=np.ones(600)), "output y is 1 throughout"),
        (changed(y=np.full(600, np.nan)), "output y is measured at 0 samples"),
        (changed(u=np.where(np.arange(600) < 200, np.nan, 1.0)), "input u is missing in 33 %"),
        (
            Recording(np.zeros(1), {"u": Signal(np.ones(1)), "y": Signal(np.ones(1))}, "r"),
            "has 1 sample, and a first look needs 30",
        ),
    ],
)
def test_what_cannot_be_looked_at_is_told_in_one_sentence(recording, words):
    with pytest.raises(RecordingError, match=words):
        data_of(recording, ["u"], "y")


def test_some_missing_samples_do_not_matter():
    y = recorded("first order", 0)["y"].copy()
    y[50:60] = np.nan
    assert baseline([halves(changed(y=y))]).rmse["unseen"] == pytest.approx(NOISE, rel=0.2)


def test_coherence_is_said_once_for_an_output():
    """It is with all inputs together, so a sentence for each input would say the same again."""
    rng = np.random.default_rng(7)
    n = 1200
    a, b = np.repeat(rng.choice([-1.0, 1.0], n // 20), 20), np.repeat(rng.choice([-1.0, 1.0], n // 30), 30)
    y = np.zeros(n)
    for k in range(n - 1):
        y[k + 1] = 0.9 * y[k] + 0.1 * (a[k] + b[k])
    signals = {"a": Signal(a), "b": Signal(b), "y": Signal(y + rng.normal(0, 0.02, n))}
    record = Recording(np.arange(n) * 0.1, signals)
    said = [row.sentence for row in look(record, ["a", "b"], ["y"]).verdict]
    assert len([s for s in said if s.startswith("Coherence of y")]) == 1


def test_a_block_left_out_at_the_start_is_foretold_without_running_away():
    """Orders above the plant's have poles that die out within samples; initial states from later ones blew up back
    to the first."""
    record = recorded("first order", 5, n=300)
    data = [data_of(record, ["u"], "y")]
    for order in (1, 3, 4):
        whole = fit_linear(data, order, (0,))
        assert whole is not None
        for begin in (0, 240):
            hidden = np.zeros(300, dtype=bool)
            hidden[begin : begin + 60] = True
            again = without(data, whole, [hidden])
            assert again is not None
            errors = (again.simulated[0] - record["y"])[hidden]
            # rest at the first sample has the noise of that one
            assert np.sqrt(np.mean(errors**2)) < (2 if begin else 5) * NOISE


@pytest.mark.thorough
def test_a_slow_plant_that_a_linear_model_follows_is_not_called_noise():
    """Four steps of a heater in half an hour: in no eighth of the record there is enough of the answer."""
    blamed = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        n, tau = 1800, rng.uniform(100, 300)
        u = np.zeros(n)
        for begin, level in zip((60, 600, 1000, 1400), (120, 220, 60, 180), strict=True):
            u[begin + rng.integers(-40, 40) :] = level + rng.uniform(-30, 30)
        heat = lfilter([0.0, 0.4 * (1 - np.exp(-1 / tau))], [1, -np.exp(-1 / tau)], u)
        y = 22 + lfilter([0.0, 1 - np.exp(-1 / 12)], [1, -np.exp(-1 / 12)], heat) + 0.15 * rng.normal(size=n)
        told = look(Recording(np.arange(n), {"u": Signal(u, "%"), "y": Signal(y, "degC")}, "r"), ["u"], ["y"])
        text = " ".join(s.sentence for s in told.verdict)
        assert any(f"explains {share}" in text for share in ("9", "100"))
        if (value := told.outputs[0].pairs[0].delay) is not None and value > 20:  # the truth is 0
            assert "at the latest" in text
            assert "the linear model has a dead time of" in text
        assert "noise, or no linear answer" not in text
        blamed += "the linear model takes the whole record" in text
    assert blamed > 2


@pytest.mark.thorough
def test_noise_and_a_decay_beside_an_input_that_does_nothing_are_still_called_noise():
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        n = 900
        u = np.repeat(rng.permutation([0.0, 120, 220, 60, 180, 20]), 150)
        y = rng.normal(size=n) + (20 * np.exp(-np.arange(n) / 200) if seed % 2 else 0)
        told = look(Recording(np.arange(n), {"u": Signal(u, "%"), "y": Signal(y, "degC")}, "r"), ["u"], ["y"])
        text = " ".join(s.sentence for s in told.verdict)
        assert "which takes all lags together" not in text
        assert "takes the whole record" not in text
