"""A robot on two driven wheels by name: counts of both encoders and a camera's positions along a path."""

import math
from collections.abc import Mapping
from json import dumps

from plantfit import units
from plantfit.errors import SimulationError, UnitError
from plantfit.recording.record import Recording
from plantfit.rig.dc_motor import ROBOT_MOTOR
from plantfit.rig.offered.contract import Asked, Number, OfferedRig, RigRecord, truth_of
from plantfit.rig.offered.motor_studies import MOTOR, UNITS, head, parameter
from plantfit.rig.robot_drive import REST, RobotDriveRig, Segment

NAMES = ("Rm", "Lm", "Kb", "Jm", "Cm")
WHEELS = {
    "radius_left": "radius of the left wheel",
    "radius_right": "radius of the right wheel",
    "track": "distance between the wheels",
}
PATH = "1m, 0.5m/360deg, 1m, 0.5m/-360deg"


def _numbers() -> tuple[Number, ...]:
    said = MOTOR | {"Kb": "back-EMF constant, and torque constant", "Jm": "inertia of a rotor"}
    return (
        Number("radius_left", "m", 0.032, WHEELS["radius_left"], most=10.0),
        Number("radius_right", "m", 0.032, WHEELS["radius_right"], most=10.0),
        Number("track", "m", 0.14, WHEELS["track"], most=100.0),
        Number("mass", "kg", 1.0, "mass of the robot, half of it on each motor", open=False),
        *(Number(n, UNITS[n], ROBOT_MOTOR[n], said[n] + " (both motors)") for n in NAMES),
        Number("camera_noise", "m", 2e-3, "rms noise of the camera's x and y", "noise", open=False),
        Number("slot_error", "1", 0.02, "rms error of a slot's place, of its width", "noise", open=False, most=0.2),
        Number("pulses", "counts", 500, "slots of each encoder", "noise", least=4, open=False, most=1e6, whole=True),
        Number("speed", "m/s", 1.0, "speed of the robot's middle", "setting", most=1e3),
        Number("acceleration", "m/s^2", 2.0, "how it starts and stops", "setting", most=1e4),
        Number("ratio", "1", 43 / 9, "turns of the motor for one of the encoder", "setting"),
        Number("gear", "1", 1.0, "turns of the wheel for one of the encoder", "setting"),
        Number("supply", "V", 12.0, "supply of the bridges", "setting"),
        Number("efficiency", "1", 0.98, "share of the supply that the bridges pass on", "setting", most=1.0),
        Number("bits", "1", 8, "bits of the duty", "setting", least=1, open=False, most=24, whole=True),
    )


def _record(asked: Asked) -> RigRecord:
    n = asked.numbers
    motor = {name: n[name] for name in NAMES} | {"Kt": n["Kb"], "Tf": 0.0}
    rig = RobotDriveRig(
        motor, (n["radius_left"], n["radius_right"]), n["track"], n["mass"], n["ratio"], n["gear"], n["supply"],
        n["efficiency"],
        int(n["bits"]), int(n["pulses"]), n["slot_error"], n["camera_noise"], n["speed"], n["acceleration"],
        asked.period or RIG.period,
    )  # fmt: skip
    path = segments(asked.excitation or PATH)
    run = rig.record(asked.seed, path, asked.duration, name="robot_drive")
    determined = {name: {"value": n[name], "unit": "m"} for name in WHEELS}
    drawn = {"encoder_phases_slots": run.truth["encoder_phases_slots"], "gains_Kp_Ki_Kd": run.truth["gains"]}
    spent = asked._replace(duration=float(run.recording.t[-1]))
    said = asked.excitation if isinstance(asked.excitation, str) else PATH
    truth = truth_of(RIG, spent, drawn, determined, f"The path {said}, from rest at the origin along x.")
    return RigRecord(run.recording, run.exact, truth, lambda file, name: _study(file, name, n))


def segments(path: str | Recording) -> list[Segment]:
    """The parts of a path as text: "1m" straight on, "0.5m/90deg" an arc of that radius to the left, a negative angle
    to the right.

    Raises SimulationError for other text, UnitError for a unit of another kind.
    """
    if not isinstance(path, str):
        raise SimulationError(f"The robot's path is text; write it as {PATH!r}.")
    found = []
    for part in path.split(","):
        length, bent, angle = part.strip().partition("/")
        reach = _in(length, "m", path)
        if not bent:
            found.append(Segment(reach))
            continue
        turn = _in(angle, "rad", path)
        if not (reach > 0 and turn != 0):
            raise SimulationError(
                f"The path {path!r} has the arc {part.strip()!r}; give a radius above 0 and an angle, as in 0.5m/90deg."
            )
        found.append(Segment(reach * abs(turn), math.copysign(1 / reach, turn)))
    return found


def _in(text: str, unit: str, path: str) -> float:
    try:
        value, own = units.quantity(text.strip())
    except UnitError:
        raise SimulationError(
            f"The path {path!r} cannot be read at {text.strip()!r}; write "
            "straights as 1m and arcs as 0.5m/90deg, with commas between."
        ) from None
    if own and not units.compatible(own, unit):
        raise UnitError(
            f"The path {path!r}: {text.strip()!r} is no {'length' if unit == 'm' else 'angle'}; give it in {unit}."
        )
    return float(units.convert(value, own, unit)) if own else value


_STUDY = """\

[recording.drive]
file = {file}
clean = [
    {{ step = "counts_to_angle", signal = "N_left", name = "turned_left", counts = {pulses}, ratio = {gear!r} }},
    {{ step = "counts_to_angle", signal = "N_right", name = "turned_right", counts = {pulses}, ratio = {gear!r} }},
    {{ step = "differentiate", signal = "turned_left", name = "w_left", method = "forward" }},
    {{ step = "differentiate", signal = "turned_right", name = "w_right", method = "forward" }},
]

[model]
equations = \"\"\"
x' = 0.5*(radius_left*w_left + radius_right*w_right)*cos(heading)
y' = 0.5*(radius_left*w_left + radius_right*w_right)*sin(heading)
heading' = (radius_right*w_right - radius_left*w_left)/track
x_camera = x
y_camera = y
\"\"\"
inputs = {{ w_left = "rad/s", w_right = "rad/s" }}
# the counts begin with a part of a slot, which shows as a pose at the start
states = {{ x = {{ unit = "m", initial = "x0" }}, y = {{ unit = "m", initial = "y0" }}, \
heading = {{ unit = "rad", initial = "heading0" }} }}
outputs = {{ x_camera = "m", y_camera = "m" }}

{parameters}
[simulation]
stepper = "rk4"   # nothing is stiff here, and 0.03 mm of the default's error would be 0.8 standard errors of a radius

[search]
seed = 1
"""


def _study(file: str, name: str, n: Mapping[str, float]) -> str:
    told = "Wheels and track of a robot from the counts of its wheels and a camera's positions."
    # as a ruler tells them: over decades of radii the counts of a wheel fit circles of other numbers of turns
    tables = [
        parameter(w, [float(f"{0.5 * n[w]:.1g}"), float(f"{3 * n[w]:.1g}")], "m", said) for w, said in WHEELS.items()
    ]
    tables += [parameter(f"{a}0", [-0.1, 0.1], "m", f"{a} at the start", log=False) for a in "xy"]
    tables.append(parameter("heading0", [-0.3, 0.3], "rad", "heading at the start", log=False))
    return head(name, told) + _STUDY.format(
        file=dumps(file, ensure_ascii=False), pulses=int(n["pulses"]), gear=float(n["gear"]),
        parameters="\n".join(tables),
    )  # fmt: skip


RIG = OfferedRig(
    "robot_drive",
    "A robot on two driven wheels along a path: duty and counts of both encoders, and a camera's x and y.",
    _numbers(),
    _record,
    duration=2 + 2 * math.pi + 0.5 + REST,
    period=0.01,
    excitation=f"a path: straights such as 1m and arcs such as 0.5m/90deg (left) or 0.5m/-90deg (right) with commas "
    f"between ({PATH})",
)
