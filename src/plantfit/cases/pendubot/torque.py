"""The record of the paper's study: torque and motion of a virtual pendubot, as its sensors would give them."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plantfit.models.library.pendubot import motor_torque
from plantfit.recording import cutoff_frequency, differentiate, lowpass, to_csv
from plantfit.recording.record import Recording, Signal
from plantfit.rig import PendubotRig, RigRun
from plantfit.rig.lqg import Weights

SEED = 2024
FILE, CALM = "torque.csv", "calm.csv"
# The observer trusts the encoders until the torque chatters as much as the paper's residual, 0.015 N m.
JITTERY = Weights((math.radians(3.0), math.radians(3.0), 0.0, 0.0), 4.0, 1.0, 1e-5)
STEPS_RMS = 1.0 / math.sqrt(12.0)  # of rounding, in steps


@dataclass(frozen=True)
class TorqueRecord:
    """`recording` of angles, rates, accelerations and the torque of joint 1, its `cutoff` (Hz) and why; `run` it was
    made from."""

    recording: Recording
    cutoff: float
    rule: str
    run: RigRun


def torque_record(seed: int = SEED, weights: Weights = JITTERY) -> TorqueRecord:
    """Record the paper's trajectory on the virtual rig and make the signals of `pendubot_regression` of it.

    The angles pass a zero-phase Butterworth of order 3; its cut-off is the one that removes from theta1 as much as
    rounding to encoder steps adds (`cutoff_frequency`, rule "discrepancy"). Rates and accelerations are central
    differences. The torque is that of the recorded voltage and the rate of joint 1, not filtered, as in the paper.
    """
    rig = PendubotRig(weights=weights)
    run = rig.record(seed=seed)
    found = cutoff_frequency(run.recording, "theta1", "discrepancy", noise=STEPS_RMS * 2 * np.pi / rig.counts)
    recording = run.recording
    for joint in (1, 2):
        recording = lowpass(recording, f"theta{joint}", found.frequency, order=3)
        recording = differentiate(recording, f"theta{joint}", f"omega{joint}", "central")
        recording = differentiate(recording, f"omega{joint}", f"alpha{joint}", "central")
    p = run.truth["parameters"]
    torque = motor_torque(recording["V"], recording["omega1"], p["kt"], p["ke"], p["Ra"])
    kept = {n: recording.signals[n] for n in ("theta1", "theta2", "omega1", "omega2", "alpha1", "alpha2")}
    made = Recording(recording.t, {**kept, "tau1": Signal(torque, "N*m")}, "torque", recording.log)
    return TorqueRecord(made, found.frequency, found.sentence, run)


def write_record(record: TorqueRecord, folder: Path, name: str = FILE) -> Path:
    """The recording as the CSV file that a study file reads."""
    return to_csv(record.recording, folder / name)
