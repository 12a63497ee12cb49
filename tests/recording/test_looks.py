"""Looks at signals: each where it is true, and where a plain record must be left alone."""

import tomllib

import numpy as np
import pytest
from scipy.signal import butter, chirp, cont2discrete, lfilter

import plantfit.recording as rec
from plantfit.recording.looks import clock_looks, feedback_look, signal_looks
from plantfit.recording.record import Recording, Signal

T = np.arange(600) * 0.05


def plant(u, noise=0.02, seed=0, start=0.0):
    """A first order plant, gain 2, 0.5 s, under an input held between samples; noise as a share of its spread."""
    x, y, a = start, np.empty(len(u)), np.exp(-0.05 / 0.5)
    for k, v in enumerate(u):
        y[k] = x
        x = a * x + (1 - a) * 2.0 * v
    return y + noise * np.std(y) * np.random.default_rng(seed).normal(size=len(u))


def steps(seed=0, held=20):
    return np.repeat(np.random.default_rng(seed).uniform(-1, 2, 600 // held), held)


def recorded(y, u=None, t=T):
    return Recording(t, {"u": Signal(steps() if u is None else u, "V"), "y": Signal(y, "m")}, "a")


def kinds(y, measured=True):
    return [look.kind for look in signal_looks(recorded(y), "y", measured)]


@pytest.mark.parametrize("seed", range(20))
def test_a_plain_record_is_left_alone(seed):
    r = recorded(plant(steps(seed), seed=seed), steps(seed))
    assert not list(signal_looks(r, "y", measured=True))
    assert not list(signal_looks(r, "u", measured=False))
    assert not list(clock_looks(r))
    assert feedback_look(r, "u", "y") is None


def test_records_without_noise_and_signals_with_sharp_corners_are_left_alone():
    assert not kinds(plant(steps(), noise=0.0))
    assert not kinds(np.abs(np.sin(T)) + 0.001 * np.random.default_rng(0).normal(size=600))
    assert not kinds(steps(), measured=False)  # an input rests at its ends


def test_a_signal_that_never_moves():
    (look,) = signal_looks(recorded(plant(steps()), np.full(600, 1.5)), "u", measured=False)
    assert look.kind == "constant"
    assert look.figures["value"] == 1.5
    assert "1.5 V" in look.sentence


def test_a_sensor_that_ends():
    y = plant(steps())
    level = np.quantile(y, 0.9)
    (look,) = signal_looks(recorded(np.minimum(y, level)), "y", measured=True)
    assert look.kind == "clipped"
    assert look.figures["value"] == pytest.approx(level)
    assert "upper end" in look.sentence
    assert "sensor_high" in look.write
    assert y[np.searchsorted(T, look.begin)] >= level - 0.1


def test_a_sensor_that_is_stuck():
    y = plant(steps())
    y[300:350] = y[300]
    (look,) = signal_looks(recorded(y), "y", measured=True)
    assert look.kind == "stuck"
    assert (look.begin, look.figures["samples"]) == (pytest.approx(15.0), 50)
    (step,) = tomllib.loads(look.write)["clean"]
    cleaned = rec.drop_samples(recorded(y), step["signal"], between=step["between"])
    assert np.flatnonzero(np.isnan(cleaned["y"])).tolist() == list(range(301, 350))
    assert not any(look.kind == "stuck" for look in signal_looks(cleaned, "y", measured=True))


def resting_drive():
    """The angle of a drive with dry friction, mrad, between moves at rest."""
    u, w, angle, found = np.repeat([0.0, 5.0, 0.0, -3.0, 0.0, 0.0], 100), 0.0, 0.0, []
    for k in range(2400):
        push = u[k // 4] - 0.3 * np.sign(w if w else u[k // 4])
        moved = w + 0.0125 * (push - w) / 0.2 if w or abs(u[k // 4]) > 0.3 else 0.0
        w = 0.0 if w * moved < 0 else moved
        angle += 12.5 * w
        found.append(angle)
    return np.round(found[::4])


def test_a_drive_at_rest_is_no_sensor_that_is_stuck():
    y = resting_drive()
    assert not any(look.kind == "stuck" for look in signal_looks(recorded(y), "y", measured=True))
    y[130:180] = y[130]  # while it moves
    (look,) = (k for k in signal_looks(recorded(y), "y", measured=True) if k.kind == "stuck")
    assert (look.begin, look.figures["samples"]) == (pytest.approx(6.5), 50)


def test_a_coarse_sensor_is_quantised_and_neither_stuck_nor_clipped():
    y = np.round(plant(steps(), noise=0.05) / 0.2) * 0.2
    found = list(signal_looks(recorded(y), "y", measured=True))
    assert [look.kind for look in found] == ["quantised"]
    assert found[0].figures["step"] == pytest.approx(0.2)


def test_spikes_are_counted_and_placed():
    y = plant(steps())
    at = [100, 250, 251 + 90, 500]
    y[at] += 2.0
    (look,) = signal_looks(recorded(y), "y", measured=True)
    assert look.kind == "spikes"
    assert look.figures["samples"] == 4
    assert (look.begin, look.end) == (pytest.approx(T[100]), pytest.approx(T[500]))
    (step,) = tomllib.loads(look.write)["clean"]
    options = {k: v for k, v in step.items() if k not in ("step", "signal")}
    cleaned = getattr(rec, step["step"])(recorded(y), step["signal"], **options)
    assert np.flatnonzero(np.isnan(cleaned["y"])).tolist() == at


def test_missing_samples_in_a_row():
    y = plant(steps())
    y[200:240] = np.nan
    (look,) = signal_looks(recorded(y), "y", measured=True)
    assert (look.kind, look.figures["samples"], look.begin) == ("missing", 40, pytest.approx(10.0))


def test_gaps_and_an_uneven_clock():
    kept = np.r_[0:200, 260:600]
    (gap,) = clock_looks(recorded(plant(steps())[kept], steps()[kept], T[kept]))
    assert gap.kind == "gaps"
    assert gap.figures["longest"] == pytest.approx(3.05)
    uneven = T + 0.02 * np.random.default_rng(1).uniform(-1, 1, 600)
    (look,) = clock_looks(recorded(plant(steps()), t=uneven))
    assert look.kind == "irregular"


def test_an_input_computed_from_the_output():
    rng, x, a = np.random.default_rng(0), 0.0, np.exp(-0.05 / 0.5)
    u, y, goal = np.empty(600), np.empty(600), steps(3)
    for k in range(600):
        y[k] = x + 0.05 * rng.normal()
        u[k] = 3.0 * (goal[k] - (y[k - 1] if k else 0.0))
        x = a * x + (1 - a) * 2.0 * u[k]
    look = feedback_look(recorded(y, u), "u", "y")
    assert look is not None
    assert look.kind == "feedback"
    assert (look.figures["share"] or 0.0) > 0.05
    noisy = recorded(plant(np.random.default_rng(5).normal(size=600)), np.random.default_rng(5).normal(size=600))
    assert feedback_look(noisy, "u", "y") is None


def sampled_plant(rng, second_order):
    """Coefficients of a plant held between samples, y[k] = -a1 y[k-1] - a2 y[k-2] + b1 u[k-1] + b2 u[k-2]."""
    if not second_order:
        pole = np.exp(-1 / rng.uniform(5, 30))
        return (1 - pole, 0.0), (-pole, 0.0)
    w, damping = 2 * np.pi / rng.uniform(15, 60), rng.uniform(0.1, 1.2)
    over, under, _ = cont2discrete(([w * w] if rng.random() < 0.6 else [w, 0.0], [1, 2 * damping * w, w * w]), 1.0)
    return over.ravel()[1:], under[1:]


def excitation(rng, kind, n=1500):
    if kind == "prbs":
        return np.repeat(rng.choice([-1.0, 1.0], n), rng.integers(4, 30))[:n]
    pole = np.exp(-1 / rng.uniform(3, 15))
    u = lfilter([1], [1, -pole], rng.normal(size=n))
    return u / np.std(u)


def looked_at(u, y):
    return feedback_look(recorded(y, u, 0.02 * np.arange(len(u))), "u", "y")


def open_loop(seed, late):
    """A plant whose input is stamped `late` samples late, noise 0.5 to 2 % of the output."""
    rng = np.random.default_rng(seed)
    (b1, b2), (a1, a2) = sampled_plant(rng, seed // 2 % 2)
    u = excitation(rng, ("prbs", "filtered")[seed % 2])
    y = lfilter([0, b1, b2], [1, a1, a2], u)
    y += np.std(y) * rng.uniform(0.005, 0.02) * rng.normal(size=len(y))
    return u[: len(u) - late], y[late:]


def controlled(seed):
    """A plant under P, PI or PID control by its measured output, of this sample or the last; None where the loop is
    not stable."""
    rng = np.random.default_rng(1000 + seed)
    (b1, b2), (a1, a2) = sampled_plant(rng, seed // 2 % 2)
    goal = excitation(rng, ("prbs", "filtered")[seed % 2])
    gain, integral, noise, old = (
        rng.uniform(0.5, 5),
        (0.0, *1 / rng.uniform(5, 60, 2))[seed % 3],
        rng.uniform(0.005, 0.05),
        seed // 4 % 2,
    )
    slope = rng.uniform(1, 5) if seed % 3 == 2 else 0.0
    u, x, y, summed = np.zeros(1500), np.zeros(1500), np.zeros(1500), 0.0
    for k in range(3, 1500):
        x[k] = -a1 * x[k - 1] - a2 * x[k - 2] + b1 * u[k - 1] + b2 * u[k - 2]
        y[k] = x[k] + noise * rng.normal()
        summed += integral * (goal[k] - y[k - old])
        u[k] = gain * (goal[k] - y[k - old] + summed - slope * (y[k - old] - y[k - old - 1]))
        if abs(x[k]) > 50:
            return None
    return u, y


def test_an_input_that_is_stamped_late_is_not_called_a_closed_loop_alone():
    told = 0
    for seed in range(60):
        late = 2 + seed % 9
        look = looked_at(*open_loop(seed, late))
        if look is None:
            continue
        told += 1
        assert look.kind == "feedback"
        shift = look.figures.get("late")
        assert shift is not None, seed
        assert shift == pytest.approx(0.02 * late, abs=0.021), seed
        assert f"may be stamped about {shift:.3g} s late (two clocks)" in look.sentence
        assert "or be computed from y (closed loop)" in look.sentence
        assert look.write == f"clock_shift = {{ u = [{-2 * shift:.3g}, {2 * shift:.3g}] }}"
        assert look.write in look.sentence
    assert told >= 40


@pytest.mark.parametrize("sines", [4, 15])
def test_a_sum_of_sines_is_no_feedback(sines):
    """Five past values do not tell all of it, and an output that it moved long ago tells more; its own longer past
    tells as much."""
    t, fine = 0.1 * np.arange(800), 0.01 * np.arange(8000)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        parts = rng.uniform([0.3, 0.02, 0.0], [0.8, 0.3, 6.28], (sines, 3))
        u = np.sum([a * np.sin(2.0 * np.pi * f * fine + p) for a, f, p in parts], axis=0)
        y = lfilter([0.01 / 1.5], [1.0, 0.01 / 1.5 - 1.0], 2.0 * u)[::10] + 0.02 * rng.normal(size=800)
        assert feedback_look(recorded(y, u[::10], t), "u", "y") is None


def test_an_output_smoothed_over_later_samples_is_named_beside_a_loop():
    rng = np.random.default_rng(2)
    u = np.repeat(rng.choice([1.0, 4.0], 40), 15)
    y = lfilter([0.06], [1.0, -0.94], 2.0 * u) + 0.02 * rng.normal(size=600)
    smoothed = np.convolve(np.pad(y, 4, mode="edge"), np.ones(9) / 9, "valid")
    assert feedback_look(recorded(y, u), "u", "y") is None
    look = feedback_look(recorded(smoothed, u), "u", "y")
    assert look is not None
    assert (
        "smoothed or interpolated over later samples" in look.sentence or "smoothed over later samples" in look.sentence
    )


def test_control_by_the_output_is_still_told():
    told = 0
    for seed in range(100):
        loop = controlled(seed)
        look = None if loop is None else looked_at(*loop)
        if look is None:
            continue
        told += 1
        assert "seems to be computed from y (closed loop)" in look.sentence, seed
        assert look.write == ""
        assert "late" not in look.figures
    assert told >= 20  # of some 83 stable ones; twice as many where the own past of a goal in steps is cut at 5 samples


def known_beforehand(kind, n, rng):
    """Excitations whose long past tells them: a random-phase multisine of two periods, a sweep, sines, filtered
    noise, held levels."""
    t = np.arange(n)
    if kind == "multisine":
        f = np.arange(1, n // 4) / (n // 2)
        f = f[(f >= rng.uniform(0.0, 0.02)) & (f <= rng.uniform(0.05, 0.45))]
        return np.sum(np.cos(2 * np.pi * np.outer(f, t) + rng.uniform(0, 2 * np.pi, (len(f), 1))), axis=0)
    if kind == "sweep":
        return chirp(t, rng.uniform(1e-3, 1e-2), n, rng.uniform(0.1, 0.4))
    if kind == "sines":
        return np.sum(np.sin(2 * np.pi * np.outer(rng.uniform(0.002, 0.3, 4), t) + rng.uniform(0, 6, (4, 1))), axis=0)
    if kind == "filtered":
        return lfilter(*butter(4, rng.uniform(0.05, 0.8)), rng.normal(size=n))
    return np.repeat(rng.choice([-1.0, 1.0], n // 5), 5)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("kind", ["multisine", "sweep", "sines", "filtered", "levels"])
def test_excitations_that_are_known_beforehand_are_no_closed_loop(kind, bent):
    """In open loop, of plants that ring or not, linear or not; noise of 0.1 to 10 %."""
    alarms = 0
    for seed in range(25):
        rng = np.random.default_rng([seed, bent])
        u = known_beforehand(kind, 1500, rng)
        w, damping = np.pi * 10 ** rng.uniform(-2, -0.3), rng.uniform(0.02, 1.2)
        over, under, _ = cont2discrete(([w * w], [1, 2 * damping * w, w * w]), 1.0)
        y = lfilter(over.ravel(), under, u)
        y = np.tanh(1.5 * y / np.std(y)) if bent else y
        alarms += looked_at(u, y + 10 ** rng.uniform(-3, -1) * np.std(y) * rng.normal(size=1500)) is not None
    assert alarms <= 2


def test_an_open_loop_stamped_right_is_silent():
    assert all(looked_at(*open_loop(seed, 0)) is None for seed in range(60))


def test_a_blip_of_one_level_of_a_coarse_signal_is_no_spike():
    y = np.round(plant(steps()) / 0.25) * 0.25
    flat = int(np.argmax(np.convolve(np.diff(y) == 0, np.ones(10), "valid"))) + 5
    y[flat] += 0.25
    assert "spikes" not in kinds(y)
    y[flat] += 5.0
    [look] = [k for k in signal_looks(recorded(y), "y", True) if k.kind == "spikes"]
    assert look.sentence.startswith("1 sample of y stands alone")
    assert look.times == [T[flat]]


def test_clipped_samples_are_marked():
    y = np.minimum(plant(steps()), 2.0)
    [look] = [k for k in signal_looks(recorded(y), "y", True) if k.kind == "clipped"]
    assert len(look.times) == min(200, int(look.figures["samples"] or 0))
    assert all(y[np.isclose(T, at)] == 2.0 for at in look.times)


def driven_by_waves(seed, step):
    """A lag driven by a slow signal, which is read in steps."""
    rng, n = np.random.default_rng(seed), 600
    rates, phases = rng.uniform(0.1, 1.2, 3), rng.uniform(0, 6, 3)
    u = np.sum(np.sin(np.outer(0.01 * np.arange(10 * n), rates) + phases), axis=1)
    over, under, _ = cont2discrete(([2.0], [rng.uniform(0.5, 4.0), 1.0]), 0.01)
    y = lfilter(over.ravel(), under, u)[::10] + 0.01 * rng.standard_normal(n)
    return recorded(y, step * np.round(u[::10] / step), 0.1 * np.arange(n))


def test_an_input_that_was_read_in_steps_is_no_closed_loop():
    records, rounding = [driven_by_waves(seed, 0.3) for seed in range(20)], 0.3 / np.sqrt(12.0)
    # the output follows what was there, and so tells the error of the reading
    assert sum(feedback_look(r, "u", "y") is not None for r in records) >= 15
    assert sum(feedback_look(r, "u", "y", rounding) is not None for r in records) <= 1


def test_an_input_that_was_read_with_noise_looks_like_a_closed_loop_and_both_are_named():
    looks = []
    for seed in range(20):
        r, rng = driven_by_waves(seed, 1e-9), np.random.default_rng(100 + seed)
        noisy = Signal(r["u"] + 0.2 * rng.standard_normal(len(r)))
        looks.append(feedback_look(Recording(r.t, {"u": noisy, "y": r.signals["y"]}, "r"), "u", "y"))
    told = [look.sentence for look in looks if look is not None]
    assert len(told) >= 15
    assert all("knows it better: u was read with noise" in s or "stamped" in s for s in told)


def test_a_closed_loop_is_told_though_its_input_is_read_in_steps():
    found = {0.0: 0, 0.3 / np.sqrt(12.0): 0}
    for seed in range(20):
        rng, x, a, goal = np.random.default_rng(seed), 0.0, np.exp(-0.05 / 0.5), steps(seed)
        u, y = np.empty(600), np.empty(600)
        for k in range(600):
            y[k] = x + 0.05 * rng.normal()
            u[k] = 0.3 * np.round(3.0 * (goal[k] - (y[k - 1] if k else 0.0)) / 0.3)
            x = a * x + (1 - a) * 2.0 * u[k]
        for rounding in found:
            found[rounding] += feedback_look(recorded(y, u), "u", "y", rounding) is not None
    without, with_it = found.values()
    assert with_it == without >= 8


def _turning(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Times, sums of sines and the step of an encoder that reads them."""
    t = np.arange(rng.integers(200, 3000)) * 10 ** rng.uniform(-3, -1.5)
    waves = zip(rng.uniform(0.2, 1, 4), rng.uniform(0.2, 3, 4), rng.uniform(0, 6, 4), strict=True)
    y = sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in waves) + rng.choice([0.0, 5.0]) * t
    return t, y, np.ptp(y) / 10 ** rng.uniform(2, 5)


def test_an_encoder_that_turns_round_is_not_clipped_and_one_that_ends_is():
    """Equal samples where a smooth angle turns are the steps of its encoder; each record beside itself cut off at a
    height of its own."""
    rng, alarms, told = np.random.default_rng(1), 0, 0
    for _ in range(200):
        t, y, step = _turning(rng)
        cut_off = np.minimum(y, np.quantile(y, rng.uniform(0.8, 0.98)))
        found = [
            any(k.kind == "clipped" for k in signal_looks(recorded(np.round(v / step) * step, 0 * t, t), "y", True))
            for v in (y, cut_off)
        ]
        alarms, told = alarms + found[0], told + found[1]
    assert alarms <= 4  # 15 before the way to the turn was looked at
    assert told >= 190


def _stopping(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, and the height of what is thrown upwards time and again, dry friction holds where it stops for a while,
    and falls back: the second array of speeds that come to rest in a few samples, the third cut off below the stop."""
    period, rows = 10 ** rng.uniform(-3, -1.5), []
    for lift in (1.0, *rng.uniform(0.3, 0.8, 3)):
        speed = np.linspace(1.0, 0.0, rng.integers(8, 60))  # constant deceleration up to the stop
        rows += [*(lift * speed / speed.sum()), *np.zeros(rng.integers(6, 25)), *(-lift * speed[::-1] / speed.sum())]
        rows += [0.0] * rng.integers(1, 4)
    y = np.cumsum(rows)
    return np.arange(len(y)) * period, y, np.minimum(y, rng.uniform(0.5, 0.75))


def test_what_friction_stops_is_not_clipped_and_what_is_cut_off_is():
    """Of a lifting axis that sticks at its highest place a run said "the sensor may end there"."""
    rng, alarms, told = np.random.default_rng(2), 0, 0
    for _ in range(100):
        t, y, cut_off = _stopping(rng)
        step = 10 ** rng.uniform(-4, -2.7)
        found = [
            any(k.kind == "clipped" for k in signal_looks(recorded(np.round(v / step) * step, 0 * t, t), "y", True))
            for v in (y, cut_off)
        ]
        alarms, told = alarms + found[0], told + found[1]
    assert alarms <= 20  # 100 before; short stops that a parabola in so few steps does not tell from an end
    assert told >= 90


def test_an_end_that_a_noisy_signal_comes_to_slowly_is_told_as_often(monkeypatch):
    """Where moves are noise, none of them tells that it slows down."""
    with_it = _ends_of_noisy_signals()
    monkeypatch.setattr("plantfit.recording.looks.signals._stops", lambda *_: False)
    assert with_it == _ends_of_noisy_signals() >= 15


def _ends_of_noisy_signals() -> int:
    told = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        rise = np.concatenate([1 - np.exp(-np.arange(60) / rng.uniform(5, 25)), np.zeros(20)] * 4)
        y = np.minimum(rise + 0.01 * rng.normal(size=len(rise)), rng.uniform(0.6, 0.8))
        step = (0.0, 1e-3, 2e-3)[seed % 3]
        read = np.round(y / step) * step if step else y
        looks = signal_looks(recorded(read, 0 * read, np.arange(len(y)) * 0.1), "y", True)
        told += "clipped" in [look.kind for look in looks]
    return told


MARKED = (12, 13, 57, 200, 201, 202, 410, 555)


@pytest.mark.parametrize("value", [-999.0, 9999.0])
@pytest.mark.parametrize("measured", [True, False])
def test_a_number_that_stands_for_no_value_is_named(value, measured):
    """Only those that stand alone were called spikes, and taking these away left the others; of an input nothing was
    said."""
    y = plant(steps())
    y[list(MARKED)] = value
    [look] = signal_looks(recorded(y), "y", measured)
    assert (look.kind, look.level, look.figures["samples"]) == ("no_value", "warning", len(MARKED))
    assert f"8 samples of y are exactly {value:g} m, far from all others (" in look.sentence
    assert tomllib.loads(look.write) == {"missing": [value]}
    assert look.times == pytest.approx(T[list(MARKED)])


@pytest.mark.parametrize(("value", "size"), [(-999.0, 1.0), (9999.0, 0.1), (-32768.0, 30.0)])
@pytest.mark.parametrize("long", [15, 40])
def test_a_long_loss_of_a_level_is_no_end_of_its_sensor(value, size, long):
    """15 samples in a row of -999 beside levels of 1.3 to 5.9 dm were told as the lower end of the sensor."""
    y = size * (3.0 + plant(steps()))
    y[60 : 60 + long] = value
    [look] = signal_looks(recorded(y), "y", True)
    assert (look.kind, look.figures["samples"]) == ("no_value", long)
    assert tomllib.loads(look.write) == {"missing": [value]}
    ended = size * (3.0 + plant(steps()))
    ended = np.maximum(ended, np.quantile(ended, 0.1))  # an end that the signal comes to
    assert "no_value" not in kinds(ended)
    assert "clipped" in kinds(ended)


@pytest.mark.parametrize("kind", ["once", "unlike", "near", "rests", "switch", "steps"])
def test_what_only_looks_like_a_number_for_no_value_is_none(kind):
    y = plant(steps())
    if kind == "once":  # a spike
        y[57] = -999.0
    elif kind == "unlike":  # wrong readings, each another one
        y[list(MARKED)] = -999.0 - np.arange(8)
    elif kind == "near":  # an end of the sensor that is met again and again
        y[list(MARKED)] = np.max(y) + 0.3 * np.ptp(y)
    elif kind == "rests":  # a machine that is off for a while, several times
        y += 20.0
        y[100:120], y[300:330] = 0.0, 0.0
    elif kind == "switch":
        y = np.round(np.clip(plant(steps()), 0, 3))
        y[list(MARKED)] = 40.0
    elif kind == "steps":  # and goes on from elsewhere
        y[200:203] = 60.0
        y[203:] += 50.0
        y[400:402] = 200.0
        y[402:] += 100.0
    assert "no_value" not in kinds(y)


def test_the_number_is_not_told_where_it_was_converted():
    y = plant(steps())
    y[list(MARKED)] = -999.0
    r = recorded(y)
    r = Recording(r.t, r.signals, r.name, log=("y: converted from mm to m.",))
    [look] = signal_looks(r, "y", True)
    assert look.kind == "no_value"
    assert look.write == ""


def cooling_room(seed, end=None):
    """A room in degC read in steps of 0.1 K, whose coldest is where the heater comes on, after 570 samples; `end` of
    its sensor, in degC."""
    rng, walls, air, found = np.random.default_rng(seed), 10.0, 0.0, []
    for k in range(600):
        heated = 0 if 480 <= k < 570 else k // 12 % 2
        outside = 10.0 + (10.0 if k > 400 else 5.0) * np.sin(2 * np.pi * k / 96)
        found.append(walls + air)
        walls += 0.05 * (outside - walls)
        air += 0.3 * (8.0 * heated - air)
    y = np.array(found) + 0.03 * rng.normal(size=600)
    return np.round((y if end is None else np.maximum(y, end)) / 0.1) * 0.1


def test_a_plant_that_rests_until_an_input_moves_it_is_no_end_of_a_sensor():
    """It leaves fast, but came slowly: of ten such records one was told that "the sensor may end there"."""
    assert not any("clipped" in kinds(cooling_room(seed)) for seed in range(10))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_end_of_a_coarse_sensor_is_still_told(seed):
    found = [k for k in signal_looks(recorded(cooling_room(seed, 6.0)), "y", True) if k.kind == "clipped"]
    assert [(k.figures["value"], "sensor_low" in k.write) for k in found] == [(pytest.approx(6.0), True)]


def test_exchanged_columns_are_told_where_an_output_stays_level_and_an_input_does_not():
    """Of a temperature given as the input and its heater as the output only a closed loop was spoken of."""
    u = steps()
    r = Recording(T, {"u": Signal(plant(u), "degC"), "y": Signal(u, "%")}, "a")
    look = feedback_look(r, "u", "y")
    assert look is not None
    assert look.sentence.startswith("y, the output, stays level and jumps as an input does, and u, the input, moves ")
    assert "see whether their columns are exchanged. Past values of y explain " in look.sentence


def test_a_loop_is_not_called_an_exchange():
    rng, x, u, found = np.random.default_rng(2), 0.0, 0.0, []
    for _ in range(600):
        y = x + 0.02 * rng.normal()
        found.append((u, y))
        u = -1.5 * y  # acts at the next sample
        x = 0.9 * x + 0.2 * u + 0.3 * rng.normal()
    u, y = np.array(found).T
    look = feedback_look(recorded(y, u), "u", "y")
    assert look is not None
    assert "exchanged" not in look.sentence


@pytest.mark.parametrize("seed", range(20))
def test_a_signal_that_is_measured_seldom_has_no_gaps_but_long_ones(seed):
    rng, n = np.random.default_rng(seed), 361
    y = np.full(n, np.nan)
    y[rng.choice(n, 24, replace=False)] = rng.normal(size=24)

    def told(values):
        record = Recording(np.arange(n) * 30.0, {"c": Signal(values)}, "batch")
        return [look.figures["samples"] for look in signal_looks(record, "c", True) if look.kind == "missing"]

    assert told(y) == []
    dead = np.where(np.arange(n) < 140, rng.normal(size=n), np.nan)  # most of its samples are missing as well
    dead[-1] = 0.0
    assert told(dead) == [220]
    seldom = np.full(n, np.nan)
    seldom[::10], seldom[100:290] = 1.0 + rng.normal(size=37), np.nan
    assert told(seldom) == [199]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("moves", ["slowly", "quickly", "in jumps"])
@pytest.mark.parametrize(("noise", "told"), [(0.0, True), (0.1, True), (0.3, True), (0.8, False), (2.5, False)])
def test_levels_are_told_where_no_noise_carries_a_signal_across_them(noise, told, moves, seed):
    """With more noise than that a rounded model is no better than one that is not, and misses the mean."""
    rng, n, step = np.random.default_rng(seed), 800, 0.002
    y = {
        "slowly": 0.03 * np.sin(np.arange(n) / 90 + seed),
        "quickly": 0.03 * np.sin(np.arange(n) / 9 + seed),
        "in jumps": np.repeat(rng.uniform(-0.03, 0.03, n // 40), 40),
    }[moves]
    read = np.round((y + noise * step * rng.standard_normal(n)) / step) * step
    record = Recording(np.arange(float(n)), {"y": Signal(read)}, "run")
    kinds = [look.kind for look in signal_looks(record, "y", True)]
    assert ("quantised" in kinds) is told
