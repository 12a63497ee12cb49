"""Tuning of a speed loop: generations of 500 closed loops of 1000 samples, on one motor and on 1000, against C with
SIMD."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import expm

import plantfit.runtime  # noqa: F401
from benchmarks import data
from benchmarks.c_twins import c_twin
from plantfit.control import Gains, pid, step_observer
from plantfit.models.text.equations import equations
from plantfit.optimize import Facts
from plantfit.optimize.algorithms.pso import ParticleSwarm
from plantfit.simulate.loop.closed_loop import ClosedLoop, closed_loop
from plantfit.simulate.loop.sensors import Actuator

import jax
import jax.numpy as jnp

POPULATION, GENERATIONS = 500, 600
PLANTS, AT_ONCE = 1000, 20  # motors of a family, and how many of them a call takes
MOTOR = "i' = (V - R*i - K*w)/L\nw' = (K*i - B*w)/J"


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    task = data.loop()
    measured = 5 if quick else 20
    gains = task.lower + (task.upper - task.lower) * np.random.default_rng(7).uniform(size=(measured, POPULATION, 3))
    names = ("exact", "rosenbrock")
    ours = {name: _metrics(task, name) for name in names}
    twin = _twin(task)
    # one after the other within each round, so that all meet the same load
    calls: dict[str, Callable] = {
        f"plantfit, {name}": (lambda g, f=f: jax.block_until_ready(f(g))) for name, f in ours.items()
    }
    if twin is not None:
        calls["C, SIMD over candidates"] = twin
    first, medians = _rounds(calls, gains)
    pso = _through_pso(task, ours["exact"], measured)
    print(f"{POPULATION} loops of {int(task.steps)} samples a generation, {measured} generations timed, one core")
    print(f"{'':36}{'first call':>12}{'generation':>14}{'300 000 loops':>16}")
    for name in calls:
        print(f"{name:36}{first[name]:10.2f} s{1000 * medians[name]:11.2f} ms{GENERATIONS * medians[name]:14.2f} s")
    print(f"{'plantfit, exact, searched by PSO':36}{'':12}{1000 * pso:11.2f} ms{GENERATIONS * pso:14.2f} s")
    figures = {
        "pid_300000_loops_s": GENERATIONS * medians["plantfit, exact"],
        "pid_300000_loops_pso_s": GENERATIONS * pso,
        "pid_300000_loops_substeps_s": GENERATIONS * medians["plantfit, rosenbrock"],
    }
    if twin is None:
        return figures
    mine, theirs = np.stack(ours["exact"](gains[0])), twin(gains[0])
    same = np.mean(np.all(np.isclose(mine, theirs, rtol=1e-6, atol=1e-6), axis=0))
    print(
        "plantfit and C agree to 1e-6 in all five metrics for "
        f"{100 * same:.1f} % of the loops (rounding to counts may fall apart)"
    )
    figures |= _family(task, 100 if quick else PLANTS)
    return figures | {
        "pid_speed_over_c_twin": medians["C, SIMD over candidates"] / medians["plantfit, exact"],
        "pid_same_as_c_twin": float(same),
    }


def _family(task: data.Loop, plants: int) -> dict[str, float]:
    """One generation on every motor of a family, each constant within 20 %: ours and C in turns, chunk by chunk."""
    rng = np.random.default_rng(11)
    motors = np.asarray(task.motor) * rng.uniform(0.8, 1.2, (plants, 5))
    gains = task.lower + (task.upper - task.lower) * rng.uniform(size=(POPULATION, 3))
    loop, observer = _loop(task, "exact"), step_observer()

    def one(motor, row):
        plant: dict[str, Any] = dict(zip("RLKBJ", motor, strict=True))
        return loop.observe(observer, Gains(*row), plant, float(task.set_point), samples=int(task.steps))

    ours = jax.jit(lambda motors: jax.vmap(lambda m: jax.vmap(lambda g: one(m, g))(jnp.asarray(gains)))(motors))
    jax.block_until_ready(ours(motors[:AT_ONCE]))
    mine, theirs, same = 0.0, 0.0, 0.0
    for first in range(0, plants, AT_ONCE):
        part = motors[first : first + AT_ONCE]
        twins = [_twin(replace(task, motor=m)) for m in part]  # their matrices are not timed
        started = time.perf_counter()
        found = jax.block_until_ready(ours(part))
        middle = time.perf_counter()
        told = np.stack([twin(gains) for twin in twins if twin is not None], axis=1)
        mine, theirs = mine + middle - started, theirs + time.perf_counter() - middle
        same += np.sum(np.all(np.isclose(np.stack(found), told, rtol=1e-6, atol=1e-6), axis=0))
    print(
        f"{plants} motors x {POPULATION} gains x {int(task.steps)} samples: plantfit {mine:.2f} s, C {theirs:.2f} s, "
        f"{mine / theirs:.2f} times; {100 * same / (plants * POPULATION):.1f} % of the loops alike to 1e-6"
    )
    return {"pid_family_times_c_twin": mine / theirs}


def _metrics(task: data.Loop, stepper: str) -> Callable:
    """Gains (n, 3) to the five metrics, each (n,)."""
    loop, observer = _loop(task, stepper), step_observer()
    plant: dict[str, Any] = dict(zip("RLKBJ", task.motor, strict=True))

    def one(row):
        return loop.observe(observer, Gains(*row), plant, float(task.set_point), samples=int(task.steps))

    return jax.jit(lambda rows: jax.vmap(lambda *row: one(row))(*jnp.asarray(rows).T))


def _loop(task: data.Loop, stepper: str) -> ClosedLoop:
    model = equations(
        MOTOR,
        inputs=["V"],
        states=["i", "w"],
        outputs=["w"],
        parameters=dict.fromkeys(["R", "L", "K", "B", "J"]),
        name="motor",
    )
    top = float(task.counts)
    controller = pid(float(task.period), lower=0.0, upper=top)
    actuator = Actuator(0.0, top, quantum=1.0, gain=float(task.volts) / top)
    return closed_loop(model, controller, period=float(task.period), actuator=actuator, stepper=stepper)


def _through_pso(task: data.Loop, metrics: Callable, generations: int) -> float:
    """Seconds a generation of a particle swarm on overshoot + settling time + error."""

    horizon = float(task.steps) * float(task.period)
    swarm = ParticleSwarm(population=POPULATION)
    facts = Facts(3, POPULATION * generations)

    def costs(z):
        m = metrics(task.lower + z * (task.upper - task.lower))
        return m.overshoot + 100.0 * jnp.minimum(m.settling_time, horizon) / horizon + jnp.abs(m.steady_state_error)

    def generation(g, both):
        key, state = both
        z, state = swarm.ask(jax.random.fold_in(key, g), state)
        return key, swarm.tell(state, z, costs(z))[0]

    @jax.jit
    def search(key):
        return jax.lax.fori_loop(0, generations, generation, (key, swarm.init(key, facts)))[1].best_f.min()

    jax.block_until_ready(search(jax.random.key(0)))
    started = time.perf_counter()
    jax.block_until_ready(search(jax.random.key(0)))
    return (time.perf_counter() - started) / generations


def _rounds(calls: dict[str, Callable], gains: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    """Seconds of the first call, and the median over all generations."""
    first, seconds = {}, {name: [] for name in calls}
    for name, call in calls.items():
        started = time.perf_counter()
        call(gains[0])
        first[name] = time.perf_counter() - started
    for generation in gains:
        for name, call in calls.items():
            started = time.perf_counter()
            call(generation)
            seconds[name].append(time.perf_counter() - started)
    return first, {name: float(np.median(s)) for name, s in seconds.items()}


def _twin(task: data.Loop) -> Callable[[np.ndarray], np.ndarray] | None:
    """Gains (n, 3) to metrics (5, n) in C, or None without a compiler."""
    c_metrics = c_twin("pid", "pid_metrics")
    if c_metrics is None:
        return None
    r, inductance, k, b, j = task.motor
    big = np.array([[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0.0], [0.0, 0.0, 0.0]])
    held = expm(big * float(task.period))
    a, drive = np.ascontiguousarray(held[:2, :2]), np.ascontiguousarray(held[:2, 2])
    numbers = [float(v) for v in (task.period, task.set_point, task.counts, task.volts)]

    def metrics(gains: np.ndarray) -> np.ndarray:
        out = np.empty((5, len(gains)))
        c_metrics(len(gains), int(task.steps), *numbers, a, drive, np.ascontiguousarray(gains.T), out)
        return out

    return metrics
