"""Inputs that were read in steps: intervals allow for them, and the verdict names them where they matter."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations, fit
from plantfit.errors import PlantfitError
from plantfit.optimize import minimise
from plantfit.problem import Experiment
from plantfit.spec import load
from plantfit.spec.recordings import counted_signals
from plantfit.study.objective import objective_of
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.misreadings import allowing_for_misreadings, moves
from plantfit.trust.intervals.parameter_rows import parameter_rows
from plantfit.trust.intervals.ranges import Range
from plantfit.trust.looks.misreadings import misreadings, telling

RADIUS, PERIOD, N = 0.03, 0.01, 300
WHEEL = equations(
    "x' = r*w\ny = x",
    inputs={"w": "rad/s"},
    states={"x": {"unit": "m", "initial": "x0"}},
    outputs={"y": "m"},
    parameters={"r": "m", "x0": "m"},
)
SPACE = {"r": Parameter((0.01, 0.1), "m"), "x0": Parameter((-1.0, 1.0), "m")}


def drive(seed, pulses, noise=2e-4):
    """A wheel that starts, turns and stops, seen by an encoder's counts and a ruler."""
    rng, t = np.random.default_rng(seed), PERIOD * np.arange(N)
    speed = 12.0 * np.clip(np.minimum(t - 0.1, 2.6 - t) / 0.4, 0, 1) * (1 + 0.1 * np.sin(3 * t + 6.28 * rng.uniform()))
    angle = np.r_[0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]))] * PERIOD
    count = 2 * np.pi / pulses
    read = count * np.floor(angle / count + rng.uniform())
    w = np.diff(read, append=read[-1]) / PERIOD
    signals = {"w": Signal(w, "rad/s"), "y": Signal(RADIUS * angle + noise * rng.standard_normal(N), "m")}
    return Experiment(Recording(t, signals, "drive"), counted={"w": count})


def rows_of(problem, z, local):
    ends = {
        i: Range(v - 1.96 * e, v + 1.96 * e)
        for i, (v, e) in enumerate(zip(local.values, local.standard_error, strict=True))
    }
    return parameter_rows(problem.space, local, set(), ends)


def answers(pulses, seeds):
    """The problem, point and linearised problem of every record."""
    base = Problem(WHEEL, drive(0, pulses), SPACE)
    for seed in seeds:
        problem = base.with_recordings({"drive": drive(seed, pulses).recording})
        start = problem.space.cube(problem.space.vector({"r": RADIUS, "x0": 0.0}))
        z = minimise(objective_of(problem, start[None, :]), "least_squares", budget=300, settings={"agree": 1})[0].x
        yield problem, z, linearise(problem, z)


@pytest.mark.thorough
def test_intervals_hold_where_those_by_the_noise_do_not():
    held = {"noise": 0, "steps": 0}
    seeds = range(1, 61)
    for problem, z, local in answers(40, seeds):
        rows, looks = allowing_for_misreadings(problem, z, local, rows_of(problem, z, local))
        off = abs(local.values[0] - RADIUS)
        held["noise"] += off < 1.96 * local.standard_error[0]
        held["steps"] += rows[0]["low"] < RADIUS < rows[0]["high"]
        assert [look.kind for look in looks] == ["counted"]
        assert rows[0]["by_steps"] > 0.5 * local.standard_error[0]
    assert held["noise"] < 0.6 * len(seeds)
    assert held["steps"] >= 0.9 * len(seeds)


def test_of_fine_steps_nothing_is_said_and_nothing_widened():
    for problem, z, local in answers(40_000, range(3)):
        rows = rows_of(problem, z, local)
        wider, looks = allowing_for_misreadings(problem, z, local, rows)
        assert looks == []
        assert wider == [{**row, "by_steps": None} for row in rows]


def test_the_moves_are_the_scatter_of_answers_without_noise():
    base = Problem(WHEEL, drive(0, 40, noise=0.0), SPACE)
    found, told = [], []
    for seed in range(1, 61):
        problem = base.with_recordings({"drive": drive(seed, 40, noise=0.0).recording})
        start = problem.space.cube(problem.space.vector({"r": RADIUS, "x0": 0.0}))
        z = minimise(objective_of(problem, start[None, :]), "least_squares", budget=300, settings={"agree": 1})[0].x
        found.append(float(problem.space.physical(z)[0]) - RADIUS)
        told.append(moves(problem, z, linearise(problem, z), misreadings(problem)).values[0])
    assert 0.8 < np.sqrt(np.mean(np.square(told))) / np.sqrt(np.mean(np.square(found))) < 1.5


def test_the_verdict_names_counts_and_what_they_do():
    answer = fit(Problem(WHEEL, drive(5, 40), SPACE), budget=600)
    own = next(v["sentence"] for v in answer.findings["verdict"] if "driven by counts (w)" in v["sentence"])
    assert "times as wide as by the noise" in own
    assert " % of the mean square of the residuals may be this error" in own  # the ruler is finer than a count
    row = answer.findings["parameters"][0]
    assert row["standard_error"] > row["by_steps"] > 0
    coarse = fit(Problem(WHEEL, drive(5, 40, noise=5e-3), SPACE), budget=600)
    assert any("Residuals hardly show this error" in v["sentence"] for v in coarse.findings["verdict"])
    assert answer.standard_errors["r"] == row["standard_error"]


def test_readings_that_look_rounded_are_named_with_the_line_that_says_they_were_not():
    plant = equations(
        "y' = (K*u - y)/tau",
        inputs=["u"],
        states={"y": {"initial": "y0"}},
        outputs=["y"],
        parameters=["K", "tau", "y0"],
        name="first order",
    )
    t = 0.1 * np.arange(600)
    fine = np.arange(0, 60, 0.005)
    u = np.sin(0.69 * fine) + np.sin(0.19 * fine + 1)
    y = np.zeros(len(fine))
    for k in range(len(fine) - 1):
        y[k + 1] = y[k] + 0.005 / 2.0 * (2.0 * u[k] - y[k])
    read = np.round(u[::20] / 0.4) * 0.4
    record = Recording(
        t, {"u": Signal(read), "y": Signal(y[::20] + 1e-2 * np.random.default_rng(1).standard_normal(600))}, "run"
    )
    space = {"K": Parameter((0.1, 10.0)), "tau": Parameter((0.1, 20.0)), "y0": Parameter((-5.0, 5.0))}
    answer = fit(Problem(plant, record, space, hold={"u": "linear"}), budget=900)
    said = " ".join(v["sentence"] for v in answer.findings["verdict"])
    assert "driven by readings in steps (u)" in said
    assert "write rounded = { u = 0 } under [recording.run]" in said
    assert "Residuals hardly show" not in said
    share = float(said.split("About ")[1].split(" %")[0])
    assert 40 <= share <= 100  # of residuals whose noise is a tenth of them
    assert "closed loop" not in said
    assert not [look for look in answer.findings["data"] if look["kind"] == "feedback"]
    assert answer.findings["parameters"][0]["by_steps"] > 0
    commanded = Experiment(record, rounded={"u": 0.0})
    assert misreadings(Problem(plant, commanded, space)) == []
    assert misreadings(Problem(plant, Experiment(record, rounded={"u": 0.4}), space))[0].told


LAG = equations(
    "y' = (K*u - y)/tau",
    inputs=["u"],
    states={"y": {"initial": "y0"}},
    outputs=["y"],
    parameters=["K", "tau", "y0"],
    name="lag",
)
LAG_SPACE = {"K": Parameter((0.1, 10.0)), "tau": Parameter((0.1, 20.0)), "y0": Parameter((-50.0, 50.0))}


def fine_steps(seed, commanded=False, step=0.02, noise=0.005):
    """A lag (K 2, tau 1.5 s) driven by a slow signal over a range of 10, read in steps of 0.2 % of it, or commanded
    in them."""
    rng, fine = np.random.default_rng(seed), np.arange(6000) * 0.01
    u = np.sum(
        [a * np.sin(6.28 * f * fine + p) for a, f, p in rng.uniform([0.3, 0.005, 0], [1, 0.05, 6.28], (4, 3))], axis=0
    )
    u = 10 * (u - u.min()) / np.ptp(u)
    place = rng.uniform()
    read = (np.round(u[::10] / step + place) - place) * step
    u = np.repeat(read, 10) if commanded else u
    y, a = np.full(len(fine), 2.0 * u[0]), np.exp(-0.01 / 1.5)
    for k in range(len(fine) - 1):
        y[k + 1] = a * y[k] + (1 - a) * 2.0 * (u[k] if commanded else 0.5 * (u[k] + u[k + 1]))
    return Recording(
        0.1 * np.arange(600), {"u": Signal(read), "y": Signal(y[::10] + noise * rng.standard_normal(600))}, "run"
    )


@pytest.mark.parametrize("seeds", [range(10, 20), pytest.param(range(20), marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_intervals_allow_for_steps_that_are_fine_beside_the_range_and_not_beside_the_noise(seeds):
    held = {"noise": 0, "steps": 0}
    for seed in seeds:
        answer = fit(Problem(LAG, fine_steps(seed), LAG_SPACE, hold={"u": "linear"}), budget=600)
        row = answer.findings["parameters"][0]
        assert any("driven by readings in steps (u)" in v["sentence"] for v in answer.findings["verdict"])
        by_noise = np.sqrt(row["standard_error"] ** 2 - row["by_steps"] ** 2)
        held["noise"] += abs(row["value"] - 2.0) < 1.96 * by_noise
        held["steps"] += row["low"] <= 2.0 <= row["high"]
    assert held["noise"] <= 0.75 * len(seeds)
    assert held["steps"] >= 0.9 * len(seeds)


@pytest.mark.parametrize("count", [5, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_of_a_command_in_fine_steps_residuals_tell_that_the_plant_got_it(count):
    told = 0
    for seed in range(count):
        answer = fit(Problem(LAG, fine_steps(seed, commanded=True, step=0.1), LAG_SPACE), budget=600)
        told += any("in steps" in v["sentence"] for v in answer.findings["verdict"])
    assert told <= 1


def test_a_check_speaks_of_steps_by_the_noise_of_the_output():
    for noise, said in ((0.005, True), (0.5, False)):
        problem = Problem(LAG, fine_steps(1, noise=noise), LAG_SPACE, hold={"u": "linear"})
        assert bool(telling(problem, misreadings(problem))) is said
    told = Problem(LAG, Experiment(fine_steps(1, noise=0.5), rounded={"u": 0.02}), LAG_SPACE, hold={"u": "linear"})
    assert telling(told, misreadings(told))


def test_steps_follow_the_unit_of_their_signal():
    r = drive(1, 40)
    turns = Recording(
        r.recording.t, {**r.recording.signals, "w": Signal(r.recording["w"] * 60 / (2 * np.pi), "rpm")}, "drive"
    )
    step = misreadings(Problem(WHEEL, Experiment(turns, counted={"w": r.counted["w"] * 60 / (2 * np.pi)}), SPACE))[0]
    assert step.size == pytest.approx(2 * np.pi / 40, rel=1e-12)


def test_a_study_file_tells_by_its_cleaning_steps_which_speeds_are_made_of_counts():
    clean = [
        {"step": "counts_to_angle", "signal": "N", "name": "turned", "counts": 50, "ratio": 2.0},
        {"step": "differentiate", "signal": "turned", "name": "w", "method": "forward"},
        {"step": "differentiate", "signal": "turned", "name": "a", "derivative": 2},
        {"step": "differentiate", "signal": "x", "name": "v"},
        {"step": "counts_to_speed", "signal": "M", "name": "slow", "counts": 100},
    ]
    assert counted_signals(clean) == pytest.approx({"w": 4 * np.pi / 50, "slow": 2 * np.pi / 100})


@pytest.mark.parametrize(
    ("key", "given", "asked"), [("counted", {"v": 0.1}, "name one"), ("rounded", {"w": -1.0}, "or 0 for none")]
)
def test_steps_of_what_is_not_there_are_refused(key, given, asked):
    from plantfit.errors import RecordingError

    with pytest.raises(RecordingError, match=asked):
        Experiment(drive(1, 40).recording, **{key: given})


def test_steps_that_cannot_be_are_refused():
    from plantfit.errors import RecordingError

    record = drive(1, 40).recording
    with pytest.raises(RecordingError, match=r"steps of 500, but it moves by .* times seconds"):
        Experiment(record, counted={"w": 500.0})
    with pytest.raises(RecordingError, match=r"steps of 50, but it moves by .* in its unit\."):
        Experiment(record, rounded={"w": 50.0})
    with pytest.raises(RecordingError, match="both name 'w'; keep one"):
        Experiment(record, counted={"w": 0.1}, rounded={"w": 0.0})
    with pytest.raises(
        RecordingError, match=r"rounded names 'y', which is no input of the model; it is for inputs, here \['w'\]"
    ):
        Problem(WHEEL, Experiment(record, rounded={"y": 1e-4}), SPACE)


def test_a_speed_that_is_no_input_may_be_made_of_counts_by_a_cleaning_step(tmp_path):
    n = np.arange(200)
    rows = [f"{0.1 * k:g},{np.floor(3.0 * k + np.sin(0.3 * k)):g},{1.0 + np.sin(0.3 * k):g}" for k in n]
    (tmp_path / "a.csv").write_text("\n".join(["t,N,u", *rows]))
    (tmp_path / "a.toml").write_text("""
name = "w"
[recording.r]
file = "a.csv"
clean = [
    { step = "counts_to_angle", signal = "N", name = "turned", counts = 50 },
    { step = "differentiate", signal = "turned", name = "w", method = "forward" },
]
[model]
equations = "w' = (K*u - w)/tau"
inputs = ["u"]
outputs = { w = "rad/s" }
states = { w = { unit = "rad/s" } }
[parameters.K]
bounds = [0.1, 10]
unit = "rad/s"
[parameters.tau]
bounds = [0.1, 10]
unit = "s"
""")
    problem = load(tmp_path / "a.toml").problem
    assert misreadings(problem) == []
    text = (tmp_path / "a.toml").read_text()
    (tmp_path / "a.toml").write_text(text.replace("[model]", "counted = { w = 0.1 }\n[model]"))
    with pytest.raises(PlantfitError, match="counted names 'w', which is no input of the model"):
        load(tmp_path / "a.toml")


def test_recordings_err_each_by_itself():
    one, two = drive(1, 40, noise=0.0), drive(2, 40, noise=0.0)
    together = Problem(
        WHEEL, {"one": one, "two": two}, {"r": SPACE["r"], "x0": Parameter((-1.0, 1.0), "m", per_recording=True)}
    )
    start = together.space.cube(together.space.vector({"r": RADIUS, "x0[one]": 0.0, "x0[two]": 0.0}))
    both = moves(together, start, linearise(together, start), misreadings(together)).values[0]
    alone = [
        moves(p, z, linearise(p, z), misreadings(p)).values[0]
        for p in (Problem(WHEEL, one, SPACE), Problem(WHEEL, two, SPACE))
        for z in [p.space.cube(p.space.vector({"r": RADIUS, "x0": 0.0}))]
    ]
    assert both == pytest.approx(np.hypot(*alone) / 2, rel=0.05)  # the mean of two that are as long
