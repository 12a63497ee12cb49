"""Rigs by name with constants of the user's own: exact to other solvers and closed forms, with a truth that says all
of it."""

import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tuned_files import tuned_file

import plantfit as pf
from plantfit.control.tune import Wishes
from plantfit.errors import PlantfitError, RecordingError, SimulationError, UnitError
from plantfit.recording import read_csv
from plantfit.rig.offered import names, offered, record_rig

sys.path.append(str(Path(__file__).resolve().parents[1] / "cli"))
from cli_call import call

STEAM = {"k": 0.4, "A1": 30.0, "A2": 150.0, "Td": 0.53}
IDEAL = {**STEAM, "transducer_limit": 0, "card_limit": 0}


def same(a, b):
    return all(np.array_equal(a[n], b[n], equal_nan=True) for n in a.signals)


@pytest.mark.parametrize("name", names())
def test_a_seed_gives_the_same_bits_and_another_seed_another_record(name):
    short = {"pendubot": 3.0, "robot_motor": 0.05}.get(name, max(20.0, 20 * offered(name).period))
    one, again, other = (record_rig(name, seed=s, duration=short) for s in (3, 3, 4))
    assert same(one.recording, again.recording)
    assert one.truth == again.truth
    assert not same(one.recording, other.recording)


@pytest.mark.parametrize("name", names())
def test_the_truth_says_every_number_with_its_unit(name):
    truth = record_rig(name, duration=max(3.0, 20 * offered(name).period)).truth
    told = {**truth["constants"], **truth["noise"], **truth["settings"]}
    for n in offered(name).numbers:
        if n.value is not None:
            assert told[n.name]["value"] == n.value
            assert told[n.name]["unit"] == n.unit
    assert truth["seed"] == 1
    assert truth["excitation"]
    assert truth["drawn"]
    assert truth["determined"]
    json.dumps(truth, allow_nan=False)


def test_the_page_on_virtual_rigs_has_a_row_for_every_rig():
    rows = re.findall(
        r"^\| `(\w+)` \|",
        (Path(__file__).resolve().parents[2] / "docs" / "virtual-rigs.md").read_text("utf-8"),
        re.MULTILINE,
    )
    missing = [name for name in names() if name not in rows]
    assert missing == [], f"add a row for {missing} to the table of rigs in docs/virtual-rigs.md"


def test_a_pendubot_with_its_own_links_moves_as_its_equations_say():
    own = {"l1": 0.25, "m2": 0.12, "lc2": "140 mm", "Fv1": 2e-3, "g": 9.8}
    made = record_rig("pendubot", own, seed=2, duration=7.0)
    p = {"m1": 0.21, "m2": 0.12, "lc1": 0.12, "lc2": 0.14, "I1": 0.00053, "I2": 0.00077}

    def rate(_, x, volts):
        q1, q2, v1, v2 = x
        b1, b2 = p["m1"] * p["lc1"] ** 2 + p["m2"] * 0.25**2 + p["I1"], p["m2"] * p["lc2"] ** 2 + p["I2"]
        b3, b4, b5 = p["m2"] * 0.25 * p["lc2"], p["m1"] * p["lc1"] + p["m2"] * 0.25, p["m2"] * p["lc2"]
        c, s = np.cos(q2), np.sin(q2)
        inertia = np.array([[b1 + b2 + 2 * b3 * c, b2 + b3 * c], [b2 + b3 * c, b2]])
        gravity = 9.8 * np.array([b4 * np.cos(q1) + b5 * np.cos(q1 + q2), b5 * np.cos(q1 + q2)])
        turning = np.array([-b3 * (2 * v1 * v2 + v2**2) * s, b3 * v1**2 * s])
        torque = np.array([0.0724 / 2.983 * (volts - 0.0724 * v1) - 2e-3 * v1, 0.0])
        return np.r_[v1, v2, np.linalg.solve(inertia, torque - turning - gravity)]

    exact = np.stack([made.exact[n] for n in ("theta1", "theta2", "omega1", "omega2")], axis=1)
    for k in (0, 4600, 5600, 6500):
        x = exact[k]
        for j in range(k, k + 10):
            x = solve_ivp(rate, (0, 1e-3), x, "DOP853", args=(made.exact["V"][j],), rtol=1e-12, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(exact[k + 10], x, rtol=0, atol=2e-11)
    base = {n: d["value"] for n, d in made.truth["determined"].items()}
    assert base["b1"] == pytest.approx(0.21 * 0.12**2 + 0.12 * 0.25**2 + 0.00053, rel=1e-14)
    assert base["Fv1"] == 2e-3


def test_a_motor_with_its_own_constants_turns_as_its_equations_say():
    own = {"Rm": 1.5, "Lm": 0.01, "Kb": 0.05, "Jm": 1e-3, "Cm": 5e-4, "Tf": 0.0}
    made = record_rig("dc_motor", own, seed=2, duration=8.0, excitation="4V,-3V")
    volts = made.exact["V"]
    assert np.max(np.abs(volts[:40] - 4)) < 0.03  # whole counts of the bridge
    assert np.max(np.abs(volts[41:] + 3)) < 0.03

    def rate(_, x, v):
        return [(v - 1.5 * x[0] - 0.05 * x[1]) / 0.01, (0.05 * x[0] - 5e-4 * x[1]) / 1e-3]

    x = [0.0, 0.0]
    for k in range(80):
        assert made.exact["w"][k] == pytest.approx(x[1], abs=1e-4)
        x = solve_ivp(rate, (0, 0.1), x, "DOP853", args=(volts[k],), rtol=1e-10, atol=1e-10).y[:, -1]
    assert made.truth["constants"]["Kt"]["value"] == 0.05  # as Kb, where it is not given
    assert "i" not in record_rig("dc_motor", without=["i"], duration=8.0).recording.signals


def test_a_robots_motor_settles_at_the_speed_of_its_closed_form():
    made = record_rig("robot_motor", {"Rm": 4.0, "Cm": "2e-6 N*m*s/rad"}, seed=1)
    kb = 5.008705e-3
    assert made.exact["w"][-1] == pytest.approx(made.exact["V"][-1] * kb / (4.0 * 2e-6 + kb**2), rel=1e-3)


def test_a_steam_chamber_of_constants_follows_four_steps_in_closed_form():
    made = record_rig("steam_chamber", IDEAL, seed=1, excitation="20%,60%,30%,80%")
    t, u = made.exact.t, made.recording["u"]
    fast, slow = np.sort(np.roots([STEAM["A2"], STEAM["A1"], 1.0]).real)

    def step(s):
        s = np.maximum(s - STEAM["Td"], 0.0)
        return STEAM["k"] * (1 + (fast * np.exp(slow * s) - slow * np.exp(fast * s)) / (slow - fast))

    edges = [0, *(np.flatnonzero(np.diff(u)) + 1)]
    assert len(edges) == 4
    y = sum((u[e] - (u[e - 1] if e else 0.0)) * step(t - t[e]) for e in edges)
    np.testing.assert_allclose(made.exact["y"], y, atol=2e-4)
    assert np.std(made.recording["y"] - y) == pytest.approx(math.hypot(0.05, 39 / 4096 / math.sqrt(12)), rel=0.05)


def test_a_record_is_saved_with_truth_study_and_exact_signals(tmp_path):
    made = record_rig("steam_chamber", STEAM, seed=1)
    places = made.save(tmp_path / "run.csv.gz", study=True, exact=True)
    assert {p.name for p in places.values()} == {"run.csv.gz", "run.truth.json", "run.toml", "run.exact.csv"}
    assert same(read_csv(places["record"]), made.recording)
    assert json.loads(places["truth"].read_text("utf-8")) == {**made.truth, "record": "run.csv.gz"}
    with pytest.raises(RecordingError, match="exists already"):
        made.save(tmp_path / "run.csv.gz")
    with pytest.raises(RecordingError, match="no folder"):
        made.save(tmp_path / "nowhere" / "run.csv")
    with pytest.raises(RecordingError, match=r"ends in \.csv"):
        made.save(tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "options", "floor"),
    [
        ("steam_chamber", {"constants": IDEAL, "excitation": "20%,60%,30%,80%"}, {"y": 0.06}),
        ("dc_motor", {"without": ["i"]}, {"w": 1.0}),
        ("dc_motor", {}, {"w": 1.0, "i": 0.025}),
        ("robot_motor", {}, {"I": 0.003}),
    ],
)
def test_a_study_at_the_truth_is_at_the_floor_of_the_noise(tmp_path, name, options, floor):
    made = record_rig(name, seed=5, **options)
    study = pf.load(made.save(tmp_path / "run.csv", study=True)["study"])
    truth = {n: d["value"] for n, d in made.truth["determined"].items()}
    point = np.array([truth[n] for n in study.problem.space.names])
    seen = study.problem.predict(point)
    record = next(iter(study.problem.experiments.values())).recording
    for output, most in floor.items():
        error = seen[output] - record[output]
        assert np.sqrt(np.nanmean(error[5:] ** 2)) < most
    bounds = [(c.lower, c.upper) for c in study.problem.space.coordinates]
    assert all(low < v < high for (low, high), v in zip(bounds, point, strict=True))
    assert not any(c.start for c in study.table.parameters.values())  # the file does not tell the truth to the search


@pytest.mark.parametrize(
    ("name", "options", "error", "sentence"),
    [
        ("pendobot", {}, SimulationError, "Did you mean 'pendubot'"),
        (
            "pendubot",
            {"constants": {"m2": -0.1}},
            SimulationError,
            r"m2 = -0\.1 kg cannot be \(mass of link 2\); give a number above 0 kg",
        ),
        ("pendubot", {"constants": {"m2": 0}}, SimulationError, "m2 = 0 kg cannot be"),
        ("pendubot", {"constants": {"m2": math.nan}}, SimulationError, "m2 = nan kg cannot be"),
        ("pendubot", {"constants": {"m2": "0.1 V"}}, UnitError, "is in 'V', but m2 .* is in 'kg'"),
        ("pendubot", {"constants": {"m2": "heavy"}}, UnitError, "'heavy' is not a number with a unit"),
        ("pendubot", {"constants": {"m3": 1}}, SimulationError, "has no 'm3'.* It has m1, m2"),
        ("pendubot", {"constants": {"counts": 1000.5}}, SimulationError, "give a whole number of at least 100"),
        ("pendubot", {"constants": {"m2": 2.0}}, SimulationError, r"fell at .* give shorter or lighter links"),
        ("pendubot", {"excitation": "3V"}, SimulationError, "takes no excitation"),
        ("pendubot", {"seed": -1}, SimulationError, "seed = -1"),
        ("pendubot", {"duration": -1.0}, SimulationError, "duration = -1 s"),
        ("pendubot", {"period": 10.0}, SimulationError, "under 10 samples"),
        ("dc_motor", {"period": 1e-6}, SimulationError, "over 2000000 samples"),
        ("dc_motor", {"excitation": "13V"}, SimulationError, "the bridge gives 11.76 V"),
        ("dc_motor", {"excitation": "3Q"}, SimulationError, "is no value and no file"),
        ("dc_motor", {"excitation": "3kg"}, UnitError, "cannot be converted"),
        ("dc_motor", {"excitation": "nowhere.csv"}, RecordingError, "does not exist"),
        ("dc_motor", {"without": ["w"]}, SimulationError, "cannot leave out 'w'; its record may lack i"),
        ("pendubot", {"without": ["V"]}, SimulationError, "lacks none of its channels"),
        ("steam_chamber", {"constants": {"k": 0.4}}, SimulationError, "k is given, but A1 is not"),
        ("steam_chamber", {"excitation": "20%,40%"}, SimulationError, "takes 2 openings"),
        ("steam_chamber", {"excitation": "120%"}, SimulationError, "The opening is 120"),
        ("robot_motor", {"constants": {"efficiency": 1.2}}, SimulationError, "above 0 and at most 1"),
    ],
)
def test_what_cannot_be_is_told_in_one_sentence(name, options, error, sentence):
    with pytest.raises(error, match=sentence) as said:
        record_rig(name, **options)
    assert isinstance(said.value, PlantfitError)
    assert "\n" not in str(said.value)


TUNED = {
    "output": {"name": "w", "unit": "rad/s"}, "input": {"name": "V", "unit": "V"},
    "controllers": [{"name": "all plants", "Kp": 0.05, "Ki": 0.4, "Kd": 0.0, "b": 0.7, "filter_time": 0.0}],
    "wishes": {"period": 0.02, "lower": -9.0, "upper": 9.0, "anti_windup": "clamping", "set_point": 40.0, "step": 20.0},
}  # fmt: skip


def test_a_tuned_controller_drives_the_motor_by_what_its_encoder_says(tmp_path):
    """The voltages that were recorded are those of a PID in plain floats on the recorded readings, and the motion is
    theirs."""
    from plantfit.rig.offered.dc_motor import board_rig

    (tmp_path / "motor-tune.json").write_text(json.dumps(TUNED))
    made = record_rig("dc_motor", controller=tmp_path / "motor-tune.json", seed=4, duration=6.0)
    record, exact = made.recording, made.exact
    assert np.diff(record.t) == pytest.approx(0.02)
    assert set(record["w_set"]) == {20.0, 40.0}
    assert exact["w"][-1] == pytest.approx(40.0, rel=0.01)
    assert exact["w"][len(record) // 2 - 5] == pytest.approx(20.0, rel=0.01)
    assert "PID of motor-tune.json (Kp 0.05, Ki 0.4 /s, Kd 0 s, a sample every 0.02 s)" in record.log[-1]

    from plantfit.rig.offered.dc_motor import TRUTH

    rig = board_rig(TRUTH)
    rig = replace(rig, period=0.02, substeps=40)
    raw = rig.record(4, pf.from_arrays({"t": record.t, "V": record["V"]}, units={"V": "V"}))
    assert np.array_equal(raw.exact["w"], exact["w"])
    period = raw.recording["Tp"]
    speed = np.where(np.abs(period) >= rig.timeout, 0.0, 2 * np.pi / rig.pulses / period)
    integral, last, step = 0.0, 0.0, rig.volts_per_count
    for k, (y, r) in enumerate(zip(speed, record["w_set"], strict=True)):
        e = r - y
        added = 0.5 * 0.02 * 0.4 * (e + last)
        wanted = 0.05 * (0.7 * r - y) + integral + added
        beyond = (wanted > 9.0 and added > 0) or (wanted < -9.0 and added < 0)
        integral, last = integral + (0.0 if beyond else added), e
        assert record["V"][k] == pytest.approx(step * round(min(max(wanted, -9.0), 9.0) / step), abs=1e-9), k


@pytest.mark.parametrize("kind", ["lqi", pytest.param("mpc", marks=pytest.mark.slow)])  # the board is driven by it
def test_an_lqi_and_an_mpc_drive_the_motor_as_well(capsys, monkeypatch, tmp_path, kind):
    """By command: the voltages are those of the controller on the recorded readings, and its load takes friction
    away."""
    from plantfit.rig.offered.dc_motor import TRUTH, board_rig
    from plantfit.rig.offered.tuned import read_tuned

    damping = TRUTH["Cm"] + TRUTH["Kt"] * TRUTH["Kb"] / TRUTH["Rm"]
    model = pf.equations(
        "w' = (K*V - w)/tau", inputs=["V"], states=["w"], outputs=["w"], parameters=["K", "tau"], name="motor"
    )
    values = {"K": TRUTH["Kt"] / TRUTH["Rm"] / damping, "tau": TRUTH["Jm"] / damping}
    wishes = Wishes(40.0, 20.0, 0.5, 0.02, -9.0, 9.0, controller=kind)
    file = tuned_file(tmp_path, model, values, wishes, (0.3, 10.0, 0.3, 0.2), ("rad/s", "V"))
    said = call(
        capsys, monkeypatch, "rig", "dc_motor", "--controller", file, "--seed", "4", "--duration", "6s", "--exact",
        "--out", tmp_path / "m.csv",
    )  # fmt: skip
    assert said.code == 0, said.err
    record, exact = pf.read_csv(tmp_path / "m.csv"), pf.read_csv(tmp_path / "m.exact.csv")
    assert exact["w"][-50:] == pytest.approx(40.0, rel=0.02)
    assert exact["w"][len(record) // 2 - 50 : len(record) // 2 - 1] == pytest.approx(20.0, rel=0.04)
    assert any(
        f"In a loop with the {kind.upper()} of {file.name} (1 states and the load estimated" in line
        for line in record.log
    )
    rig = board_rig(TRUTH)
    rig = replace(rig, period=0.02, substeps=40)
    raw = rig.record(4, pf.from_arrays({"t": record.t, "V": record["V"]}, units={"V": "V"}))
    period, step = raw.recording["Tp"], rig.volts_per_count
    speed = np.where(np.abs(period) >= rig.timeout, 0.0, 2 * np.pi / rig.pulses / period)
    controller = read_tuned(file).running()
    controller.begin(0.0)
    for k, (y, r) in enumerate(zip(speed, record["w_set"], strict=True)):
        assert record["V"][k] == pytest.approx(step * round(controller.update(y, r) / step), abs=1e-9), k


def test_set_points_of_a_loop_are_given_in_any_unit_and_slips_are_told(tmp_path):
    (tmp_path / "motor-tune.json").write_text(json.dumps(TUNED | {"output": {"name": "w", "unit": "rpm"}}))
    made = record_rig("dc_motor", controller=tmp_path / "motor-tune.json", excitation="600rpm", duration=2.0)
    assert made.recording["w_set"] == pytest.approx(20 * np.pi)
    with pytest.raises(SimulationError, match=r"leave --period 0\.1 s out"):
        record_rig("dc_motor", controller=tmp_path / "motor-tune.json", period=0.1)
    with pytest.raises(SimulationError, match="cannot be driven by a tuned controller yet; dc_motor can"):
        record_rig("pendubot", controller=tmp_path / "motor-tune.json")
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(
        SimulationError, match=r"bad.json' is not a controller; name a file NAME-tune.json that `plantfit tune` wrote"
    ):
        record_rig("dc_motor", controller=tmp_path / "bad.json")
    with pytest.raises(SimulationError, match="cannot be read"):
        record_rig("dc_motor", controller=tmp_path / "none.json")
    (tmp_path / "bar-tune.json").write_text(json.dumps(TUNED | {"output": {"name": "y", "unit": "bar"}}))
    with pytest.raises(UnitError, match="cannot be converted"):
        record_rig("dc_motor", controller=tmp_path / "bar-tune.json")


def test_tables_of_one_opening_hold_at_every_opening_and_two_plants_are_refused():
    made = record_rig("steam_chamber", {"tables_of": 40}, excitation="20%,40%", duration=120.0)
    one = record_rig("steam_chamber", excitation="40%", duration=120.0)
    assert made.truth["determined"] == one.truth["determined"]
    settled = record_rig("steam_chamber", {"tables_of": 40}, excitation="20%", duration=600.0)
    p = settled.truth["determined"]
    y = settled.exact["y"][-1]
    assert y == pytest.approx(20.0 * np.interp(y, p["nodes"]["value"], p["k"]["value"]), rel=1e-6)
    with pytest.raises(SimulationError, match="k and tables_of are given; give one plant"):
        record_rig("steam_chamber", {"tables_of": 40, "k": 0.4})
