"""A loop closed over the serial line: the host-compiled firmware with its simulated motor, held to the controller
run again."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from firmware_host import SCALE, build, read_truth, running
from tuned_files import tuned_file

from plantfit.control.tune import Wishes
from plantfit.errors import BoardError, RecordingError
from plantfit.models.text.equations import equations
from plantfit.recording import read_csv
from plantfit.recording.excitation import prbs
from plantfit.rig.board import record
from plantfit.rig.board.pilot import Loop, Pilot
from plantfit.rig.board.protocol import Board, Channel, Drive
from plantfit.rig.offered.tuned import read_tuned

sys.path.append(str(Path(__file__).resolve().parents[1] / "cli"))
from cli_call import call

PERIOD = 0.05
TUNED = {
    "output": {"name": "angle", "unit": "rad"},
    "input": {"name": "V", "unit": "V"},
    "wishes": {
        "period": PERIOD,
        "lower": -10.0,
        "upper": 10.0,
        "anti_windup": "clamping",
        "set_point": 25.0,
        "step": 15.0,
        "horizon": 5.0,
    },
    "controllers": [{"Kp": 0.15, "Ki": 0.0, "Kd": 0.004, "b": 1.0, "filter_time": 0.02}],
}


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return build(tmp_path_factory.mktemp("firmware"))


@pytest.fixture
def tuned(tmp_path):
    file = tmp_path / "motor-tune.json"
    file.write_text(json.dumps(TUNED))
    return file


@pytest.mark.thorough
def test_the_board_is_driven_to_its_set_points(capsys, monkeypatch, program, tuned, tmp_path):
    with running(program, "--truth", tmp_path / "truth", "--watchdog", 3000) as port:
        said = call(
            capsys,
            monkeypatch,
            "record",
            "--port",
            port,
            "--controller",
            tuned,
            "--out",
            tmp_path / "run.csv",
            "--json",
        )
    assert said.code == 0, said.err
    assert json.loads(said.out)["stopped"] is True
    got, truth = read_csv(tmp_path / "run.csv"), read_truth(tmp_path / "truth")
    assert set(np.unique(got["angle_set"])) == {10.0, 25.0}
    assert got.signals["angle_set"].unit == "rad"
    middle, last = got.t < 2.4, got.t > 4.8
    stuck = 0.46 / 0.15  # dry friction holds the motor below Tf R / K = 0.46 V
    assert got["angle"][middle][-1] == pytest.approx(10.0, abs=stuck + 0.5)
    assert np.mean(got["angle"][last]) == pytest.approx(25.0, abs=stuck + 0.5)
    assert_driven_as_read(read_tuned(tuned).running(), got, truth)
    assert any(
        "Driven from angle by the PID of motor-tune.json, every 0.05 s; set points: angle = 10, 25 rad" in line
        for line in got.log
    )
    assert any(f"The controller on this computer gave {len(got)} commands" in line for line in got.log)


def assert_driven_as_read(controller, got, truth):
    """What the motor got are the commands of the controller on these measurements, in their order."""
    controller.begin(float(got["angle"][0]))
    wanted = [round(controller.update(y, r) / SCALE[0]) for y, r in zip(got["angle"], got["angle_set"], strict=True)]
    driven = truth.drives[:, 1][truth.drives[:, 0] >= truth.samples[0, 1]]
    assert driven[-1] == 0
    place = iter(wanted)
    assert all(raw in place for raw in driven[np.flatnonzero(driven)])
    assert len(set(driven)) > 10


@pytest.mark.parametrize("kind", [pytest.param("lqi", marks=pytest.mark.slow), "mpc"])
@pytest.mark.thorough
def test_an_lqi_and_an_mpc_drive_the_board_as_well(capsys, monkeypatch, program, tmp_path, kind):
    """For the motor that the host's firmware simulates (firmware/host/sim_motor.c), without its winding and its dry
    friction."""
    damping = 1.2e-5 + 0.025**2 / 2.8
    text = "angle' = w\nw' = (K*V - w)/tau"
    model = equations(
        text, inputs=["V"], states=["angle", "w"], outputs=["angle"], parameters=["K", "tau"], name="motor"
    )
    values = {"K": 0.98 * 0.025 / 2.8 / damping, "tau": 2.5e-5 / damping}
    wishes = Wishes(25.0, 15.0, 0.1, PERIOD, -10.0, 10.0, controller=kind, horizon=5.0)
    file = tuned_file(tmp_path, model, values, wishes, (1.0, 1.0, 0.3, 0.3), ("rad", "V"))
    with running(program, "--truth", tmp_path / "truth", "--watchdog", 3000) as port:
        said = call(
            capsys, monkeypatch, "record", "--port", port, "--controller", file, "--out", tmp_path / "run.csv", "--json"
        )
    assert said.code == 0, said.err
    got, truth = read_csv(tmp_path / "run.csv"), read_truth(tmp_path / "truth")
    assert set(np.unique(got["angle_set"])) == {10.0, 25.0}
    assert np.mean(got["angle"][(got.t > 1.9) & (got.t < 2.4)]) == pytest.approx(10.0, abs=1.0)
    # its load takes dry friction away, but for hunting
    assert np.mean(got["angle"][got.t > 4.5]) == pytest.approx(25.0, abs=1.0)
    assert_driven_as_read(read_tuned(file).running(), got, truth)
    assert any(f"Driven from angle by the {kind.upper()} of {file.name}, every 0.05 s" in line for line in got.log)


def test_a_silent_machine_stops_the_motor_and_the_loop_begins_anew(program, tuned, tmp_path):
    import time

    loop, slept = _loop(tuned, seconds=2.5), []

    def sleepy(progress):
        if progress.seconds > 0.8 and not slept:
            slept.append(True)
            time.sleep(1.2)

    with running(program, "--truth", tmp_path / "truth", "--watchdog", 300) as port:
        told = record(port, tmp_path / "run.csv", loop=loop, watch=sleepy)
    truth = read_truth(tmp_path / "truth")
    stopped = truth.samples[truth.samples[:, 4] == 3]
    assert len(stopped) > 2
    assert np.all(stopped[:, 2] == 0)
    assert told.watchdogs >= 1
    assert any("began anew" in line for line in told.log)
    assert truth.drives[-1, 1] == 0


def _loop(file, seconds=1.0, **more):
    tuned = read_tuned(file)
    s = tuned.settings
    loop = Loop(
        tuned.running(), s.period, tuned.output, tuned.output_unit, tuned.input, tuned.input_unit, s.lower, s.upper,
        np.zeros(1),
        np.full(1, 5.0), seconds, "",
    )  # fmt: skip
    return replace(loop, **more)


def test_what_does_not_fit_is_said_before_anything_moves(tuned, tmp_path):
    board = Board("rig", "0.2", 1, 1000, 0.3, 512, Drive("V", "V", 0.05, 200), (Channel("angle", "rad", 0.01),))
    fits = _loop(tuned)
    assert Pilot(fits, board, 50).every == 1
    assert Pilot(fits, board, 10).every == 5
    wrong: list[tuple[dict[str, Any], int, str]] = [
        ({"output": "T1"}, 50, "The controller measures 'T1' and drives 'V'; board 'rig' measures angle"),
        ({"input": "u"}, 50, "drives 'u'"),
        ({"upper": 24.0}, 50, "drives V up to 24 V, but the board gives up to 10 V"),
        ({"period": 0.005}, 5, "faster than this computer answers"),
        ({}, 30, "no whole number of samples"),
    ]
    for more, divide, sentence in wrong:
        with pytest.raises((BoardError, RecordingError), match=sentence):
            Pilot(replace(fits, **more), board, divide)
    with pytest.raises(RecordingError, match="Both an excitation and a controller"):
        record("/dev/null", tmp_path / "x.csv", prbs(1.0, 10, 1), loop=fits)


def test_units_of_the_study_and_of_the_board_may_differ(tuned):
    """A study in degrees and millivolts on a board of radians and volts."""
    board = Board("rig", "0.2", 1, 1000, 0.3, 512, Drive("V", "V", 0.05, 200), (Channel("angle", "rad", 0.01),))

    class Echo:
        def begin(self, measurement):
            self.begun = measurement

        def update(self, measurement, reference):
            return 1000.0 * (reference - measurement)

    from plantfit.rig.board.protocol import Sample

    echo = Echo()
    loop = _loop(
        tuned, controller=echo, output_unit="deg", input_unit="mV", lower=-9e3, upper=9e3, set_points=np.array([90.0])
    )
    pilot = Pilot(loop, board, 50)
    pilot.begin(7)
    pilot.take(Sample(7, 0, 0, -1, 0, (155,)), 0.0)
    assert echo.begun == pytest.approx(np.degrees(1.55))
    assert pilot.wanted == pytest.approx(np.pi / 2)
    assert pilot.command() == round((90.0 - np.degrees(1.55)) / 0.05)
    assert pilot.command() is None
