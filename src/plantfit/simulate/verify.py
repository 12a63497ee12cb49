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
    """Errors of the outputs in their units over the samples [first, last] that were compared, and `checked_with` what."""

    max_error: dict[str, float]
    rms_error: dict[str, float]
    first: int
    last: int
    checked_with: str = "scipy Radau, rtol 1e-9"


def against_radau(
    simulator: Simulator, p: Mapping[str, Any], drive: Drive, *, rtol: float = 1e-9, atol: float = 1e-11, pieces: int = 1500
) -> StepError:
    """Compare with scipy's Radau (rtol, atol), restarted at every edge of an input.

    At most `pieces` smooth pieces are integrated; a longer record is compared on its first part.
    atol is relative to the largest size of each state. Raises SimulationError when either fails.
    """
    model = simulator.vector.model
    if not model.smooth:
        raise SimulationError(
            f"Model {model.name!r} has resets, dry friction, backlash or late states, which the tight solver does not follow; "
            "its step error is known from halving the steps."
        )
    if not simulator.vector.states:
        none = dict.fromkeys(simulator.vector.outputs, 0.0)
        return StepError(none, dict(none), 0, drive.t.shape[0] - 1)
    workings = _workings(simulator, p, drive)
    ours = {k: np.asarray(v) for k, v in workings["outputs"].items()}
    exact = _integrated(simulator, p, workings, rtol, atol, pieces)
    count = exact.shape[1]
    values = tuple(np.asarray(p[k], dtype=float) for k in simulator.vector.parameters)
    channels = tuple(c[:count] for c in workings["channels"])
    y = jax.jit(jax.vmap(simulator.vector.output, in_axes=(0, 0, None)))(tuple(exact), channels, values)
    largest, rms = {}, {}
    for name, value in zip(simulator.vector.outputs, y, strict=True):
        error = np.asarray(value) - ours[name][:count]
        if not np.all(np.isfinite(error)):
            raise SimulationError(
                f"Output {name!r} is not finite at these parameter values; the check against a tight solver is not possible there."
            )
        largest[name], rms[name] = float(np.max(np.abs(error))), float(np.sqrt(np.mean(error**2)))
    return StepError(largest, rms, 0, count - 1)


def check_steps(simulator: Simulator, p: Mapping[str, Any], drive: Drive, *, pieces: int = 1500) -> StepError:
    """The error of a simulation: `against_radau`, or `by_doubling` where Radau does not follow the model or fails."""
    try:
        return against_radau(simulator, p, drive, pieces=pieces)
    except SimulationError:
        return by_doubling(simulator, p, drive)


def by_doubling(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> StepError:
    """The error of a simulation over the whole record, estimated by halving its steps."""
    estimate = doubling_error(simulator, p, drive)
    largest = {o: float(np.max(e)) for o, e in estimate.items()}
    rms = {o: float(np.sqrt(np.mean(e**2))) for o, e in estimate.items()}
    return StepError(largest, rms, 0, drive.t.shape[0] - 1, "step doubling")


def tight_states(simulator: Simulator, p: Mapping[str, Any], drive: Drive, *, rtol=1e-9, atol=1e-11, pieces=1500) -> np.ndarray:
    """States (n, m) by Radau at the first m samples (all of them, unless there are more than `pieces` pieces)."""
    return _integrated(simulator, p, _workings(simulator, p, drive), rtol, atol, pieces)


def _workings(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> dict[str, Any]:
    """Everything of a simulation that the comparison needs, compiled as one."""

    @jax.jit
    def work(p, drive):
        steps, (u0, u1, length) = simulator.steps(p, drive)
        return {
            "outputs": simulator.outputs(p, drive),
            "states": simulator.states(p, drive),
            "initial": simulator.initial(p, drive.first_input, drive.first_output),
            "grid": jnp.append(steps.start, steps.start[-1] + length[-1]),
            "rank": steps.rank,
            "u0": u0,
            "u1": u1,
            "channels": simulator.channels(p, drive),
        }

    return jax.tree.map(np.asarray, work({k: np.asarray(v, dtype=float) for k, v in p.items()}, drive))


def _integrated(simulator: Simulator, p: Mapping[str, Any], workings, rtol: float, atol: float, pieces: int) -> np.ndarray:
    grid, rank, u0, u1 = (workings[k] for k in ("grid", "rank", "u0", "u1"))
    rate, jacobian = _packed(simulator.vector, tuple(np.asarray(p[k], dtype=float) for k in simulator.vector.parameters))
    x = np.array([float(v) for v in workings["initial"]])
    scale = np.maximum(1e-9, [float(np.max(np.abs(s))) for s in workings["states"]])
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


def doubling_error(simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> dict[str, np.ndarray]:
    """Estimated error (N,) of each output: its change when every step is halved, times q / (q - 1), q = 2 ** order."""
    q = 2.0 ** ORDER[simulator.stepper]
    finer = simulator.refined(2)
    coarse, fine = jax.jit(simulator.outputs)(p, drive), jax.jit(finer.outputs)(p, drive)
    return {k: np.abs(np.asarray(coarse[k]) - np.asarray(fine[k])) * q / (q - 1.0) for k in coarse}
