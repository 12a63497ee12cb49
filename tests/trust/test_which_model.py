"""Which of several models: statements on data whose truth is known, counted over many seeds, and true and false cases
of each sentence.

Models are fitted here by their closed forms, so that hundreds of records cost nothing;
`tests/face/test_compare_models.py` fits real ones.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.equal_models import apart

import plantfit as pf
from plantfit.trust.which_model.candidates import Candidate
from plantfit.trust.which_model.common_data import Series, series_of
from plantfit.trust.which_model.comparison import compared
from plantfit.trust.which_model.paired_losses import _at_worst, paired_difference
from plantfit.trust.which_model.sentences import told_apart

N = 1000
T = np.arange(float(N))


def noise(rng, memory, n=N):
    e = rng.normal(size=n + 200)
    for k in range(1, n + 200):
        e[k] = memory * e[k - 1] + np.sqrt(1 - memory**2) * e[k]
    return e[200:]


def inputs(rng):
    return np.repeat(rng.normal(size=N // 10), 10)


def regressed(name, columns, y, fitted, simulated_free=None):
    """A candidate that is linear in its parameters."""
    a = np.column_stack(columns)
    x = np.linalg.lstsq(a[fitted], y[fitted], rcond=None)[0]
    return Candidate(name, a.shape[1], float(a.shape[1]), (a @ x,))


def record(y, fitted, *candidates, unit="V"):
    series = (Series("r", "y", unit, T, y, fitted, ~fitted),)
    return compared(series, candidates, {"y": 1.0})


def trial(seed, truth, memory=0.0):
    """Data of `truth` among a line and a line with a bend; candidates "line" and "bend", nested, and "wave", which
    is not."""
    rng = np.random.default_rng(seed)
    u, fitted = inputs(rng), T < 0.6 * N
    shapes = {"line": 2 * u, "bend": 2 * u + 0.4 * u**2, "wave": 2 * np.sin(1.5 * u)}
    y = shapes[truth] + 0.3 * noise(rng, memory)
    one = np.ones(N)
    return record(
        y, fitted, regressed("line", [one, u], y, fitted), regressed("bend", [one, u, u**2], y, fitted),
        regressed("wave", [one, np.sin(1.5 * u)], y, fitted),
    )  # fmt: skip


@pytest.mark.parametrize("memory", [0.0, 0.6])
def test_the_bigger_of_nested_models_is_not_called_better_where_the_simpler_is_true(memory):
    wrong = sum(told_apart(trial(seed, "line", memory), "bend", "line") for seed in range(200))
    assert wrong <= 8, f"{wrong} of 200"  # 2.5 % of the 95 % by design, shared by three pairs


@pytest.mark.parametrize("memory", [0.0, 0.6])
def test_the_true_model_wins_over_a_wrong_one_nested_or_not(memory):
    found = [trial(seed, "bend", memory) for seed in range(60)]
    assert sum(told_apart(f, "bend", "line") for f in found) >= 57
    assert sum(told_apart(f, "bend", "wave") for f in found) >= 57
    assert not any(told_apart(f, other, "bend") for f in found for other in ("line", "wave"))
    waves = [trial(seed, "wave", memory) for seed in range(60)]
    assert sum(told_apart(f, "wave", "line") for f in waves) >= 57
    assert not any(told_apart(f, other, "wave") for f in waves for other in ("line", "bend"))


def test_one_model_written_twice_is_not_told_apart():
    for seed in range(50):
        rng = np.random.default_rng(seed)
        u, fitted = inputs(rng), T < 0.6 * N
        y = 2 * u + 0.3 * rng.normal(size=N)
        one = np.ones(N)
        a, b = regressed("a", [one, u], y, fitted), regressed("b", [one + u, one - 2 * u], y, fitted)
        b = Candidate("b", 2, 2.0, (b.simulated[0] * (1 + 1e-5),))  # as exact as simulations are
        found = record(y, fitted, a, b)
        assert not told_apart(found, "a", "b")
        assert not told_apart(found, "b", "a")
        assert found.verdict[0].sentence.startswith("The data do not tell")
        assert "predict alike" in found.verdict[0].sentence


@pytest.mark.parametrize(
    ("kind", "memory", "n"), [("waves", 0.0, 100), ("waves", 0.7, 300), ("own errors", 0.0, 300), ("waves", 0.95, 3000)]
)
def test_models_that_are_equally_wrong_are_told_apart_about_as_often_as_stated(kind, memory, n):
    share, _ = apart(kind, memory, n, 400)
    assert share <= 30 / 400  # 5 % by design; 31 or more of 400 have a chance of one in a hundred


def test_a_model_that_is_worse_is_told_as_often_as_by_blocks():
    ours, blocks = apart("worse", 0.0, 300, 200)
    assert ours > blocks - 0.05
    assert ours > 0.75


def test_the_interval_holds_the_difference_of_many_records():
    n, hits = 800, 0
    expected = np.sqrt(1.0 + 0.5) - 1.0  # of unit noise, and of a model that is off by a wave of mean square 0.5
    for seed in range(300):
        e = np.random.default_rng(seed).normal(size=n)
        d = paired_difference([e], [e + np.sin(2 * np.pi * np.arange(n) / 40)])
        hits += abs(d.value - expected) <= d.half_width
    assert 270 <= hits <= 297, f"{hits} of 300"


def test_a_model_that_drifts_away_is_judged_over_the_noise():
    e = np.random.default_rng(0).normal(size=200)
    d = paired_difference([e], [e + 0.2 * np.arange(200)])
    assert d.told
    assert d.over == "noise"
    assert not paired_difference([np.full(3, 1.0)], [np.full(3, 2.0)]).told  # three samples tell nothing


@pytest.mark.thorough
def test_slow_errors_of_equal_size_are_told_apart_at_most_as_often_as_stated():
    """Half a wave each over the record, of amplitudes that are drawn alike (4000 pairs: at most 6 %)."""
    rng, wave = np.random.default_rng(9), np.cos(np.pi * np.arange(100) / 99)
    sizes = np.sort(np.abs(rng.normal(size=(4000, 2)))) * rng.choice([-1, 1], (4000, 2))
    told = [paired_difference([a * wave], [b * wave]) for a, b in sizes]
    assert 40 < sum(d.told for d in told) < 240
    assert all((d.p < 0.05) == d.told for d in told)


def test_a_model_that_is_far_off_is_told_however_slow_errors_are():
    slow = 0.05 * np.cos(np.pi * np.arange(120) / 119)
    far = paired_difference([slow], [slow + 2.0 - 0.01 * np.arange(120)])
    assert far.told
    assert far.over == "noise"
    assert far.value - far.half_width > 0
    assert not paired_difference([slow], [4 * slow]).told


def test_a_simulation_that_is_not_finite_loses_and_is_said_to():
    y, fitted = np.random.default_rng(0).normal(size=N), T < 0.6 * N
    good = Candidate("good", 1, 1.0, (np.zeros(N),))
    lost = Candidate("lost", 2, 2.0, (np.where(T > 900, np.nan, 0.0),))
    found = record(y, fitted, good, lost)
    assert told_apart(found, "good", "lost")
    assert "cannot be simulated there" in found.verdict[0].sentence


def test_the_sentence_gives_both_errors_and_the_difference_with_its_unit():
    found = trial(3, "bend")
    sentence = found.verdict[0].sentence
    assert sentence.startswith("bend predicts unseen data best: RMSE 0.")
    assert " V (line, by 0." in sentence
    assert "±" in sentence
    assert found.verdict[1].sentence.startswith("AICc and BIC choose bend")


@pytest.mark.parametrize(("kept", "memory"), [(12, 0.0), (20, 0.98)])
def test_samples_too_few_for_a_comparison_are_told_with_a_memory_only_where_there_is_one(kept, memory):
    rng = np.random.default_rng(2)
    y, other = (slow(rng, memory, N) for _ in range(2))
    found = record(y, N - kept > T, Candidate("one", 1, 1.0, (0 * y,)), Candidate("other", 1, 1.0, (0.5 * other,)))
    said = found.verdict[0].sentence
    assert ("has a memory of" in said) is (memory > 0)
    assert (f"but {kept} samples are too few for a comparison; keep a longer part unseen" in said) is (memory == 0)


@pytest.mark.parametrize("kept", [1000, 12])
def test_a_linear_model_does_as_well_only_where_the_difference_is_known_to_be_small(kept):
    rng = np.random.default_rng(2)
    fitted = N - kept > T
    y, slow = 0.3 * noise(rng, 0.0), np.linspace(0.0, 1.0, N)
    own = Candidate("mine", 1, 1.0, (np.zeros(N),))
    same = Candidate("linear", 3, 3.0, (0.01 * rng.normal(size=N),), None, "linear", None, "A linear model of order 1")
    drifts = Candidate("linear", 3, 3.0, (0.6 * slow,), None, "linear", None, "A linear model of order 1")
    if kept == 1000:
        said = record(y, T < 0.5 * N, own, same).verdict[-1].sentence
        assert said.startswith("A linear model of order 1 does as well as mine: RMSE ")
    else:
        said = record(y, fitted, own, drifts).verdict[-1].sentence
        assert said.startswith("A linear model of order 1 and mine cannot be told apart: RMSE "), said


def test_a_linear_model_that_does_better_is_a_warning_and_one_that_does_not_is_none():
    rng = np.random.default_rng(1)
    fitted, y = T < 0.6 * N, rng.normal(size=N)
    near, far = np.zeros(N), np.sin(T / 5.0)
    for own, other, level in ((near, far, "good"), (far, near, "warning"), (near, near, "info")):
        linear = Candidate("linear", 3, 3.0, (other,), None, "linear", None, "A linear model of order 1")
        found = record(y, fitted, Candidate("mine", 1, 1.0, (own,)), linear)
        assert found.verdict[-1].level == level
        assert found.verdict[-1].sentence.startswith("A linear model of order 1")


def slow(rng, memory, n):
    """An AR(1) (n,) of standard deviation 1."""
    e, x = rng.normal(size=n + 400) * np.sqrt(1 - memory**2), np.zeros(n + 400)
    for k in range(1, n + 400):
        x[k] = memory * x[k - 1] + e[k]
    return x[400:]


@pytest.mark.parametrize("memory", [0.98, 0.995])
def test_a_model_ten_times_worse_is_told_however_slow_its_errors(memory):
    told = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        noise = 0.3 * rng.normal(size=60)
        told += paired_difference([noise], [noise + 3.0 * slow(rng, memory, 60)], 6).told
    assert told >= 0.6 * 60  # 7 to 15 % by as many numbers for both


def test_errors_worth_few_numbers_each_are_not_told_by_their_ratio():
    """Both models drift: of equally good ones the ratio of mean squares leaves F(1, 1) in 5 %, F(1, 20) in 5 %."""
    rng = np.random.default_rng(1)
    for other, own in ((1, 1), (1, 20), (3, 3)):
        ratios = (rng.chisquare(other, 4000) / other) / (rng.chisquare(own, 4000) / own)
        least = [_at_worst(1.0, r, (own, other), 1)[0] for r in ratios]
        told = np.mean(np.sqrt(ratios) - 1.0 > np.array(least))
        assert 0.015 <= told <= 0.035  # one side of 5 %


@pytest.mark.parametrize("named", ["", "t [s],"])
def test_rows_without_times_are_known_to_be_rows(tmp_path, named):
    x = np.linspace(0.0, 1.0, 12)
    rows = np.c_[x, 2.0 * x] if not named else np.c_[0.5 * np.arange(12), x, 2.0 * x]
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header=f"{named}x [V],y [V]", comments="")
    (tmp_path / "s.toml").write_text(
        'name = "s"\n[recording.r]\nfile = "r.csv"\n'
        + ('time = "t"\n' if named else "period = 1\n")
        + 'signals = { x = "x [V]", y = "y [V]" }\n[model]\nequations = "y = a*x"\ninputs = { x = "V" }\n'
        'outputs = { y = "V" }\n[parameters.a]\nbounds = [0, 5]\n'
    )
    series = series_of(pf.load(tmp_path / "s.toml").problem)
    assert [s.timed for s in series.values()] == [bool(named)]
