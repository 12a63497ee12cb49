"""The paper's bench, virtual: H-bridge, encoder and one line every 100 ms for 150 s, around a motor whose constants are
known.

Tran et al., A Survey of Identification Experimental System Parameters Using Genetic Algorithm; hardware and excitation
of sections 3 and 4.
"""

from dataclasses import dataclass

from plantfit.recording.record import Recording
from plantfit.rig.dc_motor import DcMotorRig
from plantfit.rig.offered.dc_motor import OLDEST as OLDEST
from plantfit.rig.offered.dc_motor import PERIOD as PERIOD
from plantfit.rig.offered.dc_motor import PUBLISHED as PUBLISHED
from plantfit.rig.offered.dc_motor import TRUTH as TRUTH
from plantfit.rig.offered.dc_motor import board_excitation, board_rig, sent
from plantfit.rig.offered.motor_studies import UNITS as UNITS
from plantfit.rig.run import RigRun


@dataclass(frozen=True)
class Bench:
    """`recording` V (V), w (rad/s), i (A) as the board sends them, missing where its reading is too old; `run` with
    the truth."""

    recording: Recording
    run: RigRun


def rig() -> DcMotorRig:
    """12 V bridge at 98 % with 8 bits, 500 lines read on all four edges, a Hall sensor of 20 mA rms."""
    return board_rig(TRUTH)


def excitation() -> Recording:
    """Sines of both signs beyond 1 V and a square wave: three sections of 10 s, up to 11 V, for 150 s."""
    return board_excitation()


def bench(seed: int = 1) -> Bench:
    """One record; noise, the encoder's phase and its slots come from `seed`."""
    own = rig()
    run = own.record(seed, excitation(), name="motor")
    return Bench(sent(run, own), run)
