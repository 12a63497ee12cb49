"""PIDs tuned over families of plants of known distribution, against plain numpy loops and fresh draws; and what must
be refused."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.forms.pid_form import pid_form
from plantfit.control.tune.frequency import frequencies, poles_outside, sampled_response
from plantfit.control.tune.loop_design import BEST_FIT
from plantfit.control.tune.loop_scores import Judge
from plantfit.control.tune.plant_checks import sign_of
from plantfit.control.tune.proposals import noise_of, quantum_of
from plantfit.control.tune.reduction import reduced
from plantfit.control.tune.rules import RULES, rule_gains
from plantfit.control.tune.searching.judged import judged_on
from plantfit.control.tune.searching.search import Search
from plantfit.control.tune.told import table, verdict
from plantfit.control.tune.wishes import range_of
from plantfit.errors import SearchError, SimulationError
from plantfit.findings.results.tuned_controller import PidLoop
from plantfit.loop_of_study import _Asked
from plantfit.models.text.equations import equations
from plantfit.recording import from_arrays
from plantfit.spec.tables import ControlTable

import jax.numpy as jnp

LAG = equations(
    "y' = (c + K*delay(u, L) - y)/tau\nz = y", inputs={"u": "V"}, states={"y": "K"}, outputs={"z": "K"},
    parameters=["K", "tau", "L", "c"], name="lag",
)  # fmt: skip
WISHES = Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0)


def family(n, seed, sign=1.0, spread=1.0):
    """The best fit, then n draws: gain 10 %, lag 10 %, dead time 20 % (standard deviations of logarithms)."""
    rng = np.random.default_rng(seed)

    def drawn(value, s):
        return np.r_[value, value * np.exp(spread * s * rng.normal(size=n))]

    return OneLoop(
        LAG,
        "z",
        "u",
        {},
        {"K": sign * drawn(2.0, 0.1), "tau": drawn(10.0, 0.1), "L": drawn(2.0, 0.2), "c": np.ones(n + 1)},
    )


@pytest.fixture(scope="module")
def design():
    return tuned_loop(family(60, 1), family(150, 2), WISHES, budget=200, seed=3)


def simulated(design, gains, i, fine=50):
    """The loop of plant i in plain numpy: PID of control.pid, dead time by a list of past inputs, exact lag over
    fine steps."""
    p = {n: float(v[i]) for n, v in design.family.plants.items()}
    w, h = design.wishes, design.wishes.period
    start, n = w.set_point - w.step, design.course.samples
    y, u0 = start, (start - p["c"]) / p["K"]
    past, integral = [u0] * 400, u0 - gains.Kp * (gains.b - 1) * start
    derivative = last_e = 0.0
    last_w, ys = -start, []
    decay = np.exp(-h / fine / p["tau"])
    for k in range(n):
        ys.append(y)
        e, weighted = w.set_point - y, -y
        added = 0.5 * h * gains.Ki * (e + last_e)
        derivative = (gains.filter_time * derivative + gains.Kd * (weighted - last_w)) / (gains.filter_time + h)
        wanted = gains.Kp * (gains.b * w.set_point - y) + integral + added + derivative
        u = min(max(wanted, w.lower), w.upper)
        if not ((wanted > w.upper and added > 0) or (wanted < w.lower and added < 0)):
            integral += added
        last_e, last_w = e, weighted
        past.append(u)
        for j in range(fine):
            at = (k + (j + 0.5) / fine) - p["L"] / h
            drive = past[int(np.floor(at)) + 400] + (w.load if k >= design.course.begin else 0.0)
            goal = p["c"] + p["K"] * drive
            y = goal + (y - goal) * decay
    return np.array(ys)


def test_scores_and_responses_are_those_of_a_plain_simulation(design):
    seen = design.judge.responses(design.best.gains)
    half = design.course.begin
    for i in (0, 3, 17):
        y = simulated(design, design.best.gains, i)
        # the list of past inputs rounds the dead time to a hundredth of a second
        np.testing.assert_allclose(seen["y"][i], y, atol=0.02)
        scores = design.judged.scores
        assert scores.overshoot[0, i] == pytest.approx(100 * max(0.0, np.max(y[:half]) - 5.0) / 2.0, abs=1.0)
        assert scores.iae[0, i] == pytest.approx(0.5 * np.sum(np.abs(5.0 - y[:half])) / 2.0, rel=0.02)
        assert scores.load_iae[0, i] == pytest.approx(0.5 * np.sum(np.abs(5.0 - y[half:])), rel=0.03)


def test_more_of_the_plants_keep_the_wishes_than_with_the_best_fits_own_tuning(design):
    alone = design.row(BEST_FIT)
    assert design.best.share >= 0.95
    assert alone.share < design.best.share - 0.1
    assert alone.scores.iae < design.best.scores.iae * 1.3
    told = verdict(design, {n: v for n, v in design.family.plants.items() if np.ptp(v)})
    assert told[0].level == "good"
    assert (
        f"{100 * design.best.share:.0f} % have an overshoot under "
        "10 % and an Ms under 1.6; tuned on the best fit alone: " in told[0].sentence
    )


@pytest.mark.thorough
def test_the_promised_share_holds_on_a_thousand_fresh_plants(design):
    fresh = family(1000, 77)
    rests = [fresh.at_rest(level, (-10.0, 0.0, 10.0)) for level in (3.0, 5.0)]
    judge = Judge.of(fresh, rests[0], design.course, 0.0, design.best.form)
    w = frequencies(0.5, 12.0, 1200)
    h = sampled_response(rests[1], 0.5, w)
    for row in design.rows[:2]:
        found = judged_on(judge, row.form, [row.gains], h, w, WISHES, 1)
        # 0.03 and the sampling of a share by 150 plants, three standard deviations
        assert float(np.mean(found.kept)) == pytest.approx(
            row.share, abs=0.03 + 3 * np.sqrt(row.share * (1 - row.share) / 150)
        )
    assert (
        float(
            np.mean(
                judged_on(
                    judge, design.best.form, [design.best.gains], sampled_response(rests[1], 0.5, w), w, WISHES, 1
                ).kept
            )
        )
        > 0.92
    )


@pytest.mark.thorough
def test_a_plant_of_negative_gain_gets_the_same_controller_with_the_other_sign():
    wishes = Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0)
    other = Wishes(5.0, 2.0, -0.2, 0.5, -10.0, 10.0)
    one = tuned_loop(family(5, 1), family(20, 2), wishes, budget=40, seed=3)
    two = tuned_loop(family(5, 1, sign=-1.0), family(20, 2, sign=-1.0), other, budget=40, seed=3)
    assert (one.sign, two.sign) == (1, -1)
    assert two.best.gains.Kp == pytest.approx(-one.best.gains.Kp, rel=1e-6)
    assert two.best.scores.iae == pytest.approx(one.best.scores.iae, rel=1e-6)


@pytest.mark.thorough
def test_data_that_are_too_poor_are_told_with_the_parameter_to_blame():
    rng = np.random.default_rng(5)
    wide = np.r_[2.0, np.exp(rng.uniform(np.log(0.2), np.log(20.0), 80))]
    plants = {"K": np.full(81, 2.0), "tau": np.full(81, 10.0), "L": wide, "c": np.ones(81)}
    loop = OneLoop(LAG, "z", "u", {}, plants)
    # within the 30 s of the step no loop comes to rest behind a dead time of 20 s with so little sensitivity
    found = tuned_loop(loop, loop, Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0, share=0.99, horizon=60.0, ms=1.2), budget=40)
    told = " ".join(v.sentence for v in verdict(found, {"L": wide, "K": plants["K"]}))
    assert not found.promised
    assert "99 % were asked for" in told
    assert "measure this first" in told
    assert "misses it too" not in told
    assert "comes from L: measure it better" in told


def test_plants_of_the_other_sign_are_counted_and_told(design):
    mixed = OneLoop(
        LAG,
        "z",
        "u",
        {},
        {"K": np.array([2.0, -2.0, 1.0, 3.0]), "tau": np.full(4, 10.0), "L": np.full(4, 2.0), "c": np.ones(4)},
    )
    sign, wrong = sign_of(mixed.at_rest(5.0, (-10.0, 0.0, 10.0)))
    assert sign == 1
    np.testing.assert_array_equal(wrong, [False, True, False, False])
    sentence = "25 % of the plants have a gain of the other sign, which no controller of one sign can hold."
    assert sentence in [v.sentence for v in verdict(replace(design, right_sign=0.75), {})]
    assert sentence not in [v.sentence for v in verdict(design, {})]


JOINT = equations(
    "q' = w\nw' = (u - d*w - k*(q - r) - a*(w - v))/J\nr' = v\nv' = (k*(q - r) + a*(w - v) - c*v)/I\nz = r",
    inputs=["u"], states=["q", "w", "r", "v"], outputs=["z"], parameters=["J", "I", "k", "d", "a", "c"], name="joint",
)  # fmt: skip


def joint(n=2):
    """A flexible joint, known to a thousandth: motor and load on a spring that hardly damps, the load is measured."""
    known = {"J": 2e-3, "I": 6e-3, "k": 3.0, "d": 0.03, "a": 0.01, "c": 0.002}
    rng = np.random.default_rng(4)
    return OneLoop(JOINT, "z", "u", {}, {p: v * np.r_[1, 1 + 1e-3 * rng.normal(size=n)] for p, v in known.items()})


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.thorough
def test_a_search_that_pays_for_speed_begins_again_within_the_limits(seed):
    """With the input at its limits an unstable loop swings only so far, and its figures are those of a fast one."""
    wishes = Wishes(1.5708, 9.4, 0.2, 0.004, -1.0, 1.0, quantum=0.0015)
    found = tuned_loop(joint(), joint(), wishes, budget=150, seed=seed)
    assert found.best.margins.stable
    assert found.best.share == 1.0
    rule = found.row("AMIGO")  # keeps the limits, slowly; faster rules do not
    assert rule is not None
    assert rule.share == 1.0
    assert found.best.scores.iae < 0.5 * rule.scores.iae


def test_poles_outside_are_those_of_the_closed_polynomial():
    """z = a - k of the loop k/(z - a), in numpy and in the program of a search."""
    w = np.geomspace(1e-4, np.pi, 400)
    for a, k, outside in ((0.9, 1.0, 0), (0.9, 2.0, 1), (0.9, -0.3, 1), (1.2, 0.5, 0), (1.2, 0.1, 1), (1.2, 2.5, 1)):
        loop = k / (np.exp(1j * w) - a)[None]
        for xp in (np, jnp):
            assert poles_outside(xp.asarray(loop), 0, int(a > 1), xp) == outside, (a, k)


@pytest.mark.thorough
def test_what_no_measurement_helps_is_not_blamed_on_a_parameter(design):
    """Behind a dead time no loop is this fast, however well the plant is known."""
    impossible = replace(WISHES, settling=1.5)
    one = family(12, 1, spread=0.01)
    found = tuned_loop(one, one, impossible, budget=20, seed=3)
    told = " ".join(v.sentence for v in verdict(found, dict(one.plants)))
    assert "settling 1.5 s on 0 %): the best fit misses it too, with the PID that was tuned on it alone" in told
    assert "measuring again does not help. Ask for less" in told
    assert "measure" not in told.replace("measuring again", "")
    assert "misses it too" not in " ".join(v.sentence for v in verdict(design, dict(design.family.plants)))


@pytest.mark.thorough
def test_an_integrating_plant_is_tuned():
    tank = equations(
        "y' = K*delay(u, L) + leak\nz = y",
        inputs=["u"],
        states=["y"],
        outputs=["z"],
        parameters=["K", "L", "leak"],
        name="tank",
    )
    n = 12
    rng = np.random.default_rng(2)
    plants = {"K": 0.1 * np.r_[1, np.exp(0.1 * rng.normal(size=n))],
              "L": 2 * np.r_[1, np.exp(0.1 * rng.normal(size=n))],
              "leak": np.full(n + 1, -0.05)}  # fmt: skip
    loop = OneLoop(tank, "z", "u", {}, plants)
    found = tuned_loop(loop, loop, Wishes(2.0, 1.0, 0.2, 0.5, -5.0, 5.0, ms=1.8, overshoot=30.0), budget=80)
    assert found.reduced.integrating
    assert found.reduced.first_order[2] == pytest.approx(2.25)
    assert found.best.margins.stable
    assert found.best.scores.left < 0.05
    assert found.row("lambda") is None


def refused(model, plants, wishes, **more):
    def call():
        loop = OneLoop(model, "z", "u", {}, {n: np.atleast_1d(float(v)) for n, v in plants.items()})
        return tuned_loop(loop, loop, wishes, **more)

    with pytest.raises(SimulationError) as caught:
        call()
    return str(caught.value)


def test_what_cannot_be_tuned_is_said():
    plain = {"K": 2.0, "tau": 10.0, "L": 2.0, "c": 1.0}
    said = refused(LAG, plain, Wishes(50.0, 2.0, 0.2, 0.5, -10.0, 10.0))
    assert "z at 48 K takes u = 23.5 V, beyond its limits -10 to 10 V" in said
    assert "They hold about -19 to 21 K" in said
    assert "is unstable at z = 5 K: a pole at +0.1 1/s" in refused(LAG, plain | {"tau": -10.0}, WISHES)
    assert "shorter than four times the dead time" in refused(
        LAG, plain, Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0, horizon=5.0)
    )
    said = refused(LAG, plain | {"K": 0.0}, WISHES)
    assert said.startswith("No constant u was found that holds z at 3 K. With any constant u from -10 to 10 V z rests")
    assert said.endswith("rests at 1 K. Choose another set point or step.")
    assert "Against a load of 9 V" in refused(LAG, plain, Wishes(5.0, 2.0, 9.0, 0.5, -5.0, 10.0))
    drift = equations(
        "y' = K*u + d - y\nd' = 0*u\nz = y",
        inputs=["u"],
        states=["y", "d"],
        outputs=["z"],
        parameters=["K"],
        name="drift",
    )
    assert "u does not reach 'd', which keeps any value that it has" in refused(drift, {"K": 1.0}, WISHES)
    grows = equations(
        "y' = K*u + d - y\nd' = d\nz = y",
        inputs=["u"],
        states=["y", "d"],
        outputs=["z"],
        parameters=["K"],
        name="grows",
    )
    assert "is unstable at z = 5: a pole at +1 1/s" in refused(grows, {"K": 1.0}, WISHES).replace("z = 5 :", "z = 5:")
    static = equations("z = k*u", inputs=["u"], outputs=["z"], parameters=["k"], name="gain")
    assert "is static" in refused(static, {"k": 1.0}, WISHES)
    assert "samples of 0.001 s; give a longer period" in refused(
        LAG, plain, Wishes(5.0, 2.0, 0.2, 0.001, -10.0, 10.0, horizon=500.0)
    )
    double = equations(
        "v' = K*u\ny' = v\nz = y", inputs=["u"], states=["v", "y"], outputs=["z"], parameters=["K"], name="cart"
    )
    assert "2 integrators" in refused(double, {"K": 1.0}, WISHES)
    assert "share = 1 cannot be promised" in refused(LAG, plain, Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0, share=1.0))


def test_a_range_with_an_open_end_is_told_in_words():
    assert [range_of(*ends) for ends in ((-np.inf, 20.0), (3.0, np.inf), (3.0, 20.0))] == [
        "at or below 20", "at or above 3", "within 3 and 20",
    ]  # fmt: skip
    said = refused(
        LAG, {"K": 2.0, "tau": 10.0, "L": 2.0, "c": 1.0}, Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0, output_upper=4.0)
    )
    assert "The output is to stay at or below 4, and the step goes from 3 to 5; choose another set point" in said


@pytest.mark.parametrize("unit", ["", "V"])
def test_proposals_have_the_unit_of_their_signal_or_none(unit):
    u, y = np.repeat([0.25, 0.55], 50), np.round(np.linspace(0, 0.3, 100), 2)
    own = from_arrays(np.arange(100.0), signals={"u": (u, unit or None), "y": (y, unit or None)})
    model = SimpleNamespace(inputs={"u": unit or "1"}, outputs={"y": unit or "1"})
    answer: Any = SimpleNamespace(problem=SimpleNamespace(experiments={"a": SimpleNamespace(recording=own)}))
    loop: Any = SimpleNamespace(model=model, input="u", output="y")
    proposed: dict[str, str] = {}
    asked = _Asked(answer, loop, ControlTable(), own, proposed)
    assert asked.limits() == (0.25, 0.55)
    asked.sensor()
    end = f" {unit}" if unit else ""
    assert proposed["lower"] == f"0.25{end}, the lowest u of the recordings"
    assert proposed["quantum"].startswith(f"0.01{end}, the steps")
    assert " ," not in " ".join(proposed.values())


def test_what_a_recording_tells_of_its_sensor():
    rng = np.random.default_rng(3)
    slow = 20 + 5 * np.sin(np.arange(500) / 40)
    assert quantum_of(np.round(slow / 0.25) * 0.25) == pytest.approx(0.25)
    assert quantum_of(slow + rng.normal(0, 0.1, 500)) == 0.0
    for _ in range(40):  # a speed from counts: most of its values come once
        n, step = int(rng.integers(100, 2000)), 10 ** rng.uniform(-3, 2)
        moves = step * rng.uniform(0.6, 30) * n * np.sin(np.arange(n) / 40) + step * rng.normal(0, 1, n)
        assert quantum_of(np.pi / 30 * step * np.round(moves / step)) == pytest.approx(np.pi / 30 * step)
        assert quantum_of(moves) == 0.0
        assert quantum_of(1 / (2.0 + np.round(40 * np.sin(np.arange(n) / 40) + 50))) == 0.0  # steps that differ
    assert noise_of(slow + rng.normal(0, 0.1, 500)) == pytest.approx(0.1, rel=0.15)


@pytest.mark.slow
def test_plants_may_be_weighed_by_their_mean_or_the_worst_of_them():
    """The mean is faster in the mean, the worst case faster on the slowest of the plants that were searched on."""
    found = {}
    for over in ("expected", "worst"):
        found[over] = tuned_loop(
            family(60, 1), family(60, 1), replace(WISHES, over=over, ms=3.0, overshoot=80.0), budget=300, seed=3
        )
    costs = {
        k: np.asarray(d.judged.scores.iae[0]) + np.asarray(d.judged.scores.load_iae[0]) / 0.36 for k, d in found.items()
    }
    assert np.mean(costs["expected"]) < np.mean(costs["worst"])
    assert np.max(costs["worst"]) < np.max(costs["expected"])


def test_shares_of_each_specification_stand_beside_that_of_all(design):

    first, alone = table(design)[:2]
    assert list(first.meets) == ["stable", "overshoot 10 %", "Ms 1.6", "at the set point"]
    for i, row in enumerate((first, alone)):
        assert row.meets["overshoot 10 %"] == pytest.approx(np.mean(design.judged.scores.overshoot[i] <= 10.0))
        assert row.meets["Ms 1.6"] == pytest.approx(np.mean(design.judged.ms[i] <= 1.6))
        assert row.share <= min(row.meets.values()) + 1e-12
    assert alone.meets["Ms 1.6"] < first.meets["Ms 1.6"]


@pytest.mark.further(1)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_output_that_an_input_moves_at_once_gets_gains_below_its_inverse(sign):
    """A cell of 5000 As/V behind 0.035 Ohm: the rules see an integrator, and with their gains no loop is stable."""
    cell = equations(
        "q' = u/C\nz = q + R*u", inputs={"u": "A"}, states={"q": "V"}, outputs={"z": "V"}, parameters=["C", "R"],
        name="cell",
    )  # fmt: skip
    rng = np.random.default_rng(0)
    own = {
        "C": sign * 5000.0 * np.exp(0.05 * rng.normal(size=41)),
        "R": sign * 0.035 * np.exp(0.1 * rng.normal(size=41)),
    }
    cells = OneLoop(cell, "z", "u", {}, own)
    found = tuned_loop(cells, cells, Wishes(3.85, 0.07, 0.5, 2.0, -2.0, 4.0), budget=100, seed=1)
    first, alone, *ruled = table(found)
    assert first.meets["stable"] == alone.meets["stable"] == 1.0
    assert first.share >= 0.95
    assert isinstance(first, PidLoop)
    assert 0.01 < sign * first.Kp * 0.035 < 1.0
    assert all(row.meets["stable"] == 0.0 for row in ruled)


def test_what_an_input_moves_at_once_changes_no_search_where_the_rules_would_not_feel_it():
    plants = {"K": np.array([2.0]), "tau": np.array([10.0]), "L": np.array([2.0]), "c": np.ones(1)}
    small = reduced(OneLoop(LAG, "z", "u", {}, plants).at_rest(5.0, (0.0, 1.0)))
    rules = {n: isa for n in RULES if (isa := rule_gains(n, small, True)) is not None}
    usual, little, much = (pid_form(small, 1, WISHES, rules, None, d) for d in (0.0, 0.1, 3.0))
    assert np.array_equal(usual.starts, little.starts)
    assert np.array_equal(usual.space.lower, little.space.lower)
    assert len(much.starts) == len(rules) + 1
    assert 3.0 * much.space.lower[much.space.names.index("K")] < 0.05


def test_every_rule_lies_within_the_bounds_of_the_search():
    """Of a plant that is slow and hardly late SIMC has 500 times the gain of lambda tuning."""
    plants = {"K": np.array([2.0]), "tau": np.array([1000.0]), "L": np.array([0.5]), "c": np.ones(1)}
    small = reduced(OneLoop(LAG, "z", "u", {}, plants).at_rest(5.0, (0.0, 1.0)))
    rules = {n: isa for n in RULES if (isa := rule_gains(n, small, True)) is not None}
    form = pid_form(small, 1, WISHES, rules, None)
    found = {n: float(form.build(z, form.data).Kp) for n, z in zip(rules, form.starts, strict=True)}
    assert found["lambda"] == pytest.approx(rules["lambda"].K, rel=0.01)
    assert found["SIMC"] > 100 * found["lambda"]


@pytest.mark.thorough
def test_loops_that_no_controller_keeps_finite_are_counted_with_what_to_do():
    """Three plants of nine leave their rest by e^6 in a sample, and the data allow them."""
    model = equations(
        "x' = (u - x)/5 + g*x^3\nz = x", inputs=["u"], states=["x"], outputs=["z"], parameters=["g"], name="escaping"
    )
    plants = OneLoop(model, "z", "u", {}, {"g": np.array([0.01] * 6 + [20.0, 22.0, 25.0])})
    counted = r"3 of 9 loops end where the model has no number.*\(g is 20 to 25 there\)"
    with pytest.raises(SearchError, match=counted) as e:
        tuned_loop(plants, plants, Wishes(0.7, 0.6, 0.2, 0.2, -20.0, 20.0), budget=20, seed=1)
    assert "that of the best fit does not" in str(e.value)
    assert "measure again (`plantfit design` says how), or give a smaller step" in str(e.value)


@pytest.mark.parametrize(
    ("iae", "said"), [([np.nan], "the loop of the best fit ends"), ([np.nan, 1.0, np.inf], "2 of 3 loops, that of the")]
)
def test_where_the_best_fit_is_lost_measuring_again_is_not_advised(iae, said):
    scores = SimpleNamespace(iae=np.array([iae]), load_iae=np.ones((1, len(iae))))
    search = SimpleNamespace(
        form=SimpleNamespace(name="PID", made=lambda z: Gains(*np.ones(6))),
        judge=SimpleNamespace(scores=lambda controllers: scores), sizes={"iae": 1.0, "load_iae": 1.0},
    )  # fmt: skip
    told = Search._why_not_finite(search, np.zeros(3))  # pyrefly: ignore[bad-argument-type]
    assert said in told
    assert "measure again" not in told
    assert "a smaller step ([control] step, or --step)" in told
