"""A simulated motor and a static line, whose parameters are known."""

import numpy as np
from scipy.signal import lfilter

import plantfit.runtime  # noqa: F401
from plantfit.models import dc_motor
from plantfit.models.model import Declared, Model
from plantfit.recording.record import Recording, Signal
from plantfit.simulate import Simulator

MOTOR = {"Rm": 2.0, "Lm": 2e-3, "Kb": 0.05, "Jm": 2e-5, "Cm": 1e-5, "Tf": 3e-3}


def motor_recording(noise: float = 0.3, seed: int = 0, n: int = 600, unit: str = "rad/s") -> Recording:
    """Speed of a motor with Kt = Kb under random voltage steps, with white noise (rad/s)."""
    rng = np.random.default_rng(seed)
    t = 0.005 * np.arange(n)
    voltage = np.repeat(rng.uniform(-6.0, 6.0, n // 30), 30)
    simulator = Simulator.of(dc_motor(tied=True), substeps=32)
    drive = simulator.drive(t, {"V": voltage}, measured={"w": np.zeros(n)})
    speed = np.asarray(simulator.outputs(MOTOR, drive)["w"]) + noise * rng.normal(size=n)
    factor = {"rad/s": 1.0, "rpm": 30.0 / np.pi}[unit]
    return Recording(t, {"V": Signal(voltage, "V"), "w": Signal(speed * factor, unit)}, "motor")


def line() -> Model:
    """y = a u + b, a static model."""
    return Model(
        name="line",
        states={},
        inputs={"u": "V"},
        outputs={"y": "rad/s"},
        parameters=(Declared("a", "rad/s/V", (-10.0, 10.0)), Declared("b", "rad/s", (-5.0, 5.0))),
        output=lambda x, u, p: {"y": p["a"] * u["u"] + p["b"]},
    )


def line_recording(a=2.0, b=-1.0, n=80, noise=0.1, rho=0.0, seed=0, name="line", unit=None) -> Recording:
    """A line with AR(1) noise of correlation `rho`."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=n)
    e = lfilter([1.0], [1.0, -rho], noise * rng.normal(size=n))
    return Recording(0.1 * np.arange(n), {"u": Signal(u), "y": Signal(a * u + b + e, unit)}, name)
