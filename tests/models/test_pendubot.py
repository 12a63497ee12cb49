"""The pendubot in both directions: against Lagrange's equations by autodiff, energy, published forms, and each
other."""

import numpy as np
import pytest
from model_calls import derivative, initial_state
from scipy.integrate import solve_ivp

import plantfit.recording as rec
from plantfit.errors import ModelError
from plantfit.models.library.double_pendulum import Motion, energies
from plantfit.models.library.pendubot import motor_torque, pendubot, pendubot_regression
from plantfit.models.library.pendubot_terms import base_values
from plantfit.models.model import Model
from plantfit.trust.validate.windows import simulate_windows

import jax
import jax.numpy as jnp

TRUTH = {"m1": 0.21, "m2": 0.1, "lc1": 0.12, "lc2": 0.15, "I1": 0.00053, "I2": 0.00077}
L1, G = 0.15, 9.81
EVERY = ("viscous", "coulomb", "stribeck", "load", "offset")
RUBBING = {
    f"{n}{j}": v * j
    for j in (1, 2)
    for n, v in (("Fv", 0.003), ("Fc", 0.02), ("Fs", 0.01), ("mu", 0.07), ("offset", -0.004))
}


def motion(n=40, seed=0):
    draw = np.random.default_rng(seed).normal
    return {
        f"{kind}{j}": draw(size=n) * scale
        for kind, scale in (("theta", 1.5), ("omega", 3.0), ("alpha", 20.0))
        for j in (1, 2)
    }


def lagrange(s, p, hanging=False):
    """tau (2, n) by Euler-Lagrange of the links' energies in Cartesian coordinates, all derivatives by autodiff."""

    def lagrangian(q, w):
        def centres(q):
            a = q[0] - (jnp.pi / 2 if hanging else 0.0)
            elbow = L1 * jnp.array([jnp.cos(a), jnp.sin(a)])
            first = p["lc1"] * jnp.array([jnp.cos(a), jnp.sin(a)])
            return jnp.stack([first, elbow + p["lc2"] * jnp.array([jnp.cos(a + q[1]), jnp.sin(a + q[1])])])

        place, speed = jax.jvp(centres, (q,), (w,))
        spin = jnp.array([w[0], w[0] + w[1]])
        m, inertia = jnp.array([p["m1"], p["m2"]]), jnp.array([p["I1"], p["I2"]])
        return 0.5 * jnp.sum(m * jnp.sum(speed**2, 1)) + 0.5 * jnp.sum(inertia * spin**2) - G * jnp.sum(m * place[:, 1])

    def torque(q, w, a):
        momentum = jax.grad(lagrangian, 1)
        _, change = jax.jvp(momentum, (q, w), (w, a))
        return change - jax.grad(lagrangian, 0)(q, w)

    pairs = [jnp.stack([s[f"{k}1"], s[f"{k}2"]], 1) for k in ("theta", "omega", "alpha")]
    return np.asarray(jax.vmap(torque)(*pairs)).T


def rates(model, x, u, p):
    return {n: float(v) for n, v in derivative(model)(x, u, p).items()}


@pytest.mark.parametrize("angles", ["horizontal", "hanging"])
@pytest.mark.thorough
def test_torque_is_that_of_lagrange(angles):
    model, s = pendubot_regression(joints=(1, 2), angles=angles), motion()
    expected = lagrange(s, TRUTH, hanging=angles == "hanging")
    for joint in (1, 2):
        np.testing.assert_allclose(model.predict(s, TRUTH, f"tau{joint}"), expected[joint - 1], rtol=1e-11, atol=1e-12)


def test_the_paper_s_form_with_its_misprints_put_right():
    """M q'' + C q' + G of SYSTEMS.md A, with b1 .. b5."""
    s, p = motion(), TRUTH
    b1 = p["m1"] * p["lc1"] ** 2 + p["m2"] * L1**2 + p["I1"]
    b2, b3 = p["m2"] * p["lc2"] ** 2 + p["I2"], p["m2"] * L1 * p["lc2"]
    b4, b5 = p["m1"] * p["lc1"] + p["m2"] * L1, p["m2"] * p["lc2"]
    c2, s2, w1, w2, a1, a2 = (
        np.cos(s["theta2"]),
        np.sin(s["theta2"]),
        s["omega1"],
        s["omega2"],
        s["alpha1"],
        s["alpha2"],
    )
    lift = b5 * G * np.cos(s["theta1"] + s["theta2"])
    tau1 = (b1 + b2 + 2 * b3 * c2) * a1 + (b2 + b3 * c2) * a2 - b3 * w2 * s2 * w1 - b3 * (w1 + w2) * s2 * w2
    tau1 = tau1 + b4 * G * np.cos(s["theta1"]) + lift
    tau2 = (b2 + b3 * c2) * a1 + b2 * a2 + b3 * w1 * s2 * w1 + lift
    model = pendubot_regression(joints=(1, 2), parameters="base")
    found = {"b1": b1, "b2": b2, "b4": b4, "b5": b5}
    np.testing.assert_allclose(model.predict(s, found, "tau1"), tau1, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(model.predict(s, found, "tau2"), tau2, rtol=1e-12, atol=1e-13)


def test_dfki_form_with_rotors_and_arctangent_friction():
    """The equations in the README of the DFKI recordings: inertias about the joints, cf atan(100 omega)."""
    s = motion(seed=3)
    i1, i2, m2, ir, m1r1, m2r2, gr, l1 = 0.046, 0.0447, 0.04, 6e-5, 0.188, 0.145, 6.0, 0.2
    c2, s2, w1, w2 = np.cos(s["theta2"]), np.sin(s["theta2"]), s["omega1"], s["omega2"]
    m11 = i1 + i2 + m2 * l1**2 + 2 * l1 * m2r2 * c2 + (gr**2 + 1) * ir
    m12, m22 = i2 + l1 * m2r2 * c2 - gr * ir, i2 + gr**2 * ir
    end = G * m2r2 * np.sin(s["theta1"] + s["theta2"])
    tau1 = m11 * s["alpha1"] + m12 * s["alpha2"] - 2 * l1 * m2r2 * s2 * w2 * w1 - l1 * m2r2 * s2 * w2**2
    tau1 = tau1 + G * (m1r1 + m2 * l1) * np.sin(s["theta1"]) + end + 0.01 * w1 + 0.12 * np.arctan(100 * w1)
    tau2 = m12 * s["alpha1"] + m22 * s["alpha2"] + l1 * m2r2 * s2 * w1**2 + end + 0.02 * w2 + 0.08 * np.arctan(100 * w2)
    friction = ("viscous", "coulomb")
    model = pendubot_regression(
        "base", "hanging", (1, 2), friction=friction, sign="atan", sign_width=0.01, gear_ratio=gr, l1=l1
    )
    p = {"b1": i1 + m2 * l1**2, "b2": i2, "b4": m1r1 + m2 * l1, "b5": m2r2, "Ir": ir}
    p |= {"Fv1": 0.01, "Fv2": 0.02, "Fc1": 0.12 * np.pi / 2, "Fc2": 0.08 * np.pi / 2}
    np.testing.assert_allclose(model.predict(s, p, "tau1"), tau1, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(model.predict(s, p, "tau2"), tau2, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("parameters", ["physical", "base"])
@pytest.mark.parametrize("angles", ["horizontal", "hanging"])
def test_forward_and_inverse_are_one(parameters, angles):
    options = {"parameters": parameters, "angles": angles, "joints": (1, 2), "friction": EVERY, "gear_ratio": 6.0}
    links = TRUTH if parameters == "physical" else base_values(TRUTH, L1)
    p, s = {**links, "Ir": 6e-5, **RUBBING}, motion(seed=1)
    draw = np.random.default_rng(2).normal
    torque = {"tau1": draw(size=40), "tau2": draw(size=40)}
    moved = derivative(pendubot(**options))({n: s[n] for n in ("theta1", "theta2", "omega1", "omega2")}, torque, p)
    measured = {
        **s,
        "alpha1": moved["omega1"],
        "alpha2": moved["omega2"],
        "load1": torque["tau1"],
        "load2": torque["tau2"],
    }
    inverse = pendubot_regression(**options)
    for output, tau in torque.items():
        np.testing.assert_allclose(inverse.predict(measured, p, output), tau, rtol=1e-10, atol=1e-10)


def test_a_free_swing_keeps_its_energy():
    model, b = pendubot(), base_values(TRUTH, L1)
    rate = jax.jit(
        lambda x: jnp.stack(
            list(derivative(model)(dict(zip(model.states, x, strict=True)), {"tau1": 0.0}, TRUTH).values())
        )
    )
    start = np.array([0.3, -0.8, 2.0, -5.0])
    x = solve_ivp(lambda _, x: rate(x), (0, 3), start, "DOP853", rtol=1e-12, atol=1e-12).y
    assert np.ptp(x[0]) > 1.0  # it really moves
    total = np.asarray(sum(energies(Motion(*x), b, L1, G)))
    np.testing.assert_allclose(total, total[0], atol=1e-9 * np.max(np.abs(total)))


def test_friction_takes_the_energy_that_its_power_says():
    """dE/dt = -sum of friction torque times rate, at any motion under no other torque."""
    s, p = motion(seed=4), {**TRUTH, "Fv1": 0.01, "Fv2": 0.02, "Fc1": 0.05, "Fc2": 0.03}
    model = pendubot(friction=("viscous", "coulomb"))
    x = {n: s[n] for n in model.states}
    moved = derivative(model)(x, {"tau1": 0.0}, p)
    _, power = jax.jvp(
        lambda *q: sum(energies(Motion(*q), base_values(TRUTH, L1), L1, G)),
        tuple(x.values()),
        tuple(moved[n] for n in model.states),
    )
    drag = sum(
        s[f"omega{j}"] * (p[f"Fv{j}"] * s[f"omega{j}"] + p[f"Fc{j}"] * np.tanh(s[f"omega{j}"] / 0.01)) for j in (1, 2)
    )
    np.testing.assert_allclose(power, -drag, rtol=1e-9, atol=1e-10)


def test_voltage_drives_through_the_motor_and_its_gear():
    x = {"theta1": 1.0, "theta2": 0.2, "omega1": 3.0, "omega2": -1.0}
    motor = {"kt": 0.0724, "ke": 0.0724, "Ra": 2.983}
    direct, geared = pendubot(drive="voltage"), pendubot(drive="voltage", gear_ratio=4.0)
    tau = 0.0724 / 2.983 * 5.0 - 0.0724**2 / 2.983 * 3.0
    assert float(motor_torque(5.0, 3.0)) == pytest.approx(tau, rel=1e-14)
    expected = rates(pendubot(), x, {"tau1": tau}, TRUTH)
    assert rates(direct, x, {"V": 5.0}, TRUTH | motor) == pytest.approx(expected, rel=1e-12)
    p = TRUTH | motor | {"Ir": 2e-5}
    expected = rates(pendubot(gear_ratio=4.0), x, {"tau1": 4 * motor_torque(5.0, 4 * 3.0)}, p)
    assert rates(geared, x, {"V": 5.0}, p) == pytest.approx(expected, rel=1e-12)


def test_the_conventions_are_a_quarter_turn_apart():
    x = {"theta1": 0.7, "theta2": -0.4, "omega1": 1.0, "omega2": 2.0}
    flat = rates(pendubot(), x, {"tau1": 0.1}, TRUTH)
    hanging = rates(pendubot(angles="hanging"), {**x, "theta1": 0.7 + np.pi / 2}, {"tau1": 0.1}, TRUTH)
    assert hanging == pytest.approx(flat, rel=1e-12)
    rest = rates(pendubot(angles="hanging"), dict.fromkeys(x, 0.0), {"tau1": 0.0}, TRUTH)
    assert max(map(abs, rest.values())) < 1e-12


def test_starts_where_measured():
    y = {"theta1": 0.3, "theta2": 0.1, "omega1": 4.0, "omega2": 5.0}
    assert initial_state(pendubot(velocity_output=True))({}, {}, y) == y
    free = initial_state(pendubot(initial="free"))({"omega1_0": 1.0, "omega2_0": 2.0}, {}, y)
    assert free == {"theta1": 0.3, "theta2": 0.1, "omega1": 1.0, "omega2": 2.0}
    assert initial_state(pendubot())({}, {}, y)["omega1"] == 0.0


def test_an_undriven_joint_has_no_load():
    model = pendubot(friction=EVERY)
    assert isinstance(model, Model)
    assert {"mu1", "offset2"} <= {p.name for p in model.parameters}
    assert "mu2" not in {p.name for p in model.parameters}
    assert not {"Fv2", "load2"} & {
        *pendubot_regression(friction=EVERY).coefficients,
        *pendubot_regression(friction=EVERY).signals,
    }


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"angles": "vertical"}, "angles = 'vertical'; use one of 'horizontal', 'hanging'"),
        ({"joints": (3,)}, r"joints = \(3,\); give"),
        ({"friction": "viscus"}, "Did you mean 'viscous'"),
        ({"friction": ("viscous", "viscous")}, "twice"),
        ({"drive": "voltage", "joints": (1, 2)}, "drives joint 1 alone"),
        ({"gear_ratio": 0.0}, "gear_ratio = 0.0; give a number above 0"),
        ({"friction": "coulomb", "sign_width": 0.0}, "sign_width = 0.0"),
        ({"friction": "coulomb", "sign": "sign"}, "use one of tanh, atan"),
    ],
)
def test_wrong_options_are_named(options, words):
    with pytest.raises(ModelError, match=words):
        pendubot(**options)


@pytest.mark.thorough
def test_presliding_holds_a_link_at_rest_where_a_smoothed_sign_creeps():
    t = np.linspace(0, 3, 601)
    start = {"theta1": 0.1, "theta2": 0.0, "omega1": 0.0, "omega2": 0.0, "slide1": 0.0, "slide2": 0.0}
    values = {"b1": 0.05, "b2": 0.05, "b4": 0.2, "b5": 0.15, "Fv1": 0.02, "Fv2": 0.02, "Fc1": 1.0, "Fc2": 1.0}
    zero = np.zeros_like(t)
    signals = {"tau1": zero, "tau2": zero, **{n: np.full_like(t, v) for n, v in start.items()}}
    moved = {}
    for sign in ("presliding", "tanh"):
        m = pendubot(
            "base",
            "hanging",
            joints=(1, 2),
            friction=("viscous", "coulomb"),
            sign=sign,
            sign_width=0.1,
            velocity_output=True,
        )
        made = simulate_windows(m, {"r": rec.from_arrays(t, signals=signals)}, values, 3.0)
        moved[sign] = np.abs(made["r"].simulated["theta1"][0] - 0.1)
    creep = {sign: abs(m[-1] - m[len(m) // 2]) for sign, m in moved.items()}
    assert moved["presliding"].max() < 0.005
    assert creep["presliding"] < 1e-3
    assert creep["tanh"] > 0.01


def test_presliding_regression_reads_the_states_of_the_recording():
    m = pendubot_regression("base", "hanging", joints=(1, 2), friction=("coulomb", "offset"), sign="presliding")
    signals = {n: np.zeros(5) for n in m.signals} | {"slide1": np.linspace(-1, 1, 5), "slide2": np.linspace(1, -1, 5)}
    blocks = m.blocks(signals)
    names = list(m.coefficients)
    np.testing.assert_array_equal(blocks["tau1"][:, names.index("Fc1")], signals["slide1"])
    np.testing.assert_array_equal(blocks["tau2"][:, names.index("Fc2")], signals["slide2"])


@pytest.mark.thorough
def test_the_equations_that_plantfit_models_prints_are_those_of_the_models():
    """Written down here as they are printed: M, C and G of `pendubot`, and both torques of `pendubot_regression`."""
    s, b, cos, sin = motion(), {**base_values(TRUTH)}, np.cos, np.sin
    b1, b2, b4, b5, b3, g, l1 = b["b1"], b["b2"], b["b4"], b["b5"], L1 * b["b5"], G, L1
    theta1, theta2, omega1, omega2, alpha1, alpha2 = (s[f"{k}{j}"] for k in ("theta", "omega", "alpha") for j in (1, 2))
    zero = np.zeros_like(theta1)
    M = [[b1 + b2 + 2 * b3 * cos(theta2), b2 + b3 * cos(theta2)], [b2 + b3 * cos(theta2), b2 + zero]]
    C = [[-b3 * omega2 * sin(theta2), -b3 * (omega1 + omega2) * sin(theta2)], [b3 * omega1 * sin(theta2), zero]]
    gravity = [b4 * g * cos(theta1) + b5 * g * cos(theta1 + theta2), b5 * g * cos(theta1 + theta2)]
    both = [M[j][0] * alpha1 + M[j][1] * alpha2 + C[j][0] * omega1 + C[j][1] * omega2 + gravity[j] for j in (0, 1)]
    bent = cos(theta2) * (2 * alpha1 + alpha2) - sin(theta2) * omega2 * (2 * omega1 + omega2)
    tau1 = b1 * alpha1 + b2 * (alpha1 + alpha2) + b4 * g * cos(theta1) + b5 * g * cos(theta1 + theta2) + b5 * l1 * bent
    bent = cos(theta2) * alpha1 + sin(theta2) * omega1**2
    tau2 = b2 * (alpha1 + alpha2) + b5 * g * cos(theta1 + theta2) + b5 * l1 * bent
    model = pendubot_regression(joints=(1, 2))
    for j, printed in enumerate((tau1, tau2)):
        np.testing.assert_allclose(both[j], printed, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(model.predict(s, TRUTH, f"tau{j + 1}"), printed, rtol=1e-10, atol=1e-12)
    for line in ("M = [[b1 + b2 + 2 b3 cos(theta2), b2 + b3 cos(theta2)], [b2 + b3 cos(theta2), b2]]",
                 "C = [[-b3 omega2 sin(theta2), -b3 (omega1 + "
                 "omega2) sin(theta2)], [b3 omega1 sin(theta2), 0]]"):  # fmt: skip
        assert line in (pendubot.__doc__ or "")
    assert "cos(theta2) (2 alpha1 + alpha2) - sin(theta2) omega2 (2 omega1 + omega2)" in (
        pendubot_regression.__doc__ or ""
    )
