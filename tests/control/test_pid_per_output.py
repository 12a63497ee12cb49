"""Pole placement for a PID at each output, against eigenvalues and a loop written out."""

import ctypes

import numpy as np
import pytest
from c_programs import ArrayProgram
from plants import CARTS, PERIOD, STICK, carts, stick, straight, upright

from plantfit.control import Gains, design_to_c, linearised, pid_per_output
from plantfit.errors import SimulationError
from plantfit.models.library.pendubot import pendubot

import jax

ARM = {
    "m1": 0.21,
    "m2": 0.1,
    "lc1": 0.12,
    "lc2": 0.15,
    "I1": 0.00053,
    "I2": 0.00077,
    "kt": 0.0724,
    "ke": 0.0724,
    "Ra": 2.983,
}


def test_the_ideal_loop_has_the_poles_asked_for():
    plant = linearised(pendubot(drive="voltage"), ARM, {"theta1": np.pi / 2})
    poles = [-12.0, -9.0 + 3.0j, -9.0 - 3.0j, -5.0, -0.7]
    gains = pid_per_output(plant, 1e-3, poles, integral="theta2").parameters
    a = np.zeros((5, 5))
    a[:4, :4], a[4, 1] = plant.A, 1.0
    row = [gains["theta1"].Kp, gains["theta2"].Kp, gains["theta1"].Kd, gains["theta2"].Kd, gains["theta2"].Ki]
    a[:4] -= np.outer(plant.B[:, 0], row)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(a)), np.sort_complex(np.array(poles)), rtol=1e-6)
    assert gains["theta1"].Ki == 0.0


def test_the_loop_equals_one_written_out():
    design = pid_per_output(upright(), PERIOD, [-6.0, -5.0, -1.0], integral="q", filter_time=0.03, limits=(-0.045, 0.3))
    gains, x, n = design.parameters["q"], np.array([0.06, 0.0]), 120
    ours = design.close(straight(), stepper="rk4").simulate(
        design.parameters, STICK, {"q": 0.02}, samples=n, x0={"q": 0.06}
    )
    integral = slope = last = clamped = 0.0
    before, seen = x[0], []
    for k in range(n):
        error = 0.02 - x[0]
        change = 0.0 if k == 0 else before - x[0]
        before = x[0]
        added = PERIOD / 2 * gains.Ki * (error + last)
        last = error
        slope = (0.03 * slope + gains.Kd * change) / (0.03 + PERIOD)
        wanted = gains.Kp * error + integral + added + slope
        if (wanted > 0.3 and added > 0) or (wanted < -0.045 and added < 0):
            clamped += 1
        else:
            integral += added
        u = np.clip(wanted, -0.045, 0.3)
        seen.append((x[0], u))
        for _ in range(200):  # small steps of the midpoint rule

            def rate(x, u=u):
                return np.array([x[1], 20.0 * x[0] - 0.3 * x[1] + 50.0 * u])

            x = x + PERIOD / 200 * rate(x + PERIOD / 400 * rate(x))
    seen = np.array(seen)
    np.testing.assert_allclose(ours.y["q"], seen[:, 0], atol=2e-5)
    np.testing.assert_allclose(ours.u["u"], seen[:, 1], atol=2e-3)
    assert clamped > 0


def test_parts_beyond_the_limits_may_cancel():
    """Each PID alone would be clipped; their sum is what is limited."""
    plant = linearised(pendubot(drive="voltage"), ARM, {"theta1": np.pi / 2})
    design = pid_per_output(plant, 1e-3, [-13.0, -11.0, -7.0, -6.0], filter_time=2e-3, limits=(-24.0, 24.0))
    start = {"theta1": np.pi / 2 + 0.5, "theta2": -0.5}
    seen = design.close(pendubot(drive="voltage"), stepper="rk4", substeps=1).simulate(
        design.parameters, ARM, {}, samples=3, x0=start
    )
    parts = [abs(design.parameters[name].Kp) * 0.5 for name in ("theta1", "theta2")]
    assert min(parts) > 24.0
    assert abs(float(seen.command["V"][0])) < 15.0


def test_gains_may_be_changed():
    design = pid_per_output(upright(), PERIOD, [-6.0, -5.0])
    loop = design.close(stick(), stepper="rk4")
    ends = [
        float(loop.simulate({"q": gains}, STICK, {}, samples=300, x0={"q": 0.05}).y["q"][-1])
        for gains in (design.parameters["q"], Gains(0.1))
    ]
    assert abs(ends[0]) < 1e-6
    assert abs(ends[1]) > 1e-2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pid_per_output(linearised(carts(), CARTS), PERIOD, [-1.0] * 4), "needs one input"),
        (lambda: pid_per_output(upright(), PERIOD, [-1.0, -2.0, -3.0]), "give 2"),
        (lambda: pid_per_output(upright(), PERIOD, [-1.0, 2.0]), "below 0"),
        (lambda: pid_per_output(upright(), PERIOD, [-1.0, -1.0]), "cannot be placed"),
        (lambda: pid_per_output(upright(), PERIOD, [-1.0, -2.0], integral="w"), "integral = 'w'"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()


class PidsProgram(ArrayProgram):
    """PIDs of several outputs as exported: the command is what NAME_update returns."""

    def update(self, measurement, reference):
        function = getattr(self.library, f"{self.name}_update")
        function.restype = self.real
        arrays = [None if a is None else np.ascontiguousarray(a, self.kind) for a in (measurement, reference)]
        return function(
            self.state, *(None if a is None else a.ctypes.data_as(ctypes.POINTER(self.real)) for a in arrays)
        )


@pytest.mark.parametrize("number", ["double", "float"])
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.thorough
def test_the_c_file_equals_python_over_ten_thousand_samples(tmp_path, number, given):
    """Two outputs of the pendubot, one with an integral, limits that bind, with a reference and about the point."""
    plant = linearised(pendubot(drive="voltage"), ARM, {"theta1": np.pi / 2})
    design = pid_per_output(
        plant, 1e-3, [-12.0, -9.0 + 3.0j, -9.0 - 3.0j, -5.0, -0.7], integral="theta2", filter_time=5e-3,
        limits=(-14.0, 9.0)
    )  # fmt: skip
    rng, n = np.random.default_rng(2), 10_000 if number == "double" else 400
    k = np.arange(n)
    y = plant.y0 + np.stack([0.02 * np.sin(k / 90.0), 0.03 * np.cos(k / 130.0)], axis=1) + rng.normal(0, 1e-4, (n, 2))
    r = plant.y0 + np.stack([0.01 * np.sign(np.sin(k / 700.0)), 0.0 * k], axis=1)
    update = jax.jit(design.controller.update)
    state, ours = design.controller.init(dict(zip(plant.outputs, y[0], strict=True)), design.parameters), []
    for a, b in zip(y, r, strict=True):
        followed = dict(zip(plant.outputs, b, strict=True)) if given else {}
        state, command = update(state, dict(zip(plant.outputs, a, strict=True)), followed, design.parameters)
        ours.append(float(command[plant.inputs[0]]))
    program = PidsProgram(design_to_c(design, tmp_path, name="arms", number=number), number)
    program.call("init", y[0])
    told = np.array([program.update(a, b if given else None) for a, b in zip(y, r, strict=True)])
    assert np.mean((told > -14.0) & (told < 9.0)) > 0.1
    if number == "double":
        assert told.min() == -14.0
        assert told.max() == 9.0
        np.testing.assert_allclose(told, ours, rtol=1e-12, atol=1e-9)
    else:
        np.testing.assert_allclose(told, ours, atol=2e-2)
