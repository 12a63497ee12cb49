"""The paper's bench, virtual: H-bridge, encoder and one line every 100 ms for 150 s, around a motor whose constants are known.

Tran et al., A Survey of Identification Experimental System Parameters Using Genetic Algorithm; hardware and excitation of sections 3 and 4.
"""

from dataclasses import dataclass

import numpy as np

from plantfit.recording import duty_to_voltage, period_to_speed
from plantfit.recording.excitation import sine_square
from plantfit.recording.record import Recording, Signal
from plantfit.rig.dc_motor import DcMotorRig
from plantfit.rig.run import RigRun

PERIOD, DURATION, BLOCK = 0.1, 150.0, 30.0  # s: a line of the serial port, a record, one round of the excitation
OLDEST = 1e-3  # s: readings that tell of an earlier time are not sent

# Printed in section 5.2, there with K_f for Tf
PUBLISHED = {"Rm": 2.826, "Lm": 0.0452, "Kb": 0.0061, "Kt": 0.0926, "Jm": 0.0023, "Cm": 0.0023, "Tf": 0.0000519}
# Kt = Kb in SI units. The printed pair would turn each watt of back-EMF into 15 W of shaft power; Kt is kept of it.
TRUTH = PUBLISHED | {"Kb": PUBLISHED["Kt"]}
UNITS = {"Rm": "ohm", "Lm": "H", "Kb": "V*s/rad", "Kt": "N*m/A", "Jm": "kg*m^2", "Cm": "N*m*s/rad", "Tf": "N*m"}


@dataclass(frozen=True)
class Bench:
    """`recording` V (V), w (rad/s), i (A) as the board sends them, missing where its reading is too old; `run` with the truth."""

    recording: Recording
    run: RigRun


def rig() -> DcMotorRig:
    """12 V bridge at 98 % with 8 bits, 500 lines read on all four edges, a Hall sensor of 20 mA rms."""
    return DcMotorRig(
        TRUTH, pulses=2000, ratio=1.0, slot_error=0.01, current="signed", current_noise=0.02, current_step=0.01, period=PERIOD,
        substeps=200,
    )  # fmt: skip


def excitation() -> Recording:
    """Sines of both signs beyond 1 V, which covers the dead zone, and a square wave: three sections of 10 s, up to 11 V.

    The first line is sent before the bridge is switched on, so that every model starts at rest.
    """
    wave = sine_square(11.0, 1 / PERIOD, DURATION, block=BLOCK, frequency=0.2, dead_zone=1.0)
    volts = wave["V"].copy()
    volts[0] = 0.0
    return Recording(wave.t, {"V": Signal(volts, "V")}, wave.name, (*wave.log, "0 V at the first sample."))


def bench(seed: int = 1) -> Bench:
    """One record; noise, the encoder's phase and its slots come from `seed`."""
    own = rig()
    run = own.record(seed, excitation(), name="motor")
    told = duty_to_voltage(run.recording, "duty", "V", own.supply, 2**own.bits - 1, own.bits, own.efficiency)
    told = period_to_speed(told, "Tp", "w", own.pulses, slot_error=own.slot_error, counts="N", lag="age")
    sent = np.where(told["age"] <= OLDEST, told["w"], np.nan)
    dropped = f"{int(np.sum(np.isnan(sent)))} readings older than {OLDEST:g} s, from where the motor reverses, are not sent."
    signals = {"V": told.signals["V"], "w": Signal(sent, "rad/s"), "i": told.signals["i"]}
    return Bench(Recording(told.t, signals, "motor", (*told.log, dropped)), run)
