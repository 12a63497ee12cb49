"""A DC motor on a microcontroller's board by name: voltage, speed and, unless left out, current, one line every 100
ms."""

from collections.abc import Mapping
from dataclasses import replace
from json import dumps
from typing import Any

import numpy as np

from plantfit import units
from plantfit.models.library.speed_law import EDGE, EQUATIONS, LABELS, LAW, SENTENCES, speed_law
from plantfit.models.library.speed_law import UNITS as LAW_UNITS
from plantfit.recording import duty_to_voltage, period_to_speed
from plantfit.recording.excitation import sine_square
from plantfit.recording.record import Recording, Signal
from plantfit.rig.dc_motor import DcMotorRig
from plantfit.rig.offered.contract import Asked, Number, OfferedRig, RigRecord, truth_of
from plantfit.rig.offered.driven import driven_by
from plantfit.rig.offered.motor_studies import MOTOR, UNITS, box, head, parameter, parameters_of
from plantfit.rig.offered.tuned import Tuned
from plantfit.rig.run import RigRun
from plantfit.rig.speed_loop import driven_by_controller

PERIOD, DURATION, BLOCK = 0.1, 150.0, 30.0  # s: a line of the serial port, a record, one round of the excitation
OLDEST = 1e-3  # s: readings that tell of an earlier time are not sent
STEPS_OF = 5e-4  # s between two steps of the rig's simulation

# Tran et al., A Survey of Identification Experimental System Parameters Using Genetic Algorithm, section 5.2, there
# with K_f for Tf
PUBLISHED = {"Rm": 2.826, "Lm": 0.0452, "Kb": 0.0061, "Kt": 0.0926, "Jm": 0.0023, "Cm": 0.0023, "Tf": 0.0000519}
# Kt = Kb in SI units. The printed pair would turn each watt of back-EMF into 15 W of shaft power; Kt is kept of it.
TRUTH = PUBLISHED | {"Kb": PUBLISHED["Kt"]}


def board_rig(parameters: Mapping[str, float]) -> DcMotorRig:
    """12 V bridge at 98 % with 8 bits that wanders by 2 mV rms, 500 lines read on all four edges, a Hall sensor of
    20 mA rms."""
    return DcMotorRig(
        parameters, pulses=2000, ratio=1.0, slot_error=0.01, current="signed", current_noise=0.02, current_step=0.01,
        wander=0.002,
        period=PERIOD, substeps=round(PERIOD / STEPS_OF),
    )  # fmt: skip


def board_excitation(amplitude: float = 11.0, duration: float = DURATION, period: float = PERIOD) -> Recording:
    """Sines of both signs beyond 1 V, which covers the dead zone, and a square wave: three sections of 10 s, up to
    `amplitude` (V).

    The first line is sent before the bridge is switched on, so that every model starts at rest.
    """
    wave = sine_square(amplitude, 1 / period, duration, block=BLOCK, frequency=0.2, dead_zone=min(1.0, 0.5 * amplitude))
    volts = wave["V"].copy()
    volts[0] = 0.0
    return Recording(wave.t, {"V": Signal(volts, "V")}, wave.name, (*wave.log, "0 V at the first sample."))


def sent(run: RigRun, rig: DcMotorRig, oldest: float = OLDEST) -> Recording:
    """V (V), w (rad/s), i (A) as the board sends them: readings of the speed that tell of over `oldest` s ago are
    missing.

    The board takes off what its timer's steps and the slots' errors do to the mean of 1/period, and reads 0 before the
    bridge is on.
    """
    told = duty_to_voltage(run.recording, "duty", "V", rig.supply, 2**rig.bits - 1, rig.bits, rig.efficiency)
    told = period_to_speed(
        told, "Tp", "w", rig.pulses, ratio=rig.ratio, slot_error=rig.slot_error, tick=rig.tick, counts="N", lag="age"
    )
    kept = np.where(told["age"] <= oldest, told["w"], np.nan)
    kept[0] = 0.0
    dropped = (
        f"{int(np.sum(np.isnan(kept)))} readings older than {oldest:g} s, from where the motor reverses, are not sent."
    )
    signals = {"V": told.signals["V"], "w": Signal(kept, "rad/s"), "i": told.signals["i"]}
    return Recording(told.t, signals, run.recording.name, (*told.log, dropped))


# -- by name --------------------------------------------------------------------------------------


def _numbers() -> tuple[Number, ...]:
    own = [Number(n, UNITS[n], TRUTH[n], MOTOR[n], open=n != "Tf") for n in ("Rm", "Lm", "Kb")]
    own.append(Number("Kt", UNITS["Kt"], None, "torque constant; Kb unless given, as it must be in SI units"))
    own += [Number(n, UNITS[n], TRUTH[n], MOTOR[n], open=n == "Jm") for n in ("Jm", "Cm", "Tf")]
    return (
        *own,
        Number("current_noise", "A", 0.02, "rms noise of the current", "noise", open=False),
        Number("current_step", "A", 0.01, "step of the current's reading", "noise", open=False),
        Number("slot_error", "1", 0.01, "rms error of a slot's place, of its width", "noise", open=False, most=0.2),
        Number("tick", "s", 1e-6, "step of the timer", "noise", open=False),
        Number("wander", "V", 0.002, "rms by which the bridge's voltage wanders within a second", "noise", open=False),
        Number(
            "pulses",
            "counts",
            2000,
            "edges of the encoder for a turn",
            "noise",
            least=4,
            open=False,
            most=1e6,
            whole=True,
        ),
        Number("supply", "V", 12.0, "supply of the bridge", "setting"),
        Number("efficiency", "1", 0.98, "share of the supply that the bridge passes on", "setting", most=1.0),
        Number("bits", "1", 8, "bits of the duty", "setting", least=1, open=False, most=24, whole=True),
    )


def _record(asked: Asked) -> RigRecord:
    n = {"Kt": asked.numbers["Kb"], **asked.numbers}
    asked = asked._replace(numbers=n)
    period, duration = asked.period or PERIOD, asked.duration or DURATION
    rig = replace(
        board_rig({name: n[name] for name in UNITS}), supply=n["supply"], efficiency=n["efficiency"],
        bits=int(n["bits"]),
        pulses=int(n["pulses"]), slot_error=n["slot_error"], tick=n["tick"], current_noise=n["current_noise"],
        current_step=n["current_step"], wander=n["wander"], period=period, duration=duration,
        substeps=max(10, round(period / STEPS_OF)),
    )  # fmt: skip
    most = rig.efficiency * rig.supply
    if asked.controller is not None:
        drive, driven = _looped(rig, asked, asked.controller, duration, period)
    elif asked.excitation is None:
        drive, driven = board_excitation(11.0 / 11.76 * most, duration, period), _DRIVEN.format(11.0 / 11.76 * most)
    else:
        drive, driven = driven_by(asked.excitation, "V", "V", duration, period)
    run = rig.record(asked.seed, drive, name="dc_motor")
    seen = sent(run, rig)
    if asked.controller is not None:
        seen = Recording(seen.t, {**seen.signals, "w_set": drive.signals["w_set"]}, seen.name, (*seen.log, driven))
    if "i" in asked.without:
        seen = Recording(seen.t, {k: s for k, s in seen.signals.items() if k != "i"}, seen.name, seen.log)
    determined = {k: {"value": float(v), "unit": u} for k, v, u in zip(LAW, speed_law(n), LAW_UNITS, strict=True)}
    if "i" not in asked.without:
        determined = {name: {"value": n[name], "unit": UNITS[name]} for name in UNITS}
    truth = truth_of(RIG, asked, {"encoder_phase_slots": run.truth["encoder_phase_slots"]}, determined, driven)
    tied = n["Kt"] == n["Kb"]
    write = (
        (lambda f, s: _speed_study(f, s, n)) if "i" in asked.without else (lambda f, s: _current_study(f, s, n, tied))
    )
    return RigRecord(seen, run.exact, truth, write)


def _looped(rig: DcMotorRig, asked: Asked, tuned: Tuned, duration: float, period: float) -> tuple[Recording, str]:
    """The voltage V of the loop with its set points w_set (rad/s), and a sentence about it."""
    given = asked.excitation
    if given is None:
        levels = (
            units.convert(v, tuned.output_unit or "rad/s", "rad/s")
            for v in (tuned.set_point - tuned.step, tuned.set_point)
        )
        given = ",".join(f"{v!r}" for v in levels)
    wanted, told = driven_by(given, "w", "rad/s", duration, period)
    t = np.arange(round((wanted.t[-1] - wanted.t[0]) / period) + 1) * period
    speeds = wanted["w"][np.searchsorted(wanted.t - wanted.t[0], t + 5e-10, side="right") - 1]
    own = units.convert(speeds, "rad/s", tuned.output_unit or "rad/s")
    volts = driven_by_controller(rig, asked.seed, tuned.law, tuned.given, own, (tuned.output_unit, tuned.input_unit))
    law = f"{tuned.told}, a sample every {period:g} s"
    drive = Recording(volts.t, {**volts.signals, "w_set": Signal(speeds, "rad/s")}, "loop")
    return drive, f"In a loop with the {tuned.form} of {tuned.name} ({law}); set points: {told}"


_DRIVEN = (
    "Sines of both signs beyond 1 V and a square wave of 0.2 Hz, "
    "blocks of 30 s, up to {:.4g} V; 0 V at the first sample."
)


def _current_study(file: str, name: str, n: Mapping[str, float], tied: bool) -> str:
    told = "Constants of a DC motor from voltage, speed and current." + (
        " Kt = Kb, which holds in SI units." if tied else ""
    )
    free = tuple(p for p in UNITS if not (tied and p == "Kt"))
    return (
        f"{head(name, told)}\n[recording.motor]\nfile = {dumps(file, ensure_ascii=False)}\n\n"
        f'[model]\nkind = "dc_motor"\noptions = {{ tied = {str(tied).lower()}, current_output = true }}\n\n'
        f"{parameters_of(free, n)}\n[simulation]\nsubsteps = 4\n\n[search]\nseed = 1\n"
    )


def _speed_study(file: str, name: str, n: Mapping[str, float]) -> str:
    told = (
        "A DC motor from voltage and speed. Without the current "
        "only these combinations of its constants are determined:\n"
        + "\n".join(f"  {law} = {label}" for law, label in zip(LAW, LABELS, strict=True))
        + "\nWith the current as well (a record with the column i) each constant is."
    )
    boxes = ((0.002, 20.0), (1e-4, 10.0), (1e-6, 1.0))
    own: list[Any] = [box(low, high, v) for (low, high), v in zip(boxes, speed_law(n), strict=False)]
    limit = 0.5 * n["supply"]
    rows = [parameter(p, b, u, s) for p, b, u, s in zip(LAW, own, LAW_UNITS, SENTENCES, strict=False)]
    rows.append(parameter("f", [-limit, limit], "V", SENTENCES[3], log=False))
    return (
        f"{head(name, told)}\n[recording.motor]\nfile = {dumps(file, ensure_ascii=False)}\n\n"
        f'[model]\nequations = """\n{EQUATIONS}\n"""\ninputs = {{ V = "V" }}\n'
        'states = { w = { unit = "rad/s", initial = 0 }, a = { unit = "rad/s^2", initial = 0 } }\noutputs = { w = '
        '"rad/s" }\n'
        f'constants = {{ edge = "{EDGE}" }}\n\n'
        + "\n".join(rows)
        + "\n[simulation]\nsubsteps = 4\n\n[search]\nseed = 1\n"
    )


RIG = OfferedRig(
    "dc_motor",
    "A DC motor behind an H-bridge; a board sends voltage, speed of an encoder and, unless left out, current.",
    _numbers(),
    _record,
    duration=DURATION,
    period=PERIOD,
    excitation="a voltage that is held from the start (6V), several one after another (3V,-3V,6V), or a CSV file with "
    "a signal V",
    optional=("i",),
    loop="reads the speed of the encoder and gives the voltage of the bridge",
)
