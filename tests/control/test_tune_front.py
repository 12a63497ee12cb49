"""Figures, limits and fronts of tuned loops: margins of the search against those of the verdict, ITAE by a sum,
points that trade."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_tune_pid import WISHES, family

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.tune import tuned_loop
from plantfit.control.tune.frequency import frequencies, margins, margins_in_search, pid_response, sampled_response
from plantfit.control.tune.loop_design import _picked
from plantfit.control.tune.searching.figures import MEANING, weights_of
from plantfit.control.tune.searching.front import Front, directions, undominated
from plantfit.control.tune.told import verdict
from plantfit.control.tune.wishes import check_wishes
from plantfit.errors import SimulationError, SpecError

pytestmark = pytest.mark.thorough

NOISY = replace(WISHES, noise=0.05)


def test_undominated_rows_are_those_that_a_plain_search_finds():
    rng = np.random.default_rng(3)
    for m in (2, 3):
        f = np.round(rng.random((60, m)), 1)  # with ties
        plain = [i for i in range(60) if not any(np.all(g <= f[i]) and np.any(g < f[i]) for g in f)]
        assert list(undominated(f)) == plain


@pytest.mark.parametrize(("m", "count"), [(2, 3), (2, 9), (3, 3), (3, 10), (3, 15)])
def test_directions_add_up_to_one_and_are_as_many_as_asked_for(m, count):
    shares = directions(m, count)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    assert np.all(shares > 0)
    assert count <= len(shares) <= 2 * count
    assert len(np.unique(shares.round(9), axis=0)) == len(shares)


def test_margins_on_the_grid_of_the_search_are_those_of_the_verdict():
    """Of 60 plants under four PIDs; 200 frequencies against 4000."""
    plants = family(60, 5)
    rest = plants.at_rest(5.0, (-10.0, 0.0, 10.0))
    coarse, fine = (frequencies(0.5, 12.0, n) for n in (200, 4000))
    for kp, ki, kd in ((1.0, 0.1, 0.0), (2.0, 0.2, 1.0), (1.5, 0.15, 2.0), (0.3, 0.05, 0.0)):
        gains = Gains(kp, ki, kd, 1.0, 0.0, 0.3)
        truth = margins(pid_response(gains, 0.5, fine)[None] * sampled_response(rest, 0.5, fine), fine, 1)
        gain, phase = margins_in_search(pid_response(gains, 0.5, coarse)[None] * sampled_response(rest, 0.5, coarse))
        stable = truth.stable
        assert np.sum(stable) > 30
        np.testing.assert_allclose(np.asarray(gain)[stable], truth.gain[stable], rtol=0.03)
        np.testing.assert_allclose(np.asarray(phase)[stable], truth.phase[stable], atol=1.0)


def test_what_cannot_be_asked_for_is_one_sentence():
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"minimise": {}}, "weighs nothing"), ({"minimise": {"iae": 0.0}}, "weighs nothing"),
        ({"minimise": {"iae": -1.0}}, "weighs nothing"),
        ({"gain_margin": 0.9}, r"gain_margin = 0.9 cannot be asked for; give 1 or more"),
        ({"settling": 0.0}, "settling = 0 cannot"),
        ({"phase_margin": 190.0}, "give 0 up to 180"), ({"travel": -1.0}, "travel = -1 cannot"),
    ]  # fmt: skip
    for change, message in wrong:
        with pytest.raises(SimulationError, match=message):
            check_wishes(replace(WISHES, **change))
    for front, points, pick, message in (
        (("iae", "size"), 9, None, "front names 'size'; the figures are iae, itae"),
        (("iae",), 9, None, "two or three different figures"),
        (("iae", "iae"), 9, None, "two or three different figures"),
        (("iae", "travel"), 2, None, "give 3 to 100"),
        ((), 9, 1, "pick chooses a point of a front"),
    ):
        with pytest.raises(SpecError, match=message):
            tuned_loop(family(3, 1), family(3, 2), WISHES, front=front, points=points, pick=pick)
    with pytest.raises(SpecError, match="minimise names 'size'"):
        tuned_loop(family(3, 1), family(3, 2), replace(WISHES, minimise={"size": 1.0}))


def test_weights_are_shares():
    assert weights_of({"iae": 3.0, "travel": 1.0, "itae": 0.0}) == {"iae": 0.75, "travel": 0.25}


@pytest.fixture(scope="module")
def told():
    return []


@pytest.fixture(scope="module")
def line(told):
    figures = ("load_iae", "travel")
    return tuned_loop(
        family(20, 1), family(40, 2), NOISY, budget=150, seed=3, front=figures, points=5, pick=1, progress=told.append
    )


def test_every_part_is_told_as_it_begins_and_searches_are_counted_to_the_last(line, told):
    begun = [p.part for p in told if p.begins]
    searches = [part for part in begun if part.startswith("search ")]
    assert [part.split(" (")[0] for part in searches] == [f"search {k} of 9" for k in range(1, 10)]
    assert searches[0].endswith("(PID, best fit alone)")
    assert searches[-1].endswith("(front, point 5 of 5)")
    assert begun[0] == "bringing the plants to rest"
    assert begun[-1] == "judging the controllers on fresh plants"
    assert {p.part for p in told if not p.begins} == set(searches)


def test_no_point_of_a_front_is_better_in_both_figures_and_the_picked_one_is_the_controller(line):
    front = line.front
    assert 4 <= len(front.figures) <= 9
    load, travel = front.figures.T
    assert np.all(np.diff(load) > 0)
    assert np.all(np.diff(travel) < 0)
    assert travel[0] > 1.5 * travel[-1]
    assert line.best.parameters == front.controllers[0]
    assert line.best.source == f"point 1 of {len(front.figures)} of the front"
    assert line.best.scores.load_iae == pytest.approx(load[0])
    told = [v.sentence for v in verdict(line, {})]
    assert not any("slower on the best fit" in sentence for sentence in told)


def test_itae_is_the_sum_of_time_and_error(line):
    seen = line.judge.responses(line.best.parameters)
    half = line.course.begin
    t, y = seen["t"][:half], seen["y"][:, :half]
    plain = np.sum(0.5 * (t + 0.25) * np.abs(5.0 - y), axis=1) / 2.0
    np.testing.assert_allclose(line.judged.scores.itae[0], plain, rtol=1e-9)
    assert set(MEANING) - {"input_noise"} <= set(line.judged.scores._fields)


def test_a_pick_that_there_is_not_is_said():
    front = Front(("load_iae", "travel"), np.eye(3), np.eye(3))
    assert _picked(front, 3, np.zeros(3))[0] is not None
    for pick in (0, 4):
        with pytest.raises(
            SpecError, match=rf"The front has 3 points, and pick = {pick} is none of them; give 1 to 3."
        ):
            _picked(front, pick, np.zeros(3))


@pytest.mark.slow
def test_limits_that_are_asked_for_besides_are_kept_and_another_weight_moves_the_answer():
    plain = tuned_loop(family(40, 1), family(80, 2), NOISY, budget=250, seed=3)
    wide = tuned_loop(
        family(40, 1), family(80, 2), replace(NOISY, gain_margin=6.0, phase_margin=65.0), budget=250, seed=3
    )
    calm = tuned_loop(
        family(40, 1), family(80, 2), replace(NOISY, minimise={"iae": 1.0, "travel": 3.0}), budget=250, seed=3
    )
    assert plain.best.margins.gain < 5.5
    assert wide.best.margins.gain >= 6.0
    assert wide.best.margins.phase >= 65.0
    assert wide.best.share >= 0.9
    assert calm.best.scores.travel < 0.8 * plain.best.scores.travel
    first = verdict(wide, {})[0].sentence
    assert "an Ms under 1.6, have a gain margin of 6, have a phase margin of 65 deg;" in first
