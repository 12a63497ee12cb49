"""Scheduled PIDs: the law against a plain PID and its linear loop, C, gains of several levels of a nonlinear plant."""

from dataclasses import replace

import numpy as np
import pytest
from test_tune_lqi import ServoProgram
from test_tune_pid import WISHES
from test_tune_pid import family as linear_family

import plantfit.runtime  # noqa: F401
from plantfit.control.c_export import scheduled_to_c
from plantfit.control.pid import Gains
from plantfit.control.scheduling.design import NAME, _form, scheduled_loops
from plantfit.control.scheduling.law import Schedule, scheduled_pid
from plantfit.control.scheduling.together import _schedule, _searches, refined
from plantfit.control.scheduling.told import schedule_told
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.frequency import frequencies, sampled_response
from plantfit.control.tune.loop_scores import Judge, Limits, pid_of_limits
from plantfit.control.tune.searching.judged import judged_on
from plantfit.control.tune.told import table, verdict
from plantfit.errors import SimulationError
from plantfit.findings.results.tuned_controller import ScheduledLoop
from plantfit.models.text.equations import equations

import jax
import jax.numpy as jnp

pytestmark = pytest.mark.thorough

LEVELS = np.array([1.0, 3.0, 6.0])
GAINS = Gains(
    *(
        np.array(v)
        for v in ([2.0, 5.0, 9.0], [0.2, 0.6, 1.5], [0.5, 1.0, 2.0], [0.6, 0.8, 1.0], [0.0] * 3, [0.3, 0.4, 0.5])
    )
)
# a heater with radiation: gain and lag fall as the temperature grows
RADIATING = equations(
    "y' = (K*delay(u, L) - y - s*y^4)/tau\nz = y", inputs={"u": "V"}, states={"y": "K"}, outputs={"z": "K"},
    parameters=["K", "tau", "L", "s"], name="radiating",
)  # fmt: skip
ASKED = Wishes(6.0, 0.5, 0.5, 0.5, -5.0, 60.0, controller="scheduled")


def family(n, seed):
    rng = np.random.default_rng(seed)

    def drawn(value, s):
        return np.r_[value, value * np.exp(s * rng.normal(size=n))]

    plants = {"K": 1.0, "tau": 20.0, "L": 2.0, "s": 0.02}
    return OneLoop(RADIATING, "z", "u", {}, {name: drawn(value, 0.05) for name, value in plants.items()})


def signals(n=3000):
    rng, k = np.random.default_rng(1), np.arange(n)
    r = 3.5 + 2.0 * np.sign(np.sin(k / 150.0))
    return r + 0.8 * np.sin(k / 37.0) + rng.normal(0, 0.05, n), r


def commands(law, given, y, r):
    _, u = jax.lax.scan(
        lambda s, k: law.update(s, k[0], k[1], given),
        law.init(jnp.asarray(y[0]), given),
        (jnp.asarray(y), jnp.asarray(r)),
    )
    return np.asarray(u)


@pytest.mark.parametrize("anti_windup", ["clamping", "back-calculation", "none"])
def test_with_the_same_gains_at_all_levels_it_is_the_plain_pid(anti_windup):
    one = Gains(3.0, 0.4, 1.0, 0.7, 0.0, 0.3)
    limits = Limits(-4.0, 4.0, 0.1 if anti_windup == "back-calculation" else 0.0)
    schedule = Schedule(LEVELS, Gains(*(np.full(3, v) for v in one)))
    y, r = signals()
    found = commands(scheduled_pid(0.5, anti_windup), (schedule, 1.0, limits), y, r)
    truth = commands(pid_of_limits(0.5, anti_windup), (one, 1.0, limits), y, r)
    assert found.min() == -5.0
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_gains_lie_on_straight_lines_and_stay_beyond_the_ends():
    schedule = Schedule(LEVELS, GAINS)
    for level, kp in ((0.0, 2.0), (1.0, 2.0), (2.0, 3.5), (3.0, 5.0), (4.5, 7.0), (9.0, 9.0)):
        assert float(schedule.at(level).Kp) == pytest.approx(kp)


def test_at_rest_nothing_moves_whatever_the_gains_do_between_levels():
    """The measurement creeps along with the reference: of errors of zero no gain makes a command, but for the weight
    of the set point."""
    law, given = (
        scheduled_pid(0.5, "clamping"),
        (Schedule(LEVELS, GAINS._replace(b=np.ones(3))), 1.0, Limits(-50.0, 50.0, 0.0)),
    )
    y = np.linspace(1.0, 6.0, 500)
    found = commands(law, given, y, y)
    rate = (y[1] - y[0]) / 0.5
    assert np.max(np.abs(found)) <= np.max(GAINS.Kd) * rate + 1e-9  # the derivative of the measurement alone


@pytest.mark.parametrize("anti_windup", ["clamping", "back-calculation", "none"])
def test_the_c_file_equals_python_over_ten_thousand_samples(tmp_path, anti_windup):
    y, r = signals(10_000)
    schedule, follow = Schedule(LEVELS, GAINS), 0.1 if anti_windup == "back-calculation" else 0.0
    given = (schedule, 1.0, Limits(-6.0, 9.0, follow))
    truth = commands(scheduled_pid(0.5, anti_windup), given, y, r) + 1.0
    settings = {
        "period": 0.5,
        "lower": -6.0,
        "upper": 9.0,
        "anti_windup": anti_windup,
        "tracking_time": 5.0 if follow else None,
    }
    program = ServoProgram(scheduled_to_c(schedule, tmp_path, name="levels", **settings))
    program.begin(y[0], 1.0)
    told = np.array([program.update(a, b) for a, b in zip(y, r, strict=True)])
    assert told.min() == -6.0
    assert told.max() == 9.0 or anti_windup == "none"  # that one winds up
    assert np.mean((told > -6.0) & (told < 9.0)) > (1e-3 if anti_windup == "none" else 0.1)
    np.testing.assert_allclose(told, truth, rtol=1e-12, atol=1e-10)


def test_what_cannot_be_is_said(tmp_path):
    with pytest.raises(SimulationError, match=r"A schedule needs two levels or more, and 1 is given"):
        scheduled_loops(family(3, 1), family(3, 2), ASKED, [2.0, 2.0])
    with pytest.raises(SimulationError, match=r"z at 12.5 K takes u = 500.8 V, beyond its limits -5 to 60 V"):
        scheduled_loops(family(3, 1), family(3, 2), ASKED, [2.0, 12.0])
    with pytest.raises(SimulationError, match=r"levels are \[3.0, 1.0\]; give two or more, ascending"):
        scheduled_to_c(Schedule(np.array([3.0, 1.0]), GAINS), tmp_path, period=0.5)


@pytest.fixture(scope="module")
def found():
    return scheduled_loops(family(20, 1), family(60, 2), ASKED, [1.0, 3.5, 6.0], budget=120, seed=3)


def test_one_pid_cannot_do_what_gains_over_the_level_do(found):
    """The plant's gain falls from 0.93 to 0.05 K/V between the levels."""
    design, report = found
    assert [r.level for r in report.levels] == [1.0, 3.5, 6.0]
    assert report.every >= 0.9
    assert np.max(report.single) < 0.2
    kp = [r.gains.Kp for r in report.levels]
    assert kp[2] > 1.5 * kp[0]
    assert design.best.form.name == NAME
    assert design.best.share == report.every
    assert [r.name for r in design.rows[:3]] == ["all plants", "best fit alone", "PID of this level alone"]
    first = table(design)[0]
    assert isinstance(first, ScheduledLoop)
    assert first.Kp == pytest.approx(kp)
    assert first.overshoot == pytest.approx(design.rows[0].scores.overshoot)
    assert np.all(report.across.overshoot < 30.0)
    told = [s.sentence for s in schedule_told(report, design, "z")]
    assert told[0].startswith(
        "These are the plants that keep the wishes at each of 3 levels; with one PID, that of z = "
    )
    assert "gains nothing" not in told[0]


def test_near_a_level_the_loop_is_that_of_the_gains_there(found):
    """A step of a thousandth: the same response as that of the plain PID of the level, its plants linear there."""
    design, report = found
    both = {}
    for name in (NAME, "PID"):
        judge = design.judges[name]
        small = replace(judge, course=replace(judge.course, start=design.wishes.set_point - 1e-3))
        small = replace(small, start=small.plant.at_rest(small.course.start, (-5.0, 20.0, 60.0)))
        both[name] = small.responses(design.best.parameters if name == NAME else report.levels[2].gains)["y"]
    half = design.course.begin
    np.testing.assert_allclose(both[NAME][:, :half], both["PID"][:, :half], atol=2e-6)


@pytest.fixture(scope="module")
def levels():
    """Designs of two levels, as `scheduled_loops` makes them."""
    plain = replace(ASKED, controller="pid", horizon=200.0)
    asked = [replace(plain, set_point=level) for level in (2.0, 3.5)]
    return [tuned_loop(family(6, 1), family(6, 1), there, budget=60, seed=3) for there in asked]


def kept(design, schedule):
    """Whether each plant of a design's level keeps what was asked for with the schedule."""
    form = _form(design, schedule)
    w = frequencies(ASKED.period, 20.0, 600)
    h = sampled_response(design.rest, ASKED.period, w)
    judge = Judge.of(design.family, design.judge.start, design.course, 0.0, form)
    return judged_on(judge, form, [schedule], h, w, design.wishes, 1).kept[0]


def test_levels_that_keep_their_limits_as_one_schedule_are_left_alone(levels):
    schedule = refined(levels, 20, 1, None)
    for k, design in enumerate(levels):
        assert [float(g[k]) for g in schedule.gains] == pytest.approx(list(design.best.gains), rel=1e-12)


@pytest.mark.slow
def test_levels_that_miss_them_as_one_schedule_are_searched_together(levels):
    """The gain of the second level is four times what it should be, and a step to the first ends between both."""
    space = levels[1].best.form.space
    wild = levels[1].point + (np.array(list(space.names)) == "K") * np.log(4.0) / np.log(1500.0)
    spoiled = [levels[0], replace(levels[1], point=np.clip(wild, 0.0, 1.0))]
    before = _schedule(_searches(spoiled), np.concatenate([d.point for d in spoiled]))
    assert np.mean(kept(levels[1], before)) < 0.5
    after = refined(spoiled, 60, 1, None)
    for design in levels:
        assert np.mean(kept(design, after)) >= 0.95


def test_a_schedule_that_the_best_fit_misses_is_not_blamed_on_a_parameter(found):
    """Measuring again helps where the best fit keeps what is asked for, and not where it misses that too."""
    design, _ = found
    n = design.family.count
    names = {"L": np.asarray(design.family.plants["L"])}
    kept, meets = np.zeros((len(design.rows), n), bool), design.judged.meets.copy()
    meets[0, :, 1] = False
    missed = replace(design, judged=design.judged._replace(kept=kept, meets=meets), rows=(
        replace(design.rows[0], share=0.0), *design.rows[1:]
    ))  # fmt: skip
    told = [s.sentence for s in verdict(missed, names)]
    assert "tuned on the best fit alone" not in told[0]
    assert any("the best fit misses it too, at one of the levels, so that measuring again does not" in s for s in told)
    assert not any("measure this first" in s or "comes from L" in s for s in told)
    kept = kept.copy()
    kept[0, : n // 2] = True
    order = np.argsort(names["L"])
    over = np.empty((1, n))
    over[0, order] = np.arange(n)
    scores = design.judged.scores
    scores = scores._replace(overshoot=np.concatenate([over, scores.overshoot[1:]]))
    some = replace(missed, judged=missed.judged._replace(kept=kept, scores=scores))
    told = " ".join(s.sentence for s in verdict(some, names))
    assert "measure this first, or ask for less. 100 % of the spread of overshoot comes from L" in told


@pytest.mark.slow
def test_a_tank_keeps_its_limits_as_one_schedule():
    """Two tanks with roots for outflows. Each level alone kept 10 % of overshoot, the gains between them did not."""
    tank = equations(
        "h1' = (kv*delay(u, L) - a1*sqrt(h1))/28\nh2' = (a1*sqrt(h1) - a2*sqrt(h2))/32\nh = h2", inputs=["u"],
        states={"h1": {"initial": "h"}, "h2": {"initial": "h"}}, outputs=["h"], parameters=["kv", "a1", "a2", "L"],
    )  # fmt: skip
    true = {"kv": 1.6, "a1": 12.0, "a2": 10.0, "L": 3.4}

    def tanks(n, seed):
        rng = np.random.default_rng(seed)
        return OneLoop(tank, "h", "u", {}, {k: v * np.r_[1, 1 + 2e-3 * rng.normal(size=n)] for k, v in true.items()})

    wishes = Wishes(20.0, 5.0, 6.0, 1.0, 0.0, 60.0, noise=0.144, controller="scheduled")
    design, report = scheduled_loops(tanks(20, 1), tanks(60, 2), wishes, [8.0, 16.0, 25.0, 33.0], budget=200, seed=1)
    assert report.every >= 0.95
    assert design.promised


@pytest.mark.slow
def test_on_a_linear_plant_the_schedule_gains_nothing():
    """A plant whose gains are the same at all levels: one PID does as well."""
    wishes = replace(WISHES, controller="scheduled")
    design, report = scheduled_loops(linear_family(10, 1), linear_family(30, 2), wishes, [4.0, 6.0], budget=300, seed=3)
    assert report.every >= 0.9
    assert np.max(report.single) >= report.every - 0.01
    assert schedule_told(report, design, "z")[0].sentence.endswith(": the schedule gains nothing here.")
