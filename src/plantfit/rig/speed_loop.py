"""A DC motor's rig under a controller of its speed, which reads the encoder's timer sample by sample as the board
does."""

from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.recording.record import Recording, Signal
from plantfit.rig.dc_motor import DcMotorRig, motor_of, run_motor
from plantfit.rig.encoder import capture
from plantfit.simulate.loop.controller import Controller
from plantfit.units import factor_offset

import jax


def driven_by_controller(
    rig: DcMotorRig,
    seed: int,
    law: Controller,
    parameters: Any,
    set_points: np.ndarray,
    units: tuple[str | None, str | None],
) -> Recording:
    """The voltage V (N,) that a controller with these parameters gives along `set_points` (N,), one every period of the
    rig, from rest.

    `record(seed, it)` of the rig is the loop's record: the same encoder, the same motion. `units` of speed and voltage
    are the controller's; `set_points` are in its unit. Without a pulse for the rig's timeout (s), or since the start,
    the speed reads 0. Raises SimulationError for a speed that is not finite any more, UnitError for units that are not
    of a speed and a voltage.
    """
    speed, volt = factor_offset("rad/s", units[0] or "rad/s")[0], factor_offset(units[1] or "V", "V")[0]
    phase, slots = rig.encoder(np.random.default_rng(seed))
    plant, step = motor_of(), rig.period / rig.substeps
    p = tuple(float(rig.parameters[n]) for n in plant.parameters)
    per_turn, most = 2 * np.pi / rig.pulses, 2**rig.bits - 1
    back = int(np.ceil((2 * rig.timeout + rig.period) / step)) + 1  # fine steps in which the last full pulse lies
    n = len(set_points)
    adds = rig.wandering(seed, n)
    fine = np.arange((n - 1) * rig.substeps + 1) * step
    turned, w = np.zeros(len(fine)), np.zeros(len(fine))
    volts, x = np.zeros(n), (0.0, 0.0)
    update = jax.jit(lambda state, read, wanted: law.update(state, read, wanted, parameters))
    state = law.init(np.zeros(()), parameters)
    for k in range(n):
        end = k * rig.substeps
        window = slice(max(0, end - back), end + 1)
        angle = turned[window] / rig.ratio + phase * per_turn
        seen = capture(
            fine[window], angle, fine[end : end + 1], rig.pulses, slots, rig.tick, rig.timeout, w[window] / rig.ratio
        )
        period = float(seen.period[0])
        read = 0.0 if abs(period) >= rig.timeout else rig.ratio * per_turn / period
        state, command = update(state, read * speed, float(set_points[k]))
        duty = np.clip(np.round(float(command) * volt / rig.volts_per_count), -most, most)
        if not np.isfinite(duty):
            raise SimulationError(
                f"The loop has no finite voltage any more at {fine[end]:.6g} "
                "s; its controller makes the motor unstable."
            )
        volts[k] = duty * rig.volts_per_count
        if k + 1 < n:
            i, speeds = run_motor(plant, step, p, np.full(rig.substeps, volts[k] + adds[k]), rig.load, x)
            x, new = (float(i[-1]), float(speeds[-1])), slice(end + 1, end + 1 + rig.substeps)
            w[new] = speeds
            turned[new] = turned[end] + np.cumsum(0.5 * (w[new] + w[end : end + rig.substeps]) * step)
    return Recording(fine[:: rig.substeps], {"V": Signal(volts, "V")}, "loop")
