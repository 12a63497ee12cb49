"""Pendubot and double pendulum: two links in a plane, as a simulation model and as a regression of torque."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.library.double_pendulum import accelerations, torque_columns
from plantfit.models.library.pendubot_terms import Angles, Arm, Parameters, check_choice
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared, Model, Named
from plantfit.models.parts.joint_friction import JointFriction, Sign
from plantfit.models.remade import remade

# isort: split
import jax.numpy as jnp

Drive = Literal["torque", "voltage"]
Initial = Literal["rest", "free"]

_SOURCE = (
    "Fantoni, Lozano, Non-linear Control for Underactuated Mechanical Systems, 2002, "
    "chapter 5; bounds of Sanin-Villa et al., A Comparative Analysis of Metaheuristic "
    "Algorithms for Enhanced Parameter Estimation on Inverted Pendulum System Dynamics, 2024"
)
_MOTOR = (
    Declared("kt", "N*m/A", (1e-3, 1.0), value=0.0724, sentence="torque constant"),
    Declared("ke", "V*s/rad", (1e-3, 1.0), value=0.0724, sentence="back-EMF constant"),
    Declared("Ra", "ohm", (0.1, 100.0), value=2.983, sentence="winding resistance"),
)


def motor_torque(V: Any, omega: Any, kt: Any = 0.0724, ke: Any = 0.0724, Ra: Any = 2.983) -> Any:
    """Torque (N m) of a DC motor without inductance: kt/Ra V - kt ke/Ra omega (Sanin-Villa et al. 2024, with its
    labels put right)."""
    return kt / Ra * V - kt * ke / Ra * omega


@remade
def pendubot(
    parameters: Parameters = "physical",
    angles: Angles = "horizontal",
    drive: Drive = "torque",
    joints: Sequence[int] = (1,),
    friction: str | Sequence[str] = (),
    gear_ratio: float | None = None,
    motors: Sequence[int] | None = None,
    initial: Initial = "rest",
    velocity_output: bool = False,
    sign: Sign = "tanh",
    sign_width: float = 0.01,
    stribeck_velocity: float = 0.1,
    presliding_distance: float = 0.001,
    l1: float = 0.15,
    g: float = 9.81,
) -> Model:
    """Two links in a plane, driven at `joints`; (1,) is the pendubot, (1, 2) a double pendulum with two motors.

        M q'' + C q' + G + friction = [tau1, tau2],    q = [theta1, theta2],    q' = [omega1, omega2]
        M = [[b1 + b2 + 2 b3 cos(theta2), b2 + b3 cos(theta2)], [b2 + b3 cos(theta2), b2]]
        C = [[-b3 omega2 sin(theta2), -b3 (omega1 + omega2) sin(theta2)], [b3 omega1 sin(theta2), 0]]
        G = [b4 g cos(theta1) + b5 g cos(theta1 + theta2), b5 g cos(theta1 + theta2)]
        b1 = m1 lc1^2 + m2 l1^2 + I1,  b2 = m2 lc2^2 + I2,  b3 = l1 b5,  b4 = m1 lc1 + m2 l1,  b5 = m2 lc2

    As a state space: theta' = omega, omega' = M^-1 ([tau1, tau2] - C omega - G - friction); tau2 = 0 of the pendubot.

    States and outputs theta1, theta2 (rad), states omega1, omega2 (rad/s), outputs too with `velocity_output`. Inputs
    tau1, tau2 (N m), or with `drive` "voltage" V of a motor at joint 1 (V): tau1 = gr (kt/Ra V - kt ke/Ra gr omega1).
    theta2 is relative to link 1; theta1 is counter-clockwise from the horizontal, or with `angles` "hanging" from
    straight down.

    `parameters` "physical": m1, m2 (kg), lc1, lc2 (m), I1, I2 (kg m^2, about the centres of mass); "base": b1, b2 (kg
    m^2), b4, b5 (kg m), all that the motion depends on. `friction` names parts of `joint_friction`: viscous, coulomb,
    stribeck, load (of the applied torque), offset, for both joints. `gear_ratio` adds rotors of inertia Ir before the
    gears of `motors` (by default `joints`). Starts at the first measured angles; at rest, or with `initial` "free" at
    rates omega1_0, omega2_0 (velocities that are outputs start where measured); with `sign` "presliding" so do states
    slide1, slide2, which otherwise start at 0. l1 (m) is the length of link 1.

    Source: Fantoni, Lozano, Non-linear Control for Underactuated Mechanical Systems (2002), chapter 5.
    """
    driven = _joints("joints", joints)
    check_choice("drive", drive, Drive)
    check_choice("initial", initial, Initial)
    if drive == "voltage" and driven != (1,):
        raise ModelError(
            f"Pendubot: drive 'voltage' with joints {driven}; a motor "
            "by voltage drives joint 1 alone, so give joints = (1,)."
        )
    rub = {
        j: JointFriction(_parts(friction, load=j in driven), sign_width, stribeck_velocity, sign, presliding_distance)
        for j in (1, 2)
    }
    arm = Arm(parameters, angles, rub, gear_ratio, driven if motors is None else _joints("motors", motors), l1, g)
    gear = gear_ratio or 1.0
    sliding = [j for j in (1, 2) if rub[j].has_state]

    def derivative(x: Named, u: Named, p: Named) -> Named:
        if drive == "voltage":
            taus = {1: gear * motor_torque(u["V"], gear * x["omega1"], p["kt"], p["ke"], p["Ra"])}
        else:
            taus = {j: u[f"tau{j}"] for j in driven}
        alpha1, alpha2 = accelerations(arm.terms(x, taus), arm.base(p), taus.get(1, 0.0), taus.get(2, 0.0))
        slides = {f"slide{j}": rub[j].sliding_rate(x[f"omega{j}"], x[f"slide{j}"]) for j in sliding}
        return {"theta1": x["omega1"], "theta2": x["omega2"], "omega1": alpha1, "omega2": alpha2, **slides}

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        still = jnp.zeros_like(jnp.asarray(y0["theta1"], dtype=float))
        slides = {f"slide{j}": y0.get(f"slide{j}", still) for j in sliding}
        if velocity_output:
            rates = {n: y0[n] for n in ("omega1", "omega2")}
        else:
            rates = {n: p[f"{n}_0"] if initial == "free" else still for n in ("omega1", "omega2")}
        return {"theta1": y0["theta1"], "theta2": y0["theta2"], **rates, **slides}

    angle, rate = {"theta1": "rad", "theta2": "rad"}, {"omega1": "rad/s", "omega2": "rad/s"}
    outputs = {**angle, **rate, **{f"slide{j}": "" for j in sliding}} if velocity_output else angle
    starts = [Declared(f"{n}_0", "rad/s", (-10.0, 10.0), sentence=f"{n} at the first sample") for n in rate]
    return Model(
        name="pendubot",
        states={**angle, **rate, **{f"slide{j}": "" for j in sliding}},
        inputs={"V": "V"} if drive == "voltage" else {f"tau{j}": "N*m" for j in driven},
        outputs=outputs,
        parameters=(
            *arm.declared,
            *(_MOTOR if drive == "voltage" else ()),
            *(starts if initial == "free" and not velocity_output else ()),
        ),
        output=lambda x, u, p: {n: x[n] for n in outputs},
        derivative=derivative,
        initial_state=initial_state,
        sentence="Two links in a plane, driven at the first joint or at both.",
        source=_SOURCE,
    )


@remade
def pendubot_regression(
    parameters: Parameters = "physical",
    angles: Angles = "horizontal",
    joints: Sequence[int] = (1,),
    friction: str | Sequence[str] = (),
    gear_ratio: float | None = None,
    motors: Sequence[int] | None = None,
    sign: Sign = "tanh",
    sign_width: float = 0.01,
    stribeck_velocity: float = 0.1,
    l1: float = 0.15,
    g: float = 9.81,
) -> LinearModel:
    """Torque of `joints` of a pendubot from its motion: the inverse of `pendubot`, from the same terms; options as
    there.

        tau1 = b1 alpha1 + b2 (alpha1 + alpha2) + b4 g cos(theta1) + b5 g cos(theta1 + theta2)
             + b5 l1 (cos(theta2) (2 alpha1 + alpha2) - sin(theta2) omega2 (2 omega1 + omega2)) + friction
        tau2 = b2 (alpha1 + alpha2) + b5 g cos(theta1 + theta2)
             + b5 l1 (cos(theta2) alpha1 + sin(theta2) omega1^2) + friction
        b1 = m1 lc1^2 + m2 l1^2 + I1,  b2 = m2 lc2^2 + I2,  b4 = m1 lc1 + m2 l1,  b5 = m2 lc2

    Signals theta1, theta2 (rad), omega1, omega2 (rad/s), alpha1, alpha2 (rad/s^2); targets tau1, tau2 (N m). tau1 alone
    does not show the friction of joint 2.

    Where rates and accelerations are derivatives of measured angles, their errors stand in the columns and least
    squares is off, by 10 % of b1 and all of b5 on the virtual rig: fit it by instrumental variables, in a study file by
    the table [regression].

    The friction part "load" reads the signals load1, load2 (N m), a first estimate of the
    torque through each joint; not the target itself, whose noise would bias the coefficient. `sign` "presliding" reads
    slide1, slide2, which `recording.presliding` makes from the angles, over its own distance.
    """
    scored = _joints("joints", joints)
    rub = {j: JointFriction(_parts(friction), sign_width, stribeck_velocity, sign) for j in scored}
    arm = Arm(parameters, angles, rub, gear_ratio, scored if motors is None else _joints("motors", motors), l1, g)
    loads = {j: f"load{j}" for j in scored if "load" in rub[j].parts}

    def regressor(signals: Mapping[str, Any]) -> dict[str, np.ndarray]:
        s = {n: np.asarray(v, dtype=float) for n, v in signals.items()}
        columns = torque_columns(arm.terms(s, {j: s[n] for j, n in loads.items()}), s["alpha1"], s["alpha2"])
        size = np.shape(s["theta1"])
        return {f"tau{j}": np.stack([np.broadcast_to(c, size) for c in columns[j - 1]], axis=-1) for j in scored}

    motion = {
        f"{n}{j}": unit for n, unit in (("theta", "rad"), ("omega", "rad/s"), ("alpha", "rad/s^2")) for j in (1, 2)
    }
    return LinearModel(
        name="pendubot_regression",
        outputs={f"tau{j}": "N*m" for j in scored},
        parameters=arm.declared,
        regressor=regressor,
        signals=motion | {n: "N*m" for n in loads.values()} | {f"slide{j}": "" for j, r in rub.items() if r.has_state},
        coefficients=arm.coefficients,
        base=arm.base,
        sentence="Torque of a pendubot's joints from their motion, linear in base parameters and friction.",
        source=_SOURCE,
    )


def _joints(option: str, given: Sequence[int]) -> tuple[int, ...]:
    joints = tuple(given)
    if joints not in ((1,), (2,), (1, 2)):
        raise ModelError(f"Pendubot: {option} = {given!r}; give (1,), (2,) or (1, 2).")
    return joints


def _parts(friction: str | Sequence[str], load: bool = True) -> tuple[str, ...]:
    """Parts of friction; none that depends on a load where there is no load."""
    parts = (friction,) if isinstance(friction, str) else tuple(friction)
    return tuple(p for p in parts if load or p != "load")
