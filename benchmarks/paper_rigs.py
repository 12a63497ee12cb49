"""The rigs of the four papers for the study of coverage: study files of the demos, on records of any seed.

A record is made anew for each seed by the virtual rig, with all faults of its sensors, and read and cleaned as the
study file says.
"""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from plantfit.problem.problem import Problem
    from plantfit.recording.record import Recording
    from plantfit.spec import Study

EVALUATIONS = 3000  # of the search on the first record, whose final problem has the scales and steps of all


@dataclass(frozen=True)
class Demo:
    """A study `file` of the demo `case`; `write(seed, folder)` puts the record that it reads there.

    `made(seed)` gives the recordings where the study file only reads them, which is quicker. `alike`: records of all
    seeds have the same samples, so that their fits share compiled functions.
    """

    case: str
    file: str
    write: Callable[[int, Path], object]
    alike: bool = True
    made: "Callable[[int], Mapping[str, Recording]] | None" = None

    @cached_property
    def folder(self) -> Path:
        """Where files and records are."""
        from plantfit.cases.shared.files import unpack

        return unpack(self.case, tempfile.mkdtemp(prefix="coverage-"))

    @cached_property
    def study(self) -> "Study":
        """The study file on the record of seed 0, which no fit uses."""
        from plantfit.spec import load

        self.write(0, self.folder)
        return load(self.folder / self.file)

    def problem(self) -> "Problem":
        """The final problem of a search on the record of seed 0."""
        from plantfit.optimize import minimise
        from plantfit.stages import prepare
        from plantfit.trust.finish.final_problem import finish

        prepared = prepare(self.study.problem)
        return finish(prepared.problem, minimise(prepared.objective, "least_squares", budget=EVALUATIONS, seed=1))[0]

    def at(self, base: "Problem", seed: int) -> "Problem":
        """`base`, which is `problem()`, on the record of another seed, cleaned."""
        from plantfit.spec import load
        from plantfit.spec.recordings import read_recording
        from plantfit.stages import prepare

        if self.made is not None:
            return base.with_recordings(self.made(seed))
        self.write(seed, self.folder)
        if not self.alike:
            return prepare(load(self.folder / self.file).problem).problem.with_scales(base.scales)
        return base.with_recordings(
            {n: read_recording(n, r, self.study.path) for n, r in self.study.table.recording.items()}
        )


def torque(seed: int, folder: Path) -> None:
    """Pendubot: torque of joint 1 beside differentiated angles."""
    from plantfit.cases.pendubot.torque import torque_record, write_record

    write_record(torque_record(seed), folder)


def torque_alone(seed: int) -> "Mapping[str, Recording]":
    """The same without a file."""
    from plantfit.cases.pendubot.torque import torque_record

    return {"torque": torque_record(seed).recording}


def board(seed: int, folder: Path) -> None:
    """DC motor on a microcontroller's bench: voltage, speed and current."""
    from plantfit.cases.motor.bench import bench
    from plantfit.recording import to_csv

    to_csv(bench(seed).recording, folder / "motor.csv")


def robot(seed: int, folder: Path) -> None:
    """Motor of the mobile robot at 3 V: current and the period of pulses."""
    from plantfit.cases.robot.demo import bench

    bench(seed).save(folder)


def robot_noise(problem: "Problem") -> np.ndarray:
    """Covariance (m, m) of the residuals' noise on the bench of the robot's motor: of edges of the disc that lie wrong,
    of the timer's steps, and of the meter's noise and steps.

    A period is wrong by the difference of the errors of its two edges: neighbours share one, and each turn of the disc
    brings both back.
    """
    from plantfit.rig.dc_motor import DcMotorRig
    from plantfit.trust.intervals.linearised import named_blocks

    rig, rows = DcMotorRig(), {output: block.rows for _, output, block in named_blocks(problem)}
    [experiment] = problem.experiments.values()
    index = problem.data["index"][next(iter(problem.data["drive"]))]["w"]
    speed, slot = (experiment.recording[n][index] for n in ("w", "w_slot"))
    edges = np.zeros((rows["I"].stop, rig.pulses))
    at, size = np.arange(len(speed)) + rows["w"].start, rig.slot_error * speed / problem.scales["w"]
    edges[at, (slot.astype(int) + 1) % rig.pulses] += size
    edges[at, slot.astype(int) % rig.pulses] -= size
    period = 2 * np.pi * rig.ratio / rig.pulses / speed
    white = np.full(len(edges), np.hypot(rig.current_noise, rig.current_step / np.sqrt(12)) / problem.scales["I"])
    white[rows["w"]] = rig.tick / np.sqrt(6) / period * speed / problem.scales["w"]
    return edges @ edges.T + np.diag(white**2)


TORQUE = {"m1": 0.21, "m2": 0.1, "lc1": 0.12, "lc2": 0.15, "I1": 0.00053, "I2": 0.00077}
BOARD = {"Rm": 2.826, "Lm": 0.0452, "Kb": 0.0926, "Jm": 0.0023, "Cm": 0.0023, "Tf": 5.19e-05}
ROBOT = {"Ra": 2.759854243587, "La": 0.011186575703, "kw": 0.005008705, "B": 1.13284e-06, "J": 2.2748e-08}
# a chamber of constants, about that of 40 %
STEAM = {"k": 0.43, "A1": 31.0, "A2": 12.0, "Td": 0.2 + 0.6 * (60.0 / 90.0) ** 1.5}

PENDUBOT_TORQUE = Demo("pendubot", "torque.toml", torque, made=torque_alone)
MOTOR_SPEED = Demo("motor", "speed.toml", board)
MOTOR_CURRENT = Demo("motor", "current.toml", board)
ROBOT_MOTOR = Demo("robot", "motor.toml", robot, alike=False)


@dataclass(frozen=True)
class Steam:
    """The static task of one opening (%), as the demo fits it to whole records, on a chamber whose k, A1 and A2 are
    constant."""

    opening: float = 40.0

    @cached_property
    def rig(self):
        """Without errors of instruments, which no noise shows and `[uncertainty]` states."""
        from plantfit.rig.steam_chamber import NODES, SteamChamberRig

        return SteamChamberRig(
            truth=lambda opening: {n: v if n == "Td" else [v] * len(NODES) for n, v in STEAM.items()}, errors=False
        )

    def problem(self) -> "Problem":
        """The task on the record of seed 0."""
        from plantfit.cases.steam.problems import static_problem

        return static_problem({"opening": self._record(0)}, substeps=2)

    def at(self, base: "Problem", seed: int) -> "Problem":
        """The task on the record of another seed."""
        return base.with_recordings({"opening": self._record(seed)})

    def _record(self, seed: int) -> "Recording":
        return self.rig.record(self.opening, seed).recording


STEAM_STEP = Steam()
