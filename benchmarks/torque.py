"""The torque of a two-link arm, 20 000 samples: every sample for every candidate, against the QR-compressed
regression and C."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks import data
from benchmarks.c_twins import c_twin
from benchmarks.timing import timed
from plantfit.optimize import Objective, minimise
from plantfit.problem.evaluate.compress import compress, mean_square

import jax
import jax.numpy as jnp

LINK, GRAVITY = 0.15, 9.81  # m, m/s^2
# samples in one fused loop over the candidates, whose coefficients are then read once for all of them; divides the
# samples
BLOCK = 32
RUNS, PARTICLES, ITERATIONS = 1000, 50, 200
METHODS = ("pso", "cga", "salp_swarm")


def base(p, xp: Any = jnp):
    """The five coefficients (n, 5) of physical parameters (n, 6) = m1, lc1, I1, m2, lc2, I2; `xp` is numpy or
    jax.numpy."""
    m1, lc1, i1, m2, lc2, i2 = (p[:, j] for j in range(6))
    return xp.stack(
        [m1 * lc1**2 + m2 * LINK**2 + i1, m2 * lc2**2 + i2, m2 * LINK * lc2, m1 * lc1 + m2 * LINK, m2 * lc2],
        1,
    )


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    task = data.torque()
    box = np.asarray(task.lower), np.asarray(task.upper)
    compressed = compress(task.regressor, task.torque)
    direct, short = jax.jit(_direct(task)), jax.jit(lambda p: mean_square(compressed, base(p)))
    calls: dict[str, Callable] = {"direct": direct, "through QR": short}
    twin = _twin(task)
    if twin is not None:
        calls["C, SIMD over candidates"] = twin
    figures: dict[str, float] = {"torque_worst_disagreement": 0.0}
    print(f"{len(task.torque)} samples, 5 columns; mean squared error of P candidates")
    print(f"{'':28}{'P':>6}{'first call':>12}{'median':>12}{'candidates/s':>16}")
    for count in (50, 5000):
        p = box[0] + (box[1] - box[0]) * np.random.default_rng(count).uniform(size=(count, 6))
        seconds = {}
        for name, call in calls.items():
            timing = timed(lambda call=call, p=p: call(p), 5)
            seconds[name] = timing.median
            print(
                f"{name:28}{count:6}{timing.first:10.2f} s{1000 * timing.median:9.3f} ms{count / timing.median:16.0f}"
            )
            apart = float(np.max(np.abs(np.asarray(call(p)) / np.asarray(direct(p)) - 1.0)))
            figures["torque_worst_disagreement"] = max(figures["torque_worst_disagreement"], apart)
        figures[f"torque_direct_per_s_{count}"] = count / seconds["direct"]
        figures[f"torque_qr_per_s_{count}"] = count / seconds["through QR"]
        if twin is not None:
            figures[f"torque_direct_speed_over_c_twin_{count}"] = seconds["C, SIMD over candidates"] / seconds["direct"]
    return figures | _headline(
        short, box, compressed, task, RUNS // (10 if quick else 1), figures["torque_direct_per_s_5000"]
    )


def _twin(task: data.Torque) -> Callable[[np.ndarray], np.ndarray] | None:
    """Costs (n,) of physical parameters (n, 6) from every sample, in C; None without a compiler."""
    c_costs = c_twin("torque", "torque_costs")
    if c_costs is None:
        return None
    regressor, torque = np.ascontiguousarray(task.regressor), np.ascontiguousarray(task.torque)

    def costs(p: np.ndarray) -> np.ndarray:
        out = np.empty(len(p))
        c_costs(len(p), len(torque), np.ascontiguousarray(np.asarray(base(p, np)).T), regressor, torque, out)
        return out

    return costs


def _direct(task: data.Torque) -> Callable:
    """Costs (n,) of physical parameters (n, 6) from every sample."""
    count = len(task.torque)
    blocks = jnp.asarray(np.column_stack([task.regressor, task.torque]).reshape(-1, BLOCK, 6))

    def costs(p):
        b = base(p).T

        def add(total, rows):
            for row in rows:
                total = total + (sum(row[j] * b[j] for j in range(5)) - row[5]) ** 2
            return total, None

        return jax.lax.scan(add, jnp.zeros(len(p)), blocks)[0] / count

    return costs


def _headline(
    short: Callable, box, compressed, task: data.Torque, runs: int, direct_per_second: float
) -> dict[str, float]:
    """1000 independent runs of 50 members for 200 iterations on the compressed problem, for the three methods of the
    pendubot study."""
    objective = Objective(
        dimension=6, costs=lambda z: short(box[0] + z * (box[1] - box[0])), lower=box[0], upper=box[1]
    )
    least = np.linalg.lstsq(task.regressor, task.torque)[0]
    floor = float(mean_square(compressed, least))
    scaled, direct = RUNS / runs, RUNS * PARTICLES * ITERATIONS / direct_per_second
    print(
        f"{runs} runs x {PARTICLES} members x {ITERATIONS} iterations through QR; least squares ends at "
        f"{floor**0.5:.6f} N m"
    )
    print(
        f"{'':12}{'first call':>12}{'again':>12}{'of 1000 runs':>16}{'rmse best':>12}{'median':>12}{'over floor':>12}"
    )
    figures = {"torque_1000_pso_runs_direct_s": direct}
    for method in METHODS:
        seconds = []
        for _ in range(2):
            started = time.perf_counter()
            results = minimise(
                objective, method, runs=runs, budget=PARTICLES * ITERATIONS, settings={"population": PARTICLES}, seed=1
            )
            seconds.append(time.perf_counter() - started)
        rmse = np.sqrt([r.cost for r in results])
        over = float(np.median(rmse) / floor**0.5)
        print(
            f"{method:12}{seconds[0]:10.2f} s{seconds[1]:10.2f} s{scaled * seconds[1]:14.2f} s"
            f"{rmse.min():12.6f}{np.median(rmse):12.6f}{over:12.6f}"
        )
        figures[f"torque_1000_{method}_runs_s"] = scaled * seconds[1]
        figures[f"torque_{method}_median_rmse_over_least_squares"] = over
    print(f"{RUNS} runs with every sample evaluated: {direct:.0f} s (extrapolated)")
    return figures
