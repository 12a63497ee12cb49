"""The motor of a mobile robot by name: raw duty, pulse periods and RMS current at 5 kHz, as a microcontroller logs
them."""

from collections.abc import Mapping
from json import dumps

from plantfit.models.library.speed_law import speed_law
from plantfit.rig.dc_motor import ROBOT_MOTOR, DcMotorRig
from plantfit.rig.offered.contract import Asked, Number, OfferedRig, RigRecord, truth_of
from plantfit.rig.offered.driven import driven_by
from plantfit.rig.offered.motor_studies import MOTOR, UNITS, head, parameters_of

NAMES = ("Rm", "Lm", "Kb", "Jm", "Cm")


def _numbers() -> tuple[Number, ...]:
    said = MOTOR | {"Kb": "back-EMF constant, and torque constant"}
    return (
        *(Number(n, UNITS[n], ROBOT_MOTOR[n], said[n]) for n in NAMES),
        Number("current_noise", "A", 2e-3, "rms noise of the current", "noise", open=False),
        Number("current_step", "A", 1e-3, "step of the current's reading", "noise", open=False),
        Number("slot_error", "1", 0.02, "rms error of a slot's place, of its width", "noise", open=False, most=0.2),
        Number("tick", "s", 1e-6, "step of the timer", "noise", open=False),
        Number("pulses", "counts", 500, "slots of the encoder", "noise", least=4, open=False, most=1e6, whole=True),
        Number("ratio", "1", 43 / 9, "turns of the motor for one of the encoder", "setting"),
        Number("supply", "V", 12.0, "supply of the bridge", "setting"),
        Number("efficiency", "1", 0.98, "share of the supply that the bridge passes on", "setting", most=1.0),
        Number("bits", "1", 8, "bits of the duty", "setting", least=1, open=False, most=24, whole=True),
    )


def _record(asked: Asked) -> RigRecord:
    n = asked.numbers
    constants = {name: n[name] for name in NAMES} | {"Kt": n["Kb"], "Tf": 0.0}
    period, duration = asked.period or RIG.period, asked.duration or RIG.duration
    rig = DcMotorRig(
        constants, supply=n["supply"], efficiency=n["efficiency"], bits=int(n["bits"]), pulses=int(n["pulses"]),
        ratio=n["ratio"],
        slot_error=n["slot_error"], tick=n["tick"], current_noise=n["current_noise"], current_step=n["current_step"],
        period=period,
        window=period, substeps=max(10, round(period / 2e-5)), duration=duration,
    )  # fmt: skip
    drive, driven = driven_by(asked.excitation or "3V", "V", "V", duration, period)
    run = rig.record(asked.seed, drive, name="robot_motor")
    determined = {name: {"value": n[name], "unit": UNITS[name]} for name in NAMES}
    for name, value in zip(("c0", "c1", "c2"), speed_law(constants), strict=False):
        determined[name] = {
            "value": float(value),
            "unit": {"c0": "V*s/rad", "c1": "V*s^2/rad", "c2": "V*s^3/rad"}[name],
        }
    truth = truth_of(RIG, asked, {"encoder_phase_slots": run.truth["encoder_phase_slots"]}, determined, driven)
    return RigRecord(run.recording, run.exact, truth, lambda file, name: _study(file, name, n, rig))


_STUDY = """\

[recording.step]
file = {file}
skip = {skip!r}   # s until the first full pulse periods
shared_errors = {{ w = "w_slot" }}   # a slot that is too wide is so in every turn
clean = [
    {{ step = "duty_to_voltage", signal = "duty", name = "V", supply = {supply!r}, full_scale = {full}, efficiency = {efficiency!r} }},
    {{ step = "period_to_speed", signal = "Tp", name = "w", pulses = {pulses}, ratio = {ratio!r}, slot_error = {slot!r}, \
counts = "N", lag = "w_lag", slot = "w_slot" }},
    # both sensors look back: the period over its pulse, the RMS over its window
    {{ step = "backdate", signal = ["w", "w_slot"], by = "w_lag", hold = ["V"] }},
    {{ step = "backdate", signal = "I", by = {half!r}, hold = ["V"] }},
]

[model]
equations = \"\"\"
i' = (V - Rm*i - Kb*w)/Lm
w' = (Kb*i - Cm*w)/Jm
I = i
\"\"\"
inputs = {{ V = "V" }}
states = {{ i = {{ unit = "A", initial = 0 }}, w = {{ unit = "rad/s", initial = 0 }} }}
outputs = {{ w = "rad/s", I = "A" }}

{parameters}
[search]
seed = 1
"""  # noqa: E501


def _study(file: str, name: str, n: Mapping[str, float], rig: DcMotorRig) -> str:
    told = (
        "Motor of a mobile robot from rest: current (RMS, so without its sign) and the period of the encoder's pulses."
    )
    return head(name, told) + _STUDY.format(
        file=dumps(file, ensure_ascii=False), skip=0.003, supply=rig.supply, full=2**rig.bits - 1,
        efficiency=rig.efficiency,
        pulses=rig.pulses, ratio=float(rig.ratio), slot=rig.slot_error, half=0.5 * rig.window,
        parameters=parameters_of(NAMES, n),
    )  # fmt: skip


RIG = OfferedRig(
    "robot_motor",
    "The motor of a mobile robot from rest: duty, pulses and their periods, RMS current, as raw readings at 5 kHz.",
    _numbers(),
    _record,
    duration=0.4,
    period=2e-4,
    excitation="a voltage that is held from the start (3V), several one after another (3V,6V), or a CSV file with a "
    "signal V",
)
