"""A linear plant behind dead time as a sampled plant without it, its states joined by the inputs still on their way."""

from dataclasses import replace

import numpy as np

from plantfit.control.linear.linear_plant import LinearPlant, discretised
from plantfit.errors import SimulationError

ROUNDING = 1e-9  # of a sample


def with_dead_time(plant: LinearPlant, period: float, seconds: float, longest: float | None = None) -> LinearPlant:
    """A continuous plant whose inputs act `seconds` late, sampled every `period` s with its inputs held.

        x[k+1] = A x[k] + B1 u[k-d-1] + B0 u[k-d],   seconds = (d + f) period,
        B1 = e^{A (1-f) h} G(f h),  B0 = G((1-f) h),  G(s) = int_0^s e^{A t} dt B

    Its states are those of the plant, then u[k-1], u[k-2], ... as far as `longest` s (`seconds` where left out) need,
    so that plants of one `longest` have one shape. Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed.,
    section 2.3. Raises SimulationError for times that are negative or longer than `longest`.
    """
    longest = seconds if longest is None else longest
    if not 0 <= seconds <= longest < np.inf:
        raise SimulationError(
            f"dead_time = {seconds:g} s with longest_delay = {longest:g} s; give 0 or more, and at least as much."
        )
    n, m = plant.B.shape
    count = seconds / period
    d = int(np.floor(count + ROUNDING))
    share = max(count - d, 0.0)
    past = int(np.ceil(longest / period - ROUNDING))
    whole = discretised(plant, period)
    later = discretised(plant, (1.0 - share) * period)
    early = discretised(plant, share * period).B if share > 0 else np.zeros((n, m))
    size = n + past * m
    a, b = np.zeros((size, size)), np.zeros((size, m))
    a[:n, :n] = whole.A
    for back, matrix in ((d, later.B), (d + 1, later.A @ early)):
        if back == 0:
            b[:n] += matrix
        elif back <= past:  # beyond it only where the share is 0, and with it the matrix
            a[:n, n + (back - 1) * m : n + back * m] += matrix
    if past:
        b[n : n + m] = np.eye(m)
        a[n + m :, n : size - m] = np.eye((past - 1) * m)
    names = tuple(f"{name} {k} ago" for k in range(1, past + 1) for name in plant.inputs)
    units = {
        **plant.units,
        **{f"{name} {k} ago": plant.units.get(name) for k in range(1, past + 1) for name in plant.inputs},
    }
    c = np.c_[plant.C, np.zeros((plant.C.shape[0], past * m))]
    x0 = np.r_[plant.x0, np.tile(plant.u0, past)]
    return replace(plant, A=a, B=b, C=c, x0=x0, states=(*plant.states, *names), units=units, period=float(period))
