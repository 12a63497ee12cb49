"""Looks at recordings against the bounds and initial values of a model."""

import tomllib

import numpy as np
import pytest

from plantfit import Parameter
from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.looks import not_followed, problem_looks


def record(period=0.05, start=0.0, rest=40, n=600):
    u = np.repeat(np.random.default_rng(0).uniform(-1, 2, n // 20), 20)
    u[:rest] = 0.0
    x, y, a = start, np.empty(n), np.exp(-0.05 / 0.5)
    for k, v in enumerate(u):
        y[k] = x
        x = a * x + (1 - a) * 2.0 * v
    y += 0.01 * np.std(y) * np.random.default_rng(1).normal(size=n)
    return Recording(np.arange(n) * period, {"u": Signal(u), "y": Signal(y)}, "a")


def looks(recording, initial: float | str = 0.0, tau=(0.02, 2.0)):
    model = equations(
        "x' = (K*u - x)/tau; y = x",
        inputs=["u"], states={"x": {"initial": initial}}, outputs=["y"],
        parameters={"K": {"bounds": (0.1, 10)}, "tau": {"unit": "s", "bounds": tau}}
        | ({"x0": {"bounds": (-9, 9)}} if initial == "x0" else {}),
    )  # fmt: skip
    return problem_looks(Problem(model, recording))


def test_a_record_that_fits_its_model_is_left_alone():
    assert not looks(record())


def test_milliseconds_called_seconds():
    (look,) = looks(record(period=50.0))
    assert look.kind == "time unit"
    assert look.write == 'time_unit = "ms"'
    assert "50 s apart" in look.sentence


@pytest.mark.parametrize(("tau", "kind"), [((0.001, 0.04), "sampled slowly"), ((40.0, 90.0), "short")])
def test_times_that_the_record_cannot_show(tau, kind):
    (look,) = looks(record(), tau=tau)
    assert look.kind == kind
    assert "tau" in look.sentence


def decays(clocks, doses, tau=(0.02, 1.0), truth=0.5):
    """A decay from a dose, recorded on each of the clocks."""
    model = equations(
        "x' = -x/tau; y = x", inputs=["u"], states={"x": {"initial": "u"}}, outputs=["y"],
        parameters={"tau": {"unit": "s", "bounds": tau}},
    )  # fmt: skip
    rng, made = np.random.default_rng(2), {}
    for name, t, u in zip("abc", clocks, doses, strict=False):
        y = u * np.exp(-t / truth) + 0.01 * rng.normal(size=len(t))
        made[name] = Recording(t, {"u": Signal(np.full(len(t), u)), "y": Signal(y)}, name)
    return Problem(model, made)


SLOW = np.arange(12.0)
DENSE_FIRST = np.r_[np.arange(0, 1, 0.25), np.arange(1.0, 12.0)]


@pytest.mark.parametrize(
    ("clocks", "told"), [([SLOW], 1), ([DENSE_FIRST], 0), ([SLOW, SLOW], 2), ([SLOW, DENSE_FIRST], 0)]
)
def test_a_time_is_between_two_samples_only_where_no_record_is_faster(clocks, told):
    found = [look for look in problem_looks(decays(clocks, [1.0] * len(clocks))) if look.kind == "sampled slowly"]
    assert len(found) == told
    assert all("1 s apart" in look.sentence and "tau" in look.sentence for look in found)


@pytest.mark.thorough
def test_a_time_that_the_fit_has_determined_is_not_said_to_be_beyond_the_samples():
    problem = decays([SLOW], [1.0], tau=(0.02, 0.9))
    assert [look.kind for look in problem_looks(problem)].count("sampled slowly") == 1
    answer = fit(problem, budget=300)
    (tau,) = answer.findings["parameters"]
    assert tau["status"] == "determined"
    assert not [look for look in answer.findings["data"] if look["kind"] == "sampled slowly"]


@pytest.mark.parametrize(("doses", "told"), [((1.0, 2.0), 0), ((1.0, 1.0), 2), ((1.0,), 1), ((1.0, 1.0, 3.0), 0)])
def test_an_input_that_recordings_differ_in_is_their_condition(doses, told):
    clock = np.arange(0.0, 3.0, 0.1)
    found = [look for look in problem_looks(decays([clock] * len(doses), doses)) if look.kind == "constant"]
    assert len(found) == told


def test_a_plant_that_was_not_at_rest():
    (look,) = looks(record(start=3.0))
    assert look.kind == "not at rest"
    assert (look.figures["moved"] or 0.0) > 1.0
    assert look.write.startswith('initial = "x_start"')
    assert not looks(record(start=3.0), initial="x0")
    assert not looks(record(start=3.0), initial="y")


def test_a_record_that_begins_with_a_step_is_not_called_restless_before_its_first_move():
    """The rig's chamber: the valve opens at the first sample, and moves again in the middle."""
    n = 600
    t, noise = 0.05 * np.arange(n), 0.02 * np.random.default_rng(1).normal(size=n)
    y = 2.0 * (1 - np.exp(-t / 2.0)) + np.where(t > 15, 1 - np.exp(-(t - 15) / 2.0), 0.0) + noise
    recording = Recording(t, {"u": Signal(np.where(t > 15, 1.5, 1.0)), "y": Signal(y)}, "a")

    def found(before):
        model = equations(
            "x' = (K*u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"],
            parameters={"K": {"bounds": (0.1, 10)}, "tau": {"unit": "s", "bounds": (0.02, 20.0)}},
        )  # fmt: skip
        return [look.kind for look in problem_looks(Problem(model, Experiment(recording, before=before)))]

    assert found({"u": 0.0}) == []
    assert found({}) == []  # a model that begins at 0 moves as well
    assert found({"u": 1.0}) == ["not at rest"]  # said to have been the same before, so that the start is what moves


def test_a_model_that_rests_under_its_first_input_beside_a_plant_that_does_not():
    """The input begins at 1 and stays: said where the model begins in its balance, not where it moves by itself."""
    n = 600
    t, noise = 0.05 * np.arange(n), 0.02 * np.random.default_rng(1).normal(size=n)
    later = np.where(t > 15, 1 - np.exp(-(t - 15) / 2.0), 0.0)
    recording = Recording(
        t, {"u": Signal(np.where(t > 15, 2.0, 1.0)), "y": Signal(3.0 - 2.0 * np.exp(-t / 2.0) + later + noise)}, "a"
    )

    def found(equation, initial):
        model = equations(
            f"x' = {equation}; y = x", inputs=["u"], states={"x": {"initial": initial}}, outputs=["y"],
            parameters={"K": {"bounds": (0.1, 10)}, "tau": {"unit": "s", "bounds": (0.02, 20.0)}}, check=False,
        )  # fmt: skip
        return [look.kind for look in problem_looks(Problem(model, recording))]

    assert found("(K*(u - 1) - x)/tau", 0.0) == ["not at rest"]  # about an operating point at u = 1
    assert found("(K*(u - 1) - (x - 3))/tau", 3.0) == ["not at rest"]
    assert found("(K*u - x)/tau", 0.0) == []
    assert found("(K*u - x)/tau", 5.0) == []


def test_an_input_that_never_moves_is_told_as_what_it_is():
    n = 600
    noise = 0.02 * np.random.default_rng(1).normal(size=n)
    t, u = 0.05 * np.arange(n), np.ones(n)

    def found(y, before=None):
        model = equations(
            "x' = (K*u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"],
            parameters={"K": {"bounds": (0.1, 10)}, "tau": {"unit": "s", "bounds": (0.02, 2.0)}},
        )  # fmt: skip
        recording = Recording(t, {"u": Signal(u), "y": Signal(y + noise)}, "a")
        return problem_looks(Problem(model, Experiment(recording, before=before or {})))

    (look,) = found(np.full(n, 2.0))  # nothing moves
    assert look.level == "warning"
    assert (
        look.sentence == "u never moves: it is 1 throughout, so that the record does not show what a change of it does."
    )
    (look,) = found(2.0 * (1 - np.exp(-t / 0.5)))  # it settles from its start
    assert look.level == "info"
    assert look.sentence.endswith("throughout, so that the record does not show what a change of it does.")
    assert not found(2.0 * (1 - np.exp(-t / 0.5)), before={"u": 0.0})  # a step at the first sample
    (look,) = found(np.full(n, 2.0), before={"u": 1.0})  # said to have been the same before
    assert look.level == "warning"


@pytest.mark.parametrize(("start", "gain", "seed"), [(6.0, 2.0, 1), (0.0, 2.0, 2), (60.0, 20.0, 3)])
@pytest.mark.thorough
def test_an_input_that_never_moves_has_an_effect_that_the_level_tells(start, gain, seed):
    """At rest, and settling from elsewhere, the gain is known by the level: no sentence says that it cannot be told."""
    t = np.arange(0.0, 300.0, 2.0)
    noise = 0.05 * np.random.default_rng(seed).normal(size=len(t))
    y = 3.0 * gain + (start - 3.0 * gain) * np.exp(-t / 20.0) + noise
    model = equations(
        "x' = (K*u - x)/tau; y = x", inputs=["u"], states={"x": {"initial": start}}, outputs=["y"],
        constants={"tau": "20 s"}, parameters={"K": {"bounds": (0.1 * gain, 10 * gain)}},
    )  # fmt: skip
    problem = Problem(model, Recording(t, {"u": Signal(np.full(len(t), 3.0)), "y": Signal(y)}, "a"))
    said = [s["sentence"] for s in fit(problem).findings["verdict"]] + [k.sentence for k in problem_looks(problem)]
    assert any("The data determine 1 of 1 parameters" in s for s in said)
    assert any("u never moves: it is 3 throughout, so that the record does not show" in s for s in said)
    assert not any("can be told" in s or "shows only" in s for s in said)


@pytest.mark.parametrize("wrong", [False, True])
def test_single_samples_that_the_model_makes_itself_are_no_outliers(wrong):
    """A dose that is gone by the next sample; beside it one sample that is wrong."""
    n, dose, gone = 200, 3.0, 0.1
    t = np.arange(float(n))
    y = 0.01 * np.random.default_rng(3).standard_normal(n)
    y[60:] += dose * np.exp(-(t[60:] - 60.0) / gone)
    y[130] += 3.0 * wrong
    model = equations(
        "x' = -x/tau; when rising(t - 60): x = x + dose; y = x",
        states={"x": {"initial": 0.0}}, outputs=["y"],
        parameters={"tau": {"unit": "s", "bounds": (0.05, 0.2)}, "dose": {"bounds": (2.0, 4.0)}},
    )  # fmt: skip
    problem = Problem(model, Recording(t, {"y": Signal(y)}, "a"))
    z = problem.space.cube(problem.space.vector({"tau": gone, "dose": dose}))
    seen = [look for look in problem_looks(problem) if look.kind == "spikes"]
    assert seen
    assert [look.kind for look in not_followed(seen, problem, z)] == ["spikes"] * wrong


def with_signals(u, y, unit="m", log=()):
    model = equations(
        "x' = (u - x)/tau\nz = x", inputs={"u": unit}, states={"x": {"unit": unit, "initial": 0.0}}, name="lag",
        outputs={"z": unit}, parameters={"tau": {"unit": "s", "bounds": (0.01, 10.0)}},
    )  # fmt: skip
    t = 0.05 * np.arange(len(u))
    return problem_looks(Problem(model, Recording(t, {"u": Signal(u, "mm"), "z": Signal(y, "mm")}, "run", log), {}))


def test_a_column_that_is_input_and_output_is_told():
    """Nothing was said, and the model followed its own input with 93 %."""
    u = np.repeat(np.random.default_rng(0).uniform(0.0, 2.0, 30), 20)
    y = u + 0.1 * np.random.default_rng(1).normal(size=600)
    [look] = [k for k in with_signals(y, y) if k.kind == "same"]
    assert (look.level, look.signal) == ("warning", "u")
    assert look.sentence.startswith("u is z in run, sample by sample. A model that makes z of u is given what it is to")


@pytest.mark.parametrize("kind", ["same", "other", "constant"])
@pytest.mark.parametrize("steady", [False, True])
def test_a_static_model_of_one_column_is_told_of_it_alone(kind, steady):
    u = np.random.default_rng(0).uniform(0.0, 2.0, 40)
    u[7] = -999.0  # of which nothing is said there
    u = np.full(40, 2.0) if kind == "constant" else u
    y = u + (0.01 * np.arange(40) if kind == "other" else 0.0)
    unit = {"unit": "mm"}
    model = equations("z = a + b*u", inputs={"u": unit}, outputs={"z": unit}, parameters=["a", "b"], check=False)
    record = Recording(np.arange(40.0), {"u": Signal(u, "mm"), "z": Signal(y, "mm")}, "run")
    problem = Problem(model, Experiment(record, steady=steady), {"a": Parameter((-9, 9)), "b": Parameter((-9, 9))})
    looks = problem_looks(problem)
    assert [look.kind for look in looks] == (["same"] if kind == "same" else [])
    assert all("u is z in run, sample by sample" in look.sentence for look in looks)


@pytest.mark.parametrize("kind", ["other", "constant"])
def test_signals_that_are_alike_are_not_called_the_same(kind):
    u = np.repeat(np.random.default_rng(0).uniform(0.0, 2.0, 30), 20)
    y = u.copy()
    y[17] += 1e-6
    pair = (u, y) if kind == "other" else (np.full(600, 2.0), np.full(600, 2.0))
    assert "same" not in [k.kind for k in with_signals(*pair)]


@pytest.mark.parametrize(("unit", "told"), [("mm", {"missing": [-999.0]}), ("m", {})])
def test_a_number_for_no_value_is_told_as_the_file_has_it(unit, told):
    """Of a signal that was converted the number in the file is another one."""
    u = np.repeat(np.random.default_rng(0).uniform(0.0, 2.0, 30), 20)
    y = u + 0.1 * np.random.default_rng(1).normal(size=600)
    y[[30, 31, 200, 411]] = -999.0
    [look] = [k for k in with_signals(u, y, unit) if k.kind == "no_value"]
    assert look.figures["value"] == pytest.approx(-999.0 if unit == "mm" else -0.999)
    assert tomllib.loads(look.write) == told


@pytest.mark.parametrize("delayed", [False, True])
def test_a_clock_has_one_range_in_all_looks_at_it(delayed):
    """Outputs and recordings estimate by how much an input is stamped late, and differ."""
    rng, n, late = np.random.default_rng(4), 1200, {"a": 4, "b": 7}
    recordings = {}
    for name, by in late.items():
        raw = np.convolve(rng.normal(size=n + 60), np.ones(3) / 3, "same")
        x, z = np.zeros(n + 60), np.zeros(n + 60)
        for k in range(1, n + 60):
            x[k], z[k] = 0.8 * x[k - 1] + 0.2 * raw[k - 1], 0.9 * z[k - 1] + 0.1 * x[k - 1]
        u = raw[60 - by : n + 60 - by]
        y, w = (v[60:] + 0.01 * rng.normal(size=n) for v in (x, z))
        recordings[name] = Recording(0.02 * np.arange(n), {"u": Signal(u), "y": Signal(y), "w": Signal(w)}, name)
    text = f"x' = ({'delay(u, L)' if delayed else 'u'} - x)/tau\nz' = (x - z)/tau\ny = x\nw = z"
    bounds = {"tau": {"unit": "s", "bounds": (0.01, 2.0)}} | ({"L": {"unit": "s", "bounds": (0, 1)}} if delayed else {})
    model = equations(text, inputs=["u"], states=["x", "z"], outputs=["y", "w"], parameters=bounds)
    found = [k for k in problem_looks(Problem(model, recordings)) if k.kind == "feedback" and k.write]
    assert len({k.figures["late"] for k in found}) > 1
    assert len({k.write for k in found}) == 1
    most = 2 * max(k.figures["late"] or 0.0 for k in found)
    assert found[0].write == f"clock_shift = {{ u = [{-most:.3g}, {most:.3g}] }}"
    for look in found:
        assert f"Try {look.write} under [model]{' in place of L' if delayed else ''} first" in look.sentence
        assert look.sentence.count("clock_shift") == 1


@pytest.mark.parametrize(
    ("period", "told"),
    [
        (2e8, "a lasts 3.8e+03 years"),  # a day of milliseconds that are called hours
        (1e-13, "Samples of a are 1e-13 s apart"),
        (3.2e7, None),  # 600 years of tree rings
        (1e-11, None),  # an oscilloscope
    ],
)
def test_a_time_in_another_unit_is_told_where_nobody_records_so(period, told):
    said = [k.sentence for k in looks(record(period), tau=(period, 50 * period)) if k.kind == "time scale"]
    asked = ": is the unit of its time another one? Write it as time_unit under [recording.a]."
    assert said == ([told + asked] if told else [])


OSCILLATOR = "v' = mu*(1 - x^2)*v - w^2*x"


def oscillates(rate=OSCILLATOR, start=0.0, force=None):
    """Looks at the record of a swing by an oscillator whose states begin at `start` and zero."""
    t = np.arange(400) * 0.05
    inputs = {} if force is None else {"f": Signal(force(t))}
    record = Recording(t, {**inputs, "y": Signal(np.cos(2.0 * t) + 0.01 * np.sin(97.0 * t))}, "a")
    model = equations(
        f"x' = v; {rate}; y = x", inputs=list(inputs), states={"x": {"initial": start}, "v": {}}, outputs=["y"],
        parameters={"mu": {"bounds": (0.1, 10)}, "w": {"bounds": (0.1, 10)}}
        | ({"x_start": {"bounds": (-2, 2)}} if start == "x_start" else {}),
        check=False,
    )  # fmt: skip
    return Problem(model, record)


def test_a_model_that_stays_where_it_begins_is_told_with_the_line_that_moves_it():
    problem = oscillates()
    (look,) = problem_looks(problem)
    assert look.kind == "at rest"
    assert look.level == "warning"
    assert "The model stays where it begins in a: at x = 0 and v = 0 its rates are zero, whatever" in look.sentence
    assert look.write == 'initial = "x_start", with bounds under [parameters.x_start]'
    answer = fit(problem, seed=1)
    said = [s["sentence"] for s in answer.findings["verdict"]]
    assert any(s.startswith("The model follows y with an RMSE of 0.7") for s in said)
    assert not any("local searches" in s for s in said)
    found = answer.diagnose()
    assert found is not None
    (left,) = (told["sentence"] for told in found["verdict"])
    assert left == "What may be missing was not tried, as the model stays where it begins."
    (held,) = (
        look for look in problem_looks(oscillates(force=np.ones_like, rate=f"{OSCILLATOR}*f")) if look.kind == "at rest"
    )
    assert "its rates are zero and its inputs stay as they are, whatever" in held.sentence


@pytest.mark.parametrize(
    "moved",
    [
        {"start": 1.0}, {"start": "y"}, {"start": "x_start"}, {"rate": f"{OSCILLATOR} - 9.81"},
        {"rate": f"{OSCILLATOR} + sin(0.5*t)"}, {"rate": f"{OSCILLATOR} + f", "force": np.sin},
        {"rate": f"{OSCILLATOR} + f", "force": np.ones_like},
    ],
)  # fmt: skip
def test_a_model_that_something_moves_is_not_said_to_stay(moved):
    assert "at rest" not in [look.kind for look in problem_looks(oscillates(**moved))]
