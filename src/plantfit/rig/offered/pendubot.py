"""The pendubot by name: links, motor and friction of the user's own, and a study by instrumental variables."""

from collections.abc import Mapping
from json import dumps
from typing import Any

from plantfit.errors import SimulationError
from plantfit.models.library.pendubot_terms import BASE_UNITS
from plantfit.rig.offered.contract import Asked, Number, OfferedRig, RigRecord, truth_of
from plantfit.rig.pendubot import MEASURED, MOTOR, PendubotRig

_LINKS = {
    "m1": ("kg", "mass of link 1"), "m2": ("kg", "mass of link 2"),
    "lc1": ("m", "joint 1 to the centre of mass of link 1"), "lc2": ("m", "joint 2 to the centre of mass of link 2"),
    "I1": ("kg*m^2", "inertia of link 1 about its centre of mass"),
    "I2": ("kg*m^2", "inertia of link 2 about its centre of mass"),
}  # fmt: skip
_MOTOR = {
    "kt": ("N*m/A", "torque constant"),
    "ke": ("V*s/rad", "back-EMF constant"),
    "Ra": ("ohm", "winding resistance"),
}
_FRICTION = {"viscous": ("Fv", "N*m*s/rad", "viscous friction"), "coulomb": ("Fc", "N*m", "Coulomb friction")}


def _numbers() -> tuple[Number, ...]:
    links = [Number(n, unit, MEASURED[n], said) for n, (unit, said) in _LINKS.items()]
    motor = [Number(n, unit, MOTOR[n], said) for n, (unit, said) in _MOTOR.items()]
    rub = [
        Number(f"{short}{joint}", unit, 0.0, f"{said} of joint {joint}", open=False)
        for short, unit, said in _FRICTION.values()
        for joint in (1, 2)
    ]
    return (
        *links,
        Number("l1", "m", 0.15, "length of link 1"),
        Number("g", "m/s^2", 9.81, "gravity"),
        *motor,
        *rub,
        Number(
            "counts",
            "counts",
            10_000,
            "steps of an encoder for a turn",
            "noise",
            least=100,
            open=False,
            most=1e8,
            whole=True,
        ),
        Number("voltage_noise", "V", 5e-3, "rms noise of the recorded voltage", "noise", open=False),
        Number("limit", "V", 24.0, "largest voltage of the amplifier", "setting"),
        Number("offset1", "rad", 0.0, "start of theta1 off the upright", "setting", least=-1.0, open=False, most=1.0),
        Number("offset2", "rad", 0.0, "start of theta2 off the upright", "setting", least=-1.0, open=False, most=1.0),
    )


def _record(asked: Asked) -> RigRecord:
    n = asked.numbers
    parts = tuple(part for part, (short, *_) in _FRICTION.items() if n[f"{short}1"] > 0 or n[f"{short}2"] > 0)
    rubbing = [f"{_FRICTION[part][0]}{joint}" for part in parts for joint in (1, 2)]
    rig = PendubotRig(
        {name: n[name] for name in (*_LINKS, *_MOTOR, *rubbing)},
        friction=parts,
        duration=asked.duration or RIG.duration,
        period=asked.period or RIG.period,
        counts=int(n["counts"]),
        voltage_noise=n["voltage_noise"],
        limit=n["limit"],
        l1=n["l1"],
        g=n["g"],
    )
    try:
        run = rig.record(asked.seed, (n["offset1"], n["offset2"]))
    except SimulationError as error:
        if "fell at" not in str(error):
            raise
        fell = str(error).split(" with the start")[0]
        raise SimulationError(
            f"{fell}: {n['limit']:g} V and this motor do not hold these links upright over the motion; "
            "give shorter or lighter links, a stronger motor, a larger limit, or a smaller offset."
        ) from None
    determined: dict[str, Any] = {name: {"value": value, "unit": BASE_UNITS[name]} for name, value in rig.base.items()}
    determined |= {
        name: {"value": n[name], "unit": next(d.unit for d in RIG.numbers if d.name == name)} for name in rubbing
    }
    drawn = {"encoder_phase_counts": run.truth["encoder_phase_counts"]}
    truth = truth_of(RIG, asked, drawn, determined, _MOTION)
    return RigRecord(run.recording, run.exact, truth, lambda file, name: _study(file, name, n, parts, rig.period))


_MOTION = (
    "An LQG about a reference moves theta1 from the upright to 2 pi/3, pi/3 and back, at 4.5, 9.5 and 17.5 s, with "
    "link 2 upright; "
    "theta1_ref and theta2_ref are that reference."
)
_STUDY = """\
# Torque of a pendubot from its motion, by instrumental variables. Run it with:  plantfit run {name}.toml
# Rates and accelerations are derivatives of encoder readings: their errors stand in the columns, and plain least
# squares is drawn away from the truth. Instruments made of the reference motion do not share these
# errors (docs/regression.md).
name = {quoted}

[recording.run]
file = {file}

[model]
kind = "pendubot_regression"
options = {{ parameters = "base", joints = [1, 2], l1 = {l1!r}, g = {g!r}{friction} }}

[regression]
method = "instrumental variables"
reference = {{ theta1 = "theta1_ref", theta2 = "theta2_ref" }}
derivatives = {{ theta1 = ["omega1", "alpha1"], theta2 = ["omega2", "alpha2"] }}
held = ["V"]          # one voltage for each sample time
smoothing = {smoothing!r}      # Hz, before differentiation
band = {band!r}            # Hz, of columns and torques alike

[regression.targets]  # the motor's torque from its voltage; joint 2 has no motor
tau1 = "kt/Ra*V - kt*ke/Ra*omega1"
tau2 = "0"

[regression.constants]  # of the motor, from its data sheet
kt = "{kt!r} N*m/A"
ke = "{ke!r} V*s/rad"
Ra = "{Ra!r} ohm"
"""


def _study(file: str, name: str, n: Mapping[str, float], parts: tuple[str, ...], period: float) -> str:
    friction = f", friction = {dumps(list(parts))}" if parts else ""
    return _STUDY.format(
        name=name, quoted=dumps(name, ensure_ascii=False), file=dumps(file, ensure_ascii=False), l1=n["l1"], g=n["g"],
        friction=friction,
        smoothing=min(20.0, 0.2 / period), band=min(5.0, 0.1 / period), kt=n["kt"], ke=n["ke"], Ra=n["Ra"],
    )  # fmt: skip


RIG = OfferedRig(
    "pendubot",
    "Two links that an LQG moves from pose to pose with link 2 "
    "upright; encoders of both joints and the motor's voltage.",
    _numbers(),
    _record,
    duration=25.0,
    period=1e-3,
)
