"""Does the diagnosis name what is missing? Plants with one planted fault, and clean ones, fitted with the model that lacks it.

    python -m benchmarks.diagnosis [--seeds 1] [--clean 5] [--first-seed 0] [--plants first,second,motor,tanks] [--faults dead_time,coulomb]

The truth is simulated here by Runge-Kutta steps of a twentieth of a sample, with code that shares nothing with plantfit. A fault counts as
named where the first round finds it, alone or as one of a pair that explains alike; which pairs no record of a linear plant can tell apart
is written down in `TWINS`, and naming one of them for the other counts as well.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

FINE = 20  # Runge-Kutta steps a sample
NOISES = (0.005, 0.02)  # of the spread of the output
CLEAN = "clean"


@dataclass(frozen=True)
class Plant:
    """`rate(x, u, extra)` gives dx/dt; `faults` maps each fault that the plant can have to its size, NaN for a
    level that a tenth of the fitted samples lie beyond."""

    name: str
    study: str
    states: int
    rate: Callable[[np.ndarray, float, dict[str, float]], np.ndarray]
    output: Callable[[np.ndarray], float]
    start: tuple[float, ...]
    period: float
    samples: int
    levels: tuple[float, float]
    held: int
    faults: dict[str, float]
    linear: bool = True
    extra: dict[str, float] = field(default_factory=dict)


def _first(x: np.ndarray, u: float, e: dict[str, float]) -> np.ndarray:
    return np.array([(8.0 * u - x[0]) / 0.6])


def _second(x: np.ndarray, u: float, e: dict[str, float]) -> np.ndarray:
    v = x[1]
    return np.array(
        [v, (u - 0.8 * v - 4.0 * x[0]) / 0.5 - e.get("coulomb", 0.0) * np.tanh(v / 1e-3) - e.get("quadratic", 0.0) * v * abs(v)]
    )


def _motor(x: np.ndarray, u: float, e: dict[str, float]) -> np.ndarray:
    i, w = x
    slowed = e.get("coulomb", 0.0) * np.tanh(w / 0.05) + e.get("quadratic", 0.0) * w * abs(w)
    return np.array([(u - 2.0 * i - 0.05 * w) / 0.02, (0.05 * i - 1e-4 * w) / 2e-4 - slowed])


def _tanks(x: np.ndarray, u: float, e: dict[str, float]) -> np.ndarray:
    a, b = 0.09 * np.sqrt(max(x[0], 0.0)), 0.07 * np.sqrt(max(x[1], 0.0))
    return np.array([0.06 * u - a, a - b])


_HEAD = """name = "{name}"
[recording.a]
file = "a.csv"
time = "t"
split = 0.7
[model]
"""
PLANTS = {
    "first": Plant(
        "first",
        """equations = "x' = (K*u - x)/tau; y = x"
inputs = { u = "V" }
states = { x = { unit = "degC", initial = 0 } }
outputs = { y = "degC" }
[parameters]
K = { unit = "delta_degC/V", bounds = [0.1, 100] }
tau = { unit = "s", bounds = [0.01, 10], scale = "log" }
""".replace('unit = "degC"', 'unit = "K"').replace('y = "degC"', 'y = "K"').replace("delta_degC/V", "K/V"),
        1, _first, lambda x: x[0], (0.0,), 0.05, 600, (-2.0, 3.0), 16,
        {"dead_time": 0.2, "lag": 0.15, "dead_zone": 0.4, "saturation": 2.0, "backlash": 0.3, "sensor_lag": 0.15, "offset": 2.0,
         "drift": 0.15, "sensor_high": 12.0, "sensor_low": -7.0, "start": 10.0, "outliers": 0.02},
    ),
    "second": Plant(
        "second",
        """equations = "x' = v; v' = (u - b*v - k*x)/m; y = x"
inputs = { u = "N" }
states = { x = "m", v = "m/s" }
outputs = { y = "m" }
[parameters]
m = { unit = "kg", bounds = [0.05, 5], scale = "log" }
b = { unit = "N*s/m", bounds = [0.01, 10], scale = "log" }
k = { unit = "N/m", bounds = [0.1, 50], scale = "log" }
""",
        2, _second, lambda x: x[0], (0.0, 0.0), 0.05, 600, (-3.0, 3.0), 20,
        {"dead_time": 0.12, "lag": 0.12, "dead_zone": 0.5, "saturation": 2.2, "backlash": 0.4, "sensor_lag": 0.12, "offset": 0.1,
         "drift": 0.01, "sensor_high": 0.6, "sensor_low": -0.6, "start": 0.8, "outliers": 0.02, "coulomb": 0.8, "quadratic": 1.2},
    ),
    "motor": Plant(
        "motor",
        """equations = "i' = (u - R*i - k*w)/L; w' = (k*i - b*w)/J; y = w"
inputs = { u = "V" }
states = { i = "A", w = "rad/s" }
outputs = { y = "rad/s" }
constants = { R = "2 ohm", L = "0.02 H" }
[parameters]
k = { unit = "V*s", bounds = [0.005, 0.5], scale = "log" }
b = { unit = "N*m*s", bounds = [1e-6, 1e-2], scale = "log" }
J = { unit = "kg*m^2", bounds = [1e-5, 1e-2], scale = "log" }
""",
        2, _motor, lambda x: x[1], (0.0, 0.0), 0.01, 800, (-6.0, 8.0), 25,
        {"dead_time": 0.04, "lag": 0.04, "dead_zone": 0.8, "saturation": 5.0, "backlash": 0.8, "sensor_lag": 0.04, "offset": 8.0,
         "drift": 1.5, "sensor_high": 70.0, "sensor_low": -50.0, "start": 60.0, "outliers": 0.02, "coulomb": 100.0, "quadratic": 0.03},
    ),
    "tanks": Plant(
        "tanks",
        """equations = "h1' = q*u - a1*sqrt(pos(h1)); h2' = a1*sqrt(pos(h1)) - a2*sqrt(pos(h2)); y = h2"
inputs = { u = "V" }
states = { h1 = { unit = "cm", initial = 4.0 }, h2 = { unit = "cm", initial = 6.6 } }
outputs = { y = "cm" }
[parameters]
q = { unit = "cm/s/V", bounds = [0.005, 0.5], scale = "log" }
a1 = { unit = "cm^0.5/s", bounds = [0.01, 1], scale = "log" }
a2 = { unit = "cm^0.5/s", bounds = [0.01, 1], scale = "log" }
""",
        2, _tanks, lambda x: x[1], (4.0, 6.6), 4.0, 600, (1.0, 6.0), 25,
        {"dead_time": 12.0, "lag": 15.0, "dead_zone": 0.6, "saturation": 4.5, "backlash": 0.4, "sensor_lag": 15.0, "offset": 1.0,
         "drift": 0.0006, "sensor_high": np.nan, "sensor_low": np.nan, "start": 5.0, "outliers": 0.02},
        linear=False,
    ),
}  # fmt: skip

# a linear plant with one input and one output cannot tell whether what changes the signal stands before it or behind it
TWINS = {"lag": {"sensor_lag"}, "sensor_lag": {"lag"}}
STARTED = {"first": "x", "second": "x", "motor": "w", "tanks": "h1"}
BRAKED = {"second": "v", "motor": "w"}


def simulate(plant: Plant, fault: str, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), recorded input (n,) and recorded output (n,) of a plant with a fault."""
    rng = np.random.default_rng([seed, *fault.encode(), *plant.name.encode()])
    n, h, size = plant.samples, plant.period, plant.faults.get(fault, 0.0)
    count = n // plant.held + 2
    u = np.repeat(np.round(rng.uniform(*plant.levels, count), 2), plant.held)[rng.integers(plant.held) :][:n]
    t, fine = np.arange(n) * h, h / FINE
    x = np.array(plant.start, dtype=float)
    if fault == "start":
        x[{"first": 0, "second": 0, "motor": 1, "tanks": 0}[plant.name]] += size
    extra = {fault: size} if fault in ("coulomb", "quadratic") else {}
    lagged, played, shown = u[0], u[0], plant.output(x)
    y = np.empty(n)
    rate = plant.rate
    for k in range(n):
        y[k] = shown if fault == "sensor_lag" else plant.output(x)
        for j in range(FINE):
            now = u[k]
            if fault == "dead_time":
                now = u[max(0, int(np.floor((t[k] + (j + 0.5) * fine - size) / h)))]
            elif fault == "lag":
                lagged += (now - lagged) * (1.0 - np.exp(-fine / size))
                now = lagged
            elif fault == "dead_zone":
                now = np.sign(now) * max(abs(now) - size, 0.0)
            elif fault == "saturation":
                now = min(max(now, -size), size)
            elif fault == "backlash":
                played = min(max(played, now - size), now + size)
                now = played
            a = rate(x, now, extra)
            b = rate(x + 0.5 * fine * a, now, extra)
            c = rate(x + 0.5 * fine * b, now, extra)
            x = x + fine / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + fine * c, now, extra))
            shown += (plant.output(x) - shown) * (1.0 - np.exp(-fine / size)) if fault == "sensor_lag" else 0.0
    y = y + noise * np.std(y) * rng.normal(size=n)
    if not np.isfinite(size):  # an end that the record reaches, wherever it is
        size = float(np.quantile(y[: n * 7 // 10], 0.9 if fault == "sensor_high" else 0.1))
    y += size if fault == "offset" else size * t if fault == "drift" else 0.0
    y = np.minimum(y, size) if fault == "sensor_high" else np.maximum(y, size) if fault == "sensor_low" else y
    if fault == "outliers":
        hit = rng.random(n) < size
        y[hit] += rng.choice([-1.0, 1.0], hit.sum()) * rng.uniform(1.0, 3.0, hit.sum()) * np.std(y)
    return t, u, y


def write(plant: Plant, fault: str, noise: float, seed: int, folder: Path) -> Path:
    """The recording and the study file of a plant with a fault that the model of the study lacks."""
    table = np.column_stack(simulate(plant, fault, noise, seed))
    np.savetxt(folder / "a.csv", table, delimiter=",", header="t,u,y", comments="")
    place = folder / "study.toml"
    place.write_text(_HEAD.format(name=plant.name) + plant.study, encoding="utf-8")
    return place


@dataclass(frozen=True)
class Named:
    """What was named in one case: found in the first round, the best three of it, whether the truth is among them."""

    fault: str
    found: tuple[str, ...]
    three: tuple[str, ...]
    first: bool
    among: bool
    seconds: float


def judged(plant: Plant, fault: str, noise: float, seed: int, budget: int = 1500) -> Named:
    """One case: simulated, fitted, diagnosed."""
    from plantfit.fitting import fit
    from plantfit.spec import load
    from plantfit.trust.diagnosis import diagnose

    import jax

    with tempfile.TemporaryDirectory() as folder:
        problem = load(write(plant, fault, noise, seed, Path(folder))).problem
    answer = fit(problem, budget=budget)
    began = time.perf_counter()
    d = diagnose(answer.problem, answer.best.x)
    seconds = time.perf_counter() - began
    first = d.rounds[0]
    found = [key(t.extension) for t in first.found]
    three = [key(t.extension) for t in first.trials[:3]]
    if d.outliers.named:
        found, three = ["outliers", *found], ["outliers", *three]
    own = {fault} | (TWINS.get(fault, set()) if plant.linear else set())
    names = [{n.split(" ")[0]} for n in found]
    hit = any(n & own for n in names) if fault != "outliers" else found[:1] == ["outliers"]
    if fault == CLEAN:
        hit = not found
    later = [key(t.extension) for r in d.rounds for t in r.found]
    jax.clear_caches()
    among = hit or any(n.split(" ")[0] in own for n in [*three, *later])
    return Named(fault, tuple(found), tuple(three), hit, among, seconds)


def key(extension: Any) -> str:
    """A short name of an addition."""
    return f"{extension.kind} {extension.signal}"


def cases(plants: list[str], faults: list[str], seeds: int, clean: int, first: int) -> Iterator[tuple[Plant, str, float, int]]:
    """Every plant with every fault that it can have, at both noise levels, and clean ones; seeds from `first` on."""
    for name in plants:
        plant = PLANTS[name]
        for fault in [CLEAN, *plant.faults]:
            if faults and fault not in faults:
                continue
            for noise in NOISES:
                for seed in range(clean if fault == CLEAN else seeds):
                    yield plant, fault, noise, first + seed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--clean", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--plants", default=",".join(PLANTS))
    parser.add_argument("--faults", default="")
    given = parser.parse_args()
    results: dict[str, list[Named]] = defaultdict(list)
    for plant, fault, noise, seed in cases(
        given.plants.split(","), [f for f in given.faults.split(",") if f], given.seeds, given.clean, given.first_seed
    ):
        one = judged(plant, fault, noise, seed)
        results[fault].append(one)
        mark = "first" if one.first else "among three" if one.among else "MISSED"
        print(
            f"{plant.name:7s} {fault:12s} noise {noise:<6g} seed {seed}: {mark:11s} {', '.join(one.found) or '-':40s} {one.seconds:.1f} s",
            flush=True,
        )
    print("\n| fault | records | named first | among three |\n|---|---|---|---|")
    for fault, own in results.items():
        print(f"| {fault} | {len(own)} | {sum(o.first for o in own)} | {sum(o.among for o in own)} |")
    planted = [o for f, own in results.items() if f != CLEAN for o in own]
    clean = results.get(CLEAN, [])
    if planted:
        first, among = (float(np.mean([getattr(o, k) for o in planted])) for k in ("first", "among"))
        print(f"\nnamed first {first:.1%}, among three {among:.1%} of {len(planted)}")
    if clean:
        print(f"clean records without a warning: {np.mean([o.first for o in clean]):.1%} of {len(clean)}")


if __name__ == "__main__":
    main()
