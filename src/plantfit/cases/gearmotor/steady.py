"""The speed at which the motor of gearmotor.toml settles."""

from collections.abc import Mapping

import numpy as np


def steady_speed(u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """Settled speed (n,) in deg/s at voltages u (n,), from rest.

    Zero of the right-hand side with friction at full size:
    strength (|u| (1 - w / top_speed) - threshold) = viscous w; zero inside the dead zone.
    """
    size, strength = np.abs(np.asarray(u, dtype=float)), values["strength"]
    speed = strength * (size - values["threshold"]) / (values["viscous"] + strength * size / values["top_speed"])
    return np.sign(u) * np.maximum(speed, 0.0)
