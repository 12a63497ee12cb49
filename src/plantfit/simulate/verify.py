"""How far the simulation is from the exact solution: a tight solver, and step doubling."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steppers import ORDER

import jax
import jax.numpy as jnp


@dataclass(frozen=True)
class StepError:
    """Errors of the outputs in their units over the samples [first, last] that were compared."""

    max_error: dict[str, float]
    rms_error: dict[str, float]
    first: int
    last: int


def against_radau(
    simulator: Simulator, p: Mapping[str, Any], drive: Drive, *, rtol: float = 1e-9, atol: float = 1e-11, pieces: int = 1500
) -> StepError:
    """Compare with scipy's Radau (rtol, atol), restarted at every edge of an input.

    At most `pieces` smooth pieces are integrated; a longer record is compared on its first part.
    atol is relative to the largest size of each state. Raises SimulationError when either fails.
    """
    ours = {k: np.asarray(v) for k, v in simulator.outputs(p, drive).items()}
    n = drive.t.shape[0]
    if not simulator.vector.states:
        return StepError({k: 0.0 for k in ours}, {k: 0.0 for k in ours}, 0, n - 1)
    exact = tight_states(simulator, p, drive, rtol=rtol, atol=atol, pieces=pieces)
    count = exact.shape[1]
    values = tuple(float(p[k]) for k in simulator.vector.parameters)
    channels = tuple(np.asarray(c)[:count] for c in _channels_at_samples(simulator, p, drive))
    y = jax.vmap(simulator.vector.output, in_axes=(0, 0, None))(tuple(exact), channels, values)
    largest, rms = {}, {}
    for name, value in zip(simulator.vector.outputs, y, strict=True):
        error = np.asarray(value) - ours[name][:count]
        if not np.all(np.isfinite(error)):
            raise SimulationError(f"Output {name!r} is not finite at these parameter values; the check against a tight solver is not possible there.")
        largest[name], rms[name] = float(np.max(np.abs(error))), float(np.sqrt(np.mean(error**2)))
    return StepError(largest, rms, 0, count - 1)


def tight_states(simulator: Simulator, p: Mapping[str, Any], drive: Drive, *, rtol=1e-9, atol=1e-11, pieces=1500) -> np.ndarray:
    """States (n, m) by Radau at the first m samples (all of them, unless there are more than `pieces` pieces)."""
    vector = simulator.vector
    values = tuple(float(p[k]) for k in vector.parameters)
    grid, rank, u0, u1 = _pieces(simulator, p, drive)
    rate, jacobian = _packed(vector, values)
    x = np.array([float(v) for v in simulator.initial(p, drive)])
    scale = np.maximum(1e-9, [float(np.max(np.abs(s))) for s in simulator.states(p, drive)])
    states = np.full((len(x), len(rank)), np.nan)
    states[:, rank == 0] = x[:, None]
    # samples inside a stretch of constant input need no restart: they are read from dense output
    sample_at = np.full(len(grid), -1)
    sample_at[rank] = np.arange(len(rank))
    k, used = 0, 0
    while k < len(grid) - 1:
        end = k + 1
        while end < len(grid) - 1 and _goes_on(u0, u1, grid, k, end):
            end += 1
        used += 1
        if used > pieces:
            return states[:, : np.max(sample_at[: k + 1]) + 1]
        start, stop = grid[k], grid[end]
        if stop > start:
            ends = np.array([start, stop, *(c[k] for c in u0), *(c[end - 1] for c in u1)])
            inside = grid[k + 1 : end + 1]
            solution = solve_ivp(
                lambda t, x, ends=ends: np.asarray(rate(np.concatenate([[t], x, ends]))),
                (start, stop),
                x,
                "Radau",
                t_eval=np.unique(inside),
                rtol=rtol,
                atol=atol * scale,
                jac=lambda t, x, ends=ends: np.asarray(jacobian(np.concatenate([[t], x, ends])))[:, 1 : 1 + len(x)],
            )
            if not solution.success:
                raise SimulationError(f"The tight solver failed at t = {solution.t[-1]:g} s: {solution.message}")
            place = np.searchsorted(solution.t, inside)
            wanted = sample_at[k + 1 : end + 1]
            states[:, wanted[wanted >= 0]] = solution.y[:, place[wanted >= 0]]
            x = solution.y[:, -1]
        else:
            for j in range(k + 1, end + 1):
                if sample_at[j] >= 0:
                    states[:, sample_at[j]] = x
        k = end
    return states


def _packed(vector, values):
    """Right-hand side and its Jacobian as functions of one vector (t, x, start, stop, u at start, u at stop): one quick call each."""
    n, m = len(vector.states), len(vector.channels)

    def rate(q):
        t, x, start, stop = q[0], tuple(q[1 : n + 1]), q[n + 1], q[n + 2]
        share = (t - start) / (stop - start)
        u = tuple(q[n + 3 + i] + share * (q[n + 3 + m + i] - q[n + 3 + i]) for i in range(m))
        return jnp.stack(vector.rate(x, u, values))

    return jax.jit(rate), jax.jit(jax.jacfwd(rate))


def _pieces(simulator: Simulator, p, drive: Drive):
    steps, (u0, u1, length) = simulator._steps(p, drive)
    start = np.asarray(steps.start)
    grid = np.r_[start, start[-1] + np.asarray(length)[-1]]
    return grid, np.asarray(steps.rank), [np.asarray(c) for c in u0], [np.asarray(c) for c in u1]


def _goes_on(u0, u1, grid, first, k) -> bool:
    """Whether step k continues the straight inputs of step `first`; time itself always does."""
    for a, b in zip(u0[:-1], u1[:-1], strict=True):
        slope = (b[first] - a[first]) / (grid[first + 1] - grid[first]) if grid[first + 1] > grid[first] else 0.0
        there = a[first] + slope * (grid[k] - grid[first])
        after = a[first] + slope * (grid[k + 1] - grid[first])
        size = 1e-12 * (1.0 + abs(a[first]))
        if abs(a[k] - there) > size or abs(b[k] - after) > size:
            return False
    return True


def _channels_at_samples(simulator: Simulator, p, drive: Drive):
    late = [np.asarray(c)[np.asarray(i)] for c, i in simulator._at_samples(p, drive)]
    return [*map(np.asarray, drive.value), *late, np.asarray(drive.t)]


def doubling_error(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> dict[str, np.ndarray]:
    """Estimated error (N,) of each output: its change when every step is halved, times q / (q - 1), q = 2 ** order."""
    q = 2.0 ** ORDER[simulator.stepper]
    coarse, fine = simulator.outputs(p, drive), simulator.refined(2).outputs(p, drive)
    return {k: np.abs(np.asarray(coarse[k]) - np.asarray(fine[k])) * q / (q - 1.0) for k in coarse}


__all__ = ["StepError", "against_radau", "doubling_error", "tight_states"]
