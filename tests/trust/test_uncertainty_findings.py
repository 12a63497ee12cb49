"""Stated errors in the findings of a fit: closed forms, the same as `propagate` in Python, and how often the truth
lies inside."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import t as student

import plantfit as pf
from plantfit.errors import RecordingError, SpaceError
from plantfit.models import LinearModel, dc_motor
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate import Simulator
from plantfit.trust import assess, propagate, propagate_by_monte_carlo
from plantfit.trust.finish.refit import refit
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.stated_errors.reading_budgets import reading_budgets
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.stated_errors.uncertainty_budget import type_a, type_b

T = np.arange(200) * 0.1
TRUTH = {"a": 1.0, "b": 2.0, "c": 4.0}


def record(
    seed: int, name: str = "run", offset: float = 0.0, gain: float = 0.0, c: float = TRUTH["c"], noise: float = 0.05
) -> Recording:
    """y = a + b c u with errors of its sensor."""
    u = np.sin(T)
    clean = TRUTH["a"] + TRUTH["b"] * c * u
    y = clean * (1.0 + gain) + offset + noise * np.random.default_rng(seed).standard_normal(len(T))
    return Recording(T, {"u": Signal(u, "A"), "y": Signal(y, "V")}, name)


def line(*records: Recording) -> Problem:
    """a and b are fitted, c is held."""
    parameters = {
        "a": {"bounds": [-9, 9], "unit": "V"}, "b": {"bounds": [-9, 9], "unit": "1"},
        "c": {"value": TRUTH["c"], "unit": "ohm"},
    }  # fmt: skip
    model = pf.equations("y = a + b*c*u", inputs={"u": "A"}, outputs={"y": "V"}, parameters=parameters)
    return Problem(model, {r.name: r for r in records})


def fitted(problem: Problem) -> np.ndarray:
    return refit(problem, np.full(problem.space.dimension, 0.4), np.ones(problem.space.dimension, bool), 1e-10)[0]


GAIN, OFFSET = SharedError(type_b("span", 0.03), "gain", "y"), SharedError(type_b("zero", 0.3, "V"), "offset", "y")
BRIDGE = SharedError(type_b("bridge", 0.04, "ohm"), "constant", "c")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return line(record(0))


@pytest.fixture(scope="module")
def answer(problem):
    return pf.fit(problem, errors=[GAIN, OFFSET, BRIDGE], budget=400)


def test_a_fit_says_what_python_says_and_what_the_closed_form_says(answer):
    found = propagate(answer.problem, answer, answer.errors)
    rows = {p["name"]: p for p in answer.findings["parameters"]}
    gain, zero, ohm = 0.03 / np.sqrt(3), 0.3 / np.sqrt(3), 0.04 / np.sqrt(3)
    expected = {
        "a": {"span": abs(rows["a"]["value"]) * gain, "zero": zero, "bridge": 0.0},
        "b": {
            "span": abs(rows["b"]["value"]) * gain,
            "zero": 0.0,
            "bridge": abs(rows["b"]["value"]) / TRUTH["c"] * ohm,
        },
    }
    for i, name in enumerate(found.names):
        stated = rows[name]["uncertainty"]
        assert stated["sources"] == pytest.approx(expected[name], rel=1e-3, abs=1e-6)
        assert stated["noise"] == pytest.approx(rows[name]["standard_error"], rel=1e-9)
        assert stated["combined"] == pytest.approx(np.hypot(stated["noise"], stated["shared"]))
        assert stated["combined"] == found.combined[i]
        assert (stated["low"], stated["high"]) == (found.low[i], found.high[i])
        assert stated["high"] - stated["low"] == pytest.approx(2 * 1.96 * stated["combined"])
    held = rows["c"]["uncertainty"]
    assert held["combined"] == pytest.approx(ohm)
    assert held["high"] == pytest.approx(4.0 + 1.96 * ohm)
    assert answer.findings["uncertainty"]["method"] == "linear"


def test_the_keys_that_were_there_stay_as_they_are(answer):
    plain = assess(answer.problem, answer.runs, seed=0)
    assert plain["uncertainty"] is None
    assert all(p["uncertainty"] is None for p in plain["parameters"])
    for old, new in zip(plain["parameters"], answer.findings["parameters"], strict=True):
        assert {k: v for k, v in old.items() if k != "uncertainty"} == {
            k: v for k, v in new.items() if k != "uncertainty"
        }


def test_the_verdict_names_what_is_worst(answer, problem):
    said = " ".join(v["sentence"] for v in answer.findings["verdict"])
    b = next(p for p in answer.findings["parameters"] if p["name"] == "b")
    assert "± with the stated errors: a = " in said
    assert f"± {b['uncertainty']['combined']:.3f}" in said
    assert "the interval of a is" in said
    assert "most of it from the offset of y (zero); they outweigh the noise in 2 of 2 parameters (a and b)" in said
    small = pf.fit(problem, errors=[dataclasses.replace(GAIN, source=type_b("span", 1e-4))], budget=400)
    said = [v for v in small.findings["verdict"] if "stated errors widen" in v["sentence"]]
    assert [v["level"] for v in said] == ["good"]
    assert "and others less: the noise decides." in said[0]["sentence"]


def test_a_held_constant_moves_the_rest_as_a_free_one_that_the_fit_held(problem):
    z = fitted(problem)
    held = propagate(problem, z, [BRIDGE])
    freed = problem.freed({"c": (3.0, 5.0)})
    at = freed.space.cube(
        freed.space.vector({**dict(zip(problem.space.names, held.values, strict=True)), "c": TRUTH["c"]})
    )
    free = propagate(freed, at, [BRIDGE])
    assert held.names == ("a", "b")
    places = [free.names.index(n) for n in held.names]
    np.testing.assert_allclose(held.systematic["bridge"], free.systematic["bridge"][places], rtol=1e-9)
    np.testing.assert_allclose(held.random, free.random[places], rtol=1e-9)


def test_errors_of_one_recording_and_of_each():
    problem = line(record(1, "one"), record(2, "two"))
    z, u = fitted(problem), 0.3 / np.sqrt(3)

    def of_a(**more) -> float:
        return propagate(problem, z, [dataclasses.replace(OFFSET, **more)]).systematic["zero"][0]

    assert of_a() == pytest.approx(u, rel=1e-6)
    assert of_a(per_recording=True) == pytest.approx(u / np.sqrt(2), rel=1e-6)  # the mean of two independent offsets
    assert of_a(recordings=("two",)) == pytest.approx(u / 2, rel=1e-6)
    assert of_a(recordings=("two",), per_recording=True) == pytest.approx(u / 2, rel=1e-6)
    drawn = propagate_by_monte_carlo(problem, z, [dataclasses.replace(OFFSET, per_recording=True)], draws=300, seed=1)
    assert drawn.combined[0] == pytest.approx(np.hypot(u / np.sqrt(2), drawn.random[0]), rel=0.1)


def test_a_reference_that_two_channels_share_leaves_their_ratio(problem):
    both = dataclasses.replace(GAIN, of=("u", "y"))
    found = propagate(problem, fitted(problem), [both])
    assert found.systematic["span"] == pytest.approx(
        [abs(found.values[0]) * GAIN.source.standard, 0.0], rel=1e-3, abs=1e-6
    )
    alone = propagate(problem, fitted(problem), [GAIN, dataclasses.replace(GAIN, of="u", source=type_b("other", 0.03))])
    assert np.hypot(alone.systematic["span"], alone.systematic["other"])[1] > 0.04  # as two cards would
    drawn = propagate_by_monte_carlo(problem, fitted(problem), [both], draws=60, seed=1)
    assert drawn.combined[1] == pytest.approx(drawn.random[1], rel=0.3)
    assert [b.of for b in reading_budgets(problem, [both])] == ["u", "y"]


def test_few_repeats_widen_the_interval(problem):
    zero = SharedError(type_a("zero", [0.05, 0.11, -0.04], "V"), "offset", "y")
    found = propagate(problem, fitted(problem), [zero, GAIN])
    u = [zero.source.standard, abs(found.values[0]) * GAIN.source.standard, found.random[0]]
    degrees = np.sum(np.square(u)) ** 2 / (u[0] ** 4 / 2)
    assert found.degrees_of_freedom[0] == pytest.approx(degrees, rel=1e-3)
    factor = student.ppf(0.975, np.floor(degrees))
    assert found.high[0] - found.values[0] == pytest.approx(factor * found.combined[0])
    assert found.degrees_of_freedom[1] > 1e6


def test_errors_of_what_is_not_there_are_refused_before_the_search(problem):
    def never(progress):
        raise AssertionError("the search began")

    for error, what, said in (
        (dataclasses.replace(GAIN, of="w"), RecordingError, "no signal 'w'"),
        (dataclasses.replace(GAIN, of=("y", "w")), RecordingError, "no signal 'w'"),
        (dataclasses.replace(GAIN, recordings=("other",)), RecordingError, "names recording 'other'"),
        (dataclasses.replace(BRIDGE, of="d"), SpaceError, "The constant 'd' is no single number"),
    ):
        with pytest.raises(what, match=said):
            pf.fit(problem, errors=[error], budget=400, progress=never)


def test_monte_carlo_is_that_of_python(problem):
    answer = pf.fit(problem, errors=[GAIN, BRIDGE], draws=60, seed=5, budget=400)
    found = propagate_by_monte_carlo(answer.problem, answer, answer.errors, draws=60, seed=5)
    rows = answer.findings["parameters"]
    assert answer.findings["uncertainty"]["draws"] == 60
    assert [p["uncertainty"]["low"] for p in rows[:2]] == found.low.tolist()
    assert [p["uncertainty"]["combined"] for p in rows[:2]] == found.combined.tolist()
    assert found.combined == pytest.approx(propagate(answer.problem, answer, answer.errors).combined, rel=0.3)


def test_a_regression_with_a_held_coefficient():
    """p1 x1 + p2 x2 with p2 held: p1 moves by -x1.x2/x1.x1 for a unit of it, and a gain of y by p1 plus that times
    p2."""
    columns = lambda s: np.column_stack([s["x1"], s["x2"]])  # noqa: E731
    names = (pf.Declared("p1", "1", (-9.0, 9.0)), pf.Declared("p2", "1", (-9.0, 9.0)))
    model = LinearModel("sum", {"y": "V"}, names, columns, {"x1": "V", "x2": "V"})
    x1, x2 = np.sin(T), np.sin(T + 0.5)
    y = 2.0 * x1 + 3.0 * x2 + 0.05 * np.random.default_rng(4).standard_normal(len(T))
    run = Recording(T, {"x1": Signal(x1, "V"), "x2": Signal(x2, "V"), "y": Signal(y, "V")}, "run")
    problem = Problem(model, run, {"p2": 3.0})
    z = fitted(problem)
    held = SharedError(type_b("p2", 0.1), "constant", "p2")
    found = propagate(problem, z, [GAIN, held])
    share = float(x1 @ x2 / (x1 @ x1))
    assert found.systematic["p2"][0] == pytest.approx(abs(share) * held.source.standard, rel=1e-6)
    expected = float(x1 @ y / (x1 @ x1)) * GAIN.source.standard
    assert found.systematic["span"][0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.thorough
def test_a_gain_scales_the_gain_of_moving_and_steady_records_alike():
    model = pf.equations(
        "x' = (K*u - x)/tau; y = x", inputs={"u": "V"}, states={"x": "V"}, outputs={"y": "V"},
        parameters={"K": {"bounds": [0.1, 9]}, "tau": {"bounds": [0.1, 9], "unit": "s"}},
    )  # fmt: skip
    rng, u = np.random.default_rng(6), np.sign(np.sin(T))
    x = [0.0]
    for k in range(len(T) - 1):
        x.append(3.0 * u[k] + (x[-1] - 3.0 * u[k]) * np.exp(-0.1 / 1.5))
    run = Recording(T, {"u": Signal(u, "V"), "y": Signal(np.array(x) + 0.02 * rng.standard_normal(len(T)), "V")}, "run")
    level = np.linspace(-2, 2, 9)
    rest = Signal(3.0 * level + 0.02 * rng.standard_normal(9), "V")
    curve = Recording(np.arange(9.0), {"u": Signal(level, "V"), "y": rest}, "curve")
    problem = Problem(model, {"run": run, "curve": pf.Experiment(curve, steady=True)}, substeps=1)
    z = fitted(problem)
    found = propagate(problem, z, [GAIN, SharedError(type_b("clock", 1e-3), "clock")])
    assert found.systematic["span"] == pytest.approx([found.values[0] * GAIN.source.standard, 0.0], rel=1e-3, abs=1e-6)
    assert found.systematic["clock"] == pytest.approx([0.0, found.values[1] * 1e-3 / np.sqrt(3)], rel=0.02, abs=1e-5)
    one = propagate(problem, z, [dataclasses.replace(GAIN, per_recording=True)])
    assert one.systematic["span"][0] < 0.999 * found.systematic["span"][0]  # two draws do not both lie at the end


def test_noise_part_is_the_standard_error_with_smoothed_tables():
    model = pf.equations(
        "y = f(u)", inputs={"u": "1"}, outputs={"y": "V"},
        tables={"f": {"over": ["u"], "nodes": [list(np.linspace(-1, 1, 6))], "unit": "V"}},
        parameters={"f": {"bounds": [-5, 5]}},
    )  # fmt: skip
    u = np.sin(T)
    y = u**2 + 0.1 * np.random.default_rng(3).standard_normal(len(T))
    problem = Problem(
        model, Recording(T, {"u": Signal(u), "y": Signal(y, "V")}, "run"), {"f": pf.Parameter((-5.0, 5.0), smooth=3.0)}
    )
    z = fitted(problem)
    found = propagate(problem, z, [GAIN])
    np.testing.assert_allclose(found.random, linearise(problem, z).standard_error, rtol=1e-9)


def test_budgets_stand_at_the_most_uncertain_reading():
    problem = line(record(1, "one"), record(2, "two"))
    card = SharedError(type_b("card", 0.1, "V"), "zero", "y", span=20.0)
    only = dataclasses.replace(OFFSET, recordings=("two",))
    first, second, clock, held = reading_budgets(
        problem, [GAIN, card, only, SharedError(type_b("clock", 1e-4), "clock"), BRIDGE]
    )
    largest = max(problem.experiments["one"].recording["y"])
    assert (first.recordings, second.recordings) == (["one"], ["two"])
    assert first.at == largest
    expected = np.hypot(largest * GAIN.source.standard, (1 - largest / 20) * card.source.standard)
    assert first.combined == pytest.approx(expected)
    assert first.expanded == pytest.approx(2 * expected)
    assert [s.name for s in second.sources] == ["span", "card", "zero"]
    assert [s.acts for s in second.sources] == ["gain", "zero", "offset"]
    assert clock.combined == pytest.approx(1e-4 / np.sqrt(3))
    assert (held.of, held.at, held.unit, held.sources[0].acts) == ("c", 4.0, "ohm", "constant")


def test_intervals_with_a_held_constant_and_few_repeats_hold_what_they_promise():
    """A zero that was set with three repeats, and a held value off by a draw: 1.96 would hold a in about 81 %."""
    # freed once, as `propagate` would each time
    problem, inside, short = (line(record(0)).freed({"c": (3.0, 5.0)}), [], [])
    start = problem.space.cube(problem.space.vector({"a": 3.0, "b": -2.0, "c": TRUTH["c"]}))
    free, truth = np.array([n != "c" for n in problem.space.names]), np.array([TRUTH[n] for n in problem.space.names])
    for seed in range(200):
        rng = np.random.default_rng(7000 + seed)
        repeats = 0.2 * rng.standard_normal(3)
        errors = [SharedError(type_a("zero", repeats, "V"), "offset", "y"), BRIDGE]
        c = TRUTH["c"] + float(BRIDGE.source.draw(rng, 1)[0])
        problem = problem.with_recordings({"run": record(seed, offset=-float(np.mean(repeats)), c=c)})
        found = propagate(problem, refit(problem, start, free, 1e-10)[0], errors)
        inside.append(((found.low <= truth) & (truth <= found.high))[free])
        short.append((np.abs(found.values - truth) <= 1.96 * found.combined)[free])
    assert np.all(np.mean(inside, axis=0) >= 0.92), np.mean(inside, axis=0)
    assert np.mean(short, axis=0)[0] < 0.88


@pytest.mark.thorough
def test_the_reference_of_voltage_and_current_scales_a_motor_as_its_units_say():
    """V and i by 1 + e: R = V/i stays, K goes with e, and torques K i, with them inertia and friction, with 2 e."""
    model = dc_motor(tied=True, current_output=True)
    truth = {"Rm": 2.0, "Lm": 2e-3, "Kb": 0.05, "Jm": 2e-5, "Cm": 1e-5, "Tf": 3e-3}
    rng, t = np.random.default_rng(0), 0.005 * np.arange(300)
    volts = np.repeat(rng.uniform(-6.0, 6.0, 10), 30)
    simulator = Simulator.of(model, substeps=16)
    y = simulator.outputs(truth, simulator.drive(t, {"V": volts}, measured={"w": np.zeros(300), "i": np.zeros(300)}))
    noisy = {
        "w": np.asarray(y["w"]) + 0.1 * rng.standard_normal(300),
        "i": np.asarray(y["i"]) + 0.01 * rng.standard_normal(300),
    }
    run = Recording(t, {"V": Signal(volts, "V"), "w": Signal(noisy["w"], "rad/s"), "i": Signal(noisy["i"], "A")}, "run")
    box = {
        "Rm": (0.2, 20.0),
        "Kb": (0.005, 0.5),
        "Jm": (1e-6, 1e-3),
        "Cm": (1e-7, 1e-3),
        "Tf": (1e-4, 1e-1),
        "Lm": truth["Lm"],
    }
    problem = Problem(model, run, box, substeps=4)
    start = problem.space.cube(problem.space.vector({n: 1.3 * v for n, v in truth.items() if n != "Lm"}))
    z, _ = refit(problem, start, np.ones(5, bool), 1e-10)
    reference = SharedError(type_b("reference", 0.01), "gain", ("V", "i"))
    found = propagate(problem, z, [reference])
    powers = {"Rm": 0, "Kb": 1, "Jm": 2, "Cm": 2, "Tf": 2}
    relative = found.systematic["reference"] / found.values / reference.source.standard
    assert dict(zip(found.names, relative, strict=True)) == pytest.approx(powers, abs=0.05)
