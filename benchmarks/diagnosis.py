"""Does the diagnosis name what is missing? Plants with one or two planted faults, and clean ones, fitted with the model
that lacks them.

    python -m benchmarks.diagnosis [--seeds 1] [--clean 5] [--first-seed 0] [--plants first,second,motor,tanks]
    [--faults dead_time,coulomb] [--pairs 1] [--size 0.3] [--run] [--samples 5e5] [--json FILE]

Cases that FILE holds from an earlier call are not run again, so that a long run may be stopped.

The truth is simulated here by Runge-Kutta steps of a twentieth of a sample, with code that shares nothing with
plantfit. A fault counts as named where the first round finds it, alone or as one of a pair that explains alike; which
pairs no record of a linear plant can tell apart is written down in `TWINS`, and naming one of them for the other counts
as well. Of two faults at once (`--pairs` seeds of each) both have to be named, in any of the rounds. "To the noise":
the RMSE of the fitted samples with all that was named is at most 1.1 times the noise that was added; with `--run` that
of the study file that is written, fitted anew. A cause that is called very likely and was not planted is counted apart:
it is worse than a miss. With `--samples` a diagnosis may simulate so many samples, as that of a `run` may, and
additions that are then not tried are counted. On clean records nothing may be named, outliers neither; `coloured` ones
have noise of an AR(1) with a memory of ten samples. `--size` makes the faults of a kind that has a size smaller.
"""

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

FINE = 20  # Runge-Kutta steps a sample
NOISES = (0.005, 0.02)  # of the spread of the output
CLEAN, COLOURED = "clean", "coloured"
MEMORY = 10.0  # samples, of coloured noise
REACHED = 0.01  # of the fitted samples that a sensor's end has to cut
NEAR = 1.1  # times the noise that was added: what a fit may leave


@dataclass(frozen=True)
class Plant:
    """`rate(x, u, p, extra)` gives dx/dt with parameters p, those of `truth`; `faults` maps each fault that the
    plant can have to its size, NaN for a level that a tenth of the fitted samples lie beyond, and of a parameter
    that changes, as in "change K with u", to how much of it for each unit, from the `references` of what it changes
    with on."""

    name: str
    study: str
    states: int
    rate: Callable[[np.ndarray, float, dict[str, float], dict[str, float]], np.ndarray]
    truth: dict[str, float]
    output: Callable[[np.ndarray], float]
    start: tuple[float, ...]
    period: float
    samples: int
    levels: tuple[float, float]
    held: int
    faults: dict[str, float]
    linear: bool = True
    references: dict[str, float] = field(default_factory=dict)
    drivers: tuple[str, ...] = ("x",)


def _first(x: np.ndarray, u: float, p: dict[str, float], e: dict[str, float]) -> np.ndarray:
    return np.array([(p["K"] * u - x[0]) / p["tau"]])


def _second(x: np.ndarray, u: float, p: dict[str, float], e: dict[str, float]) -> np.ndarray:
    v = x[1]
    return np.array([v, (u - p["b"] * v - p["k"] * x[0]) / p["m"] - _slowed(v, e, 1e-3, 0.1)])


def _motor(x: np.ndarray, u: float, p: dict[str, float], e: dict[str, float]) -> np.ndarray:
    i, w = x
    return np.array([(u - 2.0 * i - p["k"] * w) / 0.02, (p["k"] * i - p["b"] * w) / p["J"] - _slowed(w, e, 0.05, 6.0)])


def _tanks(x: np.ndarray, u: float, p: dict[str, float], e: dict[str, float]) -> np.ndarray:
    a, b = p["a1"] * np.sqrt(max(x[0], 0.0)), p["a2"] * np.sqrt(max(x[1], 0.0))
    return np.array([p["q"] * u - a, a - b])


def _slowed(v: float, e: dict[str, float], sign: float, falls: float) -> float:
    """Friction over inertia at a speed: dry, that which falls within `falls`, and by the square."""
    dry = e.get("coulomb", 0.0) + e.get("stribeck", 0.0) * np.exp(-((v / falls) ** 2))
    return dry * np.tanh(v / sign) + e.get("quadratic", 0.0) * v * abs(v)


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
        1, _first, {"K": 8.0, "tau": 0.6}, lambda x: x[0], (0.0,), 0.05, 600, (-2.0, 3.0), 16,
        {"dead_time": 0.2, "lag": 0.15, "dead_zone": 0.4, "saturation": 2.0, "backlash": 0.3, "sensor_lag": 0.15,
         "input_offset": 0.25,
         "offset": 2.0,
         "drift": 0.15, "sensor_high": 12.0, "sensor_low": -7.0, "start": 10.0, "outliers": 0.02,
         "change K with u": 0.12, "change K with t": 0.012, "change tau with x": 0.03, "change tau with t": -0.02},
        references={"u": 0.5, "x": 4.0},
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
        2, _second, {"m": 0.5, "b": 0.8, "k": 4.0}, lambda x: x[0], (0.0, 0.0), 0.05, 600, (-3.0, 3.0), 20,
        {"dead_time": 0.12, "lag": 0.12, "dead_zone": 0.5, "saturation": 2.2, "backlash": 0.4, "sensor_lag": 0.12,
         "input_offset": 0.25,
         "offset": 0.1,
         "drift": 0.01, "sensor_high": 0.6, "sensor_low": -0.6, "start": 0.8, "outliers": 0.02, "coulomb": 0.8,
         "quadratic": 1.2,
         "stribeck": 1.5, "change k with x": 0.2, "change b with t": 0.03, "change m with t": 0.015,
         "change k with t": -0.01},
        drivers=("x", "v"),
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
        2, _motor, {"k": 0.05, "b": 1e-4, "J": 2e-4}, lambda x: x[1], (0.0, 0.0), 0.01, 800, (-6.0, 8.0), 25,
        {"dead_time": 0.04, "lag": 0.04, "dead_zone": 0.8, "saturation": 5.0, "backlash": 0.8, "sensor_lag": 0.04,
         "input_offset": 0.5,
         "offset": 8.0,
         "drift": 1.5, "sensor_high": 70.0, "sensor_low": -50.0, "start": 60.0, "outliers": 0.02, "coulomb": 100.0,
         "quadratic": 0.03,
         "stribeck": 100.0, "change k with t": -0.03, "change J with t": 0.08, "change k with w": 0.003},
        drivers=("i", "w"),
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
        2, _tanks, {"q": 0.06, "a1": 0.09, "a2": 0.07}, lambda x: x[1], (4.0, 6.6), 4.0, 600, (1.0, 6.0), 25,
        {"dead_time": 12.0, "lag": 15.0, "dead_zone": 0.6, "saturation": 4.5, "backlash": 0.4, "sensor_lag": 15.0,
         "input_offset": 0.3,
         "offset": 1.0,
         "drift": 0.0006, "sensor_high": np.nan, "sensor_low": np.nan, "start": 5.0, "outliers": 0.02,
         "change q with u": 0.06, "change q with t": -0.0002, "change a2 with t": 0.0002, "change a1 with t": 0.0003},
        linear=False, references={"u": 3.5}, drivers=("h1", "h2"),
    ),
}  # fmt: skip

# a linear plant with one input and one output cannot tell whether what changes the signal stands before it or behind it
TWINS = {"lag": {"sensor_lag"}, "sensor_lag": {"lag"}}
STARTED = {"first": "x", "second": "x", "motor": "w", "tanks": "h1"}
BRAKED = {"second": "v", "motor": "w"}


# two at once, of plants that can have both
PAIRS = {
    "first": (
        "dead_time+drift",
        "dead_time+outliers",
        "dead_zone+offset",
        "saturation+lag",
        "dead_time+sensor_high",
        "dead_time+change K with t",
    ),
    "second": ("dead_time+drift", "coulomb+offset", "dead_time+outliers", "backlash+start", "coulomb+dead_time"),
    "motor": (
        "coulomb+offset",
        "dead_time+drift",
        "quadratic+dead_time",
        "saturation+outliers",
        "coulomb+sensor_lag",
        "coulomb+stribeck",
        "change k with t+offset",
    ),
    "tanks": ("dead_time+drift", "dead_zone+offset", "saturation+outliers", "lag+start", "dead_time+sensor_high"),
}


@dataclass(frozen=True)
class Made:
    """Times (n,), recorded input (n,) and recorded output (n,) of a plant, and the RMS of the noise in its fitted
    part."""

    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    noise: float


def simulate(plant: Plant, fault: str, noise: float, seed: int, share: float = 1.0) -> Made:
    """A record of a plant with a fault, or with two as in "dead_time+drift", of `share` times their usual size."""
    rng = np.random.default_rng([seed, *fault.encode(), *plant.name.encode()])
    n, h, sizes = plant.samples, plant.period, {f: _size(plant, f, share) for f in fault.split("+")}
    count = n // plant.held + 2
    u = np.repeat(np.round(rng.uniform(*plant.levels, count), 2), plant.held)[rng.integers(plant.held) :][:n]
    t, fine = np.arange(n) * h, h / FINE
    x = np.array(plant.start, dtype=float)
    if "start" in sizes:
        x[{"first": 0, "second": 0, "motor": 1, "tanks": 0}[plant.name]] += sizes["start"]
    extra = {f: s for f, s in sizes.items() if f in ("coulomb", "quadratic", "stribeck")}
    changing = [(*f.removeprefix("change ").split(" with "), s) for f, s in sizes.items() if f.startswith("change ")]
    lagged, played, shown = u[0], u[0], plant.output(x)
    y = np.empty(n)

    def rate(x: np.ndarray, now: float, at: float) -> np.ndarray:
        p = dict(plant.truth)
        for subject, driver, size in changing:
            seen = {"u": now, "t": at, **dict(zip(plant.drivers, x, strict=True))}[driver]
            p[subject] *= 1.0 + size * (seen - plant.references.get(driver, 0.0))
        return plant.rate(x, now, p, extra)

    for k in range(n):
        y[k] = shown if "sensor_lag" in sizes else plant.output(x)
        for j in range(FINE):
            now = u[k]
            if "dead_time" in sizes:
                now = u[max(0, int(np.floor((t[k] + (j + 0.5) * fine - sizes["dead_time"]) / h)))]
            if "input_offset" in sizes:
                now -= sizes["input_offset"]
            if "saturation" in sizes:
                now = min(max(now, -sizes["saturation"]), sizes["saturation"])
            if "dead_zone" in sizes:
                now = np.sign(now) * max(abs(now) - sizes["dead_zone"], 0.0)
            if "backlash" in sizes:
                played = min(max(played, now - sizes["backlash"]), now + sizes["backlash"])
                now = played
            if "lag" in sizes:
                lagged += (now - lagged) * (1.0 - np.exp(-fine / sizes["lag"]))
                now = lagged
            begin = t[k] + j * fine
            a = rate(x, now, begin)
            b = rate(x + 0.5 * fine * a, now, begin + 0.5 * fine)
            c = rate(x + 0.5 * fine * b, now, begin + 0.5 * fine)
            x = x + fine / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + fine * c, now, begin + fine))
            shown += (
                (plant.output(x) - shown) * (1.0 - np.exp(-fine / sizes["sensor_lag"]))
                if "sensor_lag" in sizes
                else 0.0
            )
    added = noise * float(np.std(y)) * _noise(rng, n, fault == COLOURED)
    y = y + added
    y += sizes.get("offset", 0.0) + sizes.get("drift", 0.0) * t
    for end, quantile, cut in (("sensor_high", 0.9, np.minimum), ("sensor_low", 0.1, np.maximum)):
        if (
            end in sizes
        ):  # without a level of its own, or with one that the fitted part does not reach, an end that it reaches
            level, fitted = sizes[end], y[: n * 7 // 10]
            reached = np.isfinite(level) and np.mean(cut(fitted, level) != fitted) >= REACHED
            y = cut(y, level if reached else float(np.quantile(fitted, quantile)))
    if "outliers" in sizes:
        hit = rng.random(n) < sizes["outliers"]
        y[hit] += rng.choice([-1.0, 1.0], hit.sum()) * rng.uniform(1.0, 3.0, hit.sum()) * np.std(y)
    return Made(t, u, y, float(np.sqrt(np.mean(added[: n * 7 // 10] ** 2))))


LEVELS = ("saturation", "sensor_high", "sensor_low")  # a smaller fault is not a smaller number there


def _size(plant: Plant, fault: str, share: float) -> float:
    return plant.faults.get(fault, 0.0) * (1.0 if fault in (*LEVELS, "outliers") else share)


def _noise(rng: np.random.Generator, n: int, coloured: bool) -> np.ndarray:
    """Noise (n,) of standard deviation 1."""
    white = rng.normal(size=n)
    if not coloured:
        return white
    memory, made = np.exp(-1.0 / MEMORY), np.empty(n)
    last = rng.normal()
    for k in range(n):
        last = memory * last + np.sqrt(1.0 - memory**2) * white[k]
        made[k] = last
    return made


def write(plant: Plant, fault: str, noise: float, seed: int, folder: Path, share: float = 1.0) -> Path:
    """The recording and the study file of a plant with a fault that the model of the study lacks."""
    return written(plant, simulate(plant, fault, noise, seed, share), folder)


def written(plant: Plant, made: Made, folder: Path) -> Path:
    """A record as a file, and the study file of the plant beside it."""
    np.savetxt(folder / "a.csv", np.column_stack([made.t, made.u, made.y]), delimiter=",", header="t,u,y", comments="")
    place = folder / "study.toml"
    place.write_text(_HEAD.format(name=plant.name) + plant.study, encoding="utf-8")
    return place


@dataclass(frozen=True)
class Named:
    """What was named in one case: what was planted, found in the first round and in later ones, the best three of the
    first.

    `first`: the first round names the fault, of two one of them; `among`: it is among the three, or named later; `all`:
    every planted one is named in some round. `wrong`: what was called very likely and was not planted. `left`: RMSE
    with what was named, in units of the noise that was added. `seconds` of processor time of the diagnosis. `untried`
    additions of the first round.
    """

    plant: str
    fault: str
    noise: float
    seed: int
    found: tuple[str, ...]
    later: tuple[str, ...]
    three: tuple[str, ...]
    first: bool
    among: bool
    all: bool
    wrong: tuple[str, ...]
    left: float
    seconds: float
    untried: int = 0

    @property
    def clean(self) -> bool:
        return self.fault in (CLEAN, COLOURED)


def judged(
    plant: Plant, fault: str, noise: float, seed: int, share: float = 1.0, run: bool = False, budget: int = 1500,
    samples: float = np.inf,
) -> Named:  # fmt: skip
    """One case: simulated, fitted, diagnosed by simulations of so many samples at most; with `run` the study file that
    is proposed is fitted, too."""
    from plantfit.fitting import fit
    from plantfit.trust.diagnosis import Meter, diagnose, diagnosis_record

    made = simulate(plant, fault, noise, seed, share)
    with tempfile.TemporaryDirectory() as folder:
        study, problem = _problem(plant, made, Path(folder))
        answer = fit(problem, budget=budget)
        began = time.process_time()
        d = diagnose(answer.problem, answer.best.x, meter=Meter(samples / len(made.t)))
        seconds = time.process_time() - began
        left = (
            _run(study, d, Path(folder), budget) if run and (d.found or d.outliers.named) else _fitted(d)
        ) / made.noise
    named = [[key(t.extension) for t in r.found] for r in d.rounds if r.found] or [[]]
    found, later, three = (
        named[0],
        [n for own in named[1:] for n in own],
        [key(t.extension) for t in d.rounds[0].trials[:3]],
    )
    told = [r["likely"] for r in diagnosis_record(d)["rounds"] if r["found"]]
    very = [own for own, likely in zip(named, told, strict=False) if likely == "very likely"]
    if d.outliers.named:
        found, three = ["outliers", *found], ["outliers", *three]
        very.append(["outliers"])
    own = [_allowed(plant, f) for f in fault.split("+")] if fault not in (CLEAN, COLOURED) else []
    hits = [
        [any(_is(n, names) for n in where) for names in own]
        for where in (found, [*found, *three, *later], [*found, *later])
    ]
    wrong = [" or ".join(names) for names in very if not any(_is(n, o) for n in names for o in own)]
    first, among, every = (any(hits[0]), all(hits[1]), all(hits[2])) if own else (not found, not found, not found)
    return Named(
        plant.name,
        fault,
        noise,
        seed,
        tuple(found),
        tuple(later),
        tuple(three),
        first,
        among,
        every,
        tuple(wrong),
        float(left),
        seconds,
        len(d.rounds[0].untried),
    )


_LAST: dict[
    str, tuple[Any, Any]
] = {}  # by plant its study, and the problem of the last record, whose compiled functions serve the next


def _problem(plant: Plant, made: Made, folder: Path) -> tuple[Any, Any]:
    """The study file, and the problem of a record."""
    from plantfit.recording import Recording, Signal
    from plantfit.spec import load

    place = written(plant, made, folder)
    if plant.name not in _LAST:
        study = load(place)
        _LAST[plant.name] = study, study.problem
    study, last = _LAST[plant.name]
    old = last.experiments["a"].recording
    values = {"u": made.u, "y": made.y}
    fresh = Recording(made.t, {n: Signal(values[n], s.unit) for n, s in old.signals.items() if n in values}, "a")
    problem = last.with_recordings({"a": fresh})
    _LAST[plant.name] = study, problem
    return study, problem


def _is(named: str, faults: set[str]) -> bool:
    """Whether what was named is one of these faults; a change is one of a certain parameter with a certain signal."""
    return (named if named.startswith("change ") else named.split(" ")[0]) in faults


def _allowed(plant: Plant, fault: str) -> set[str]:
    """What a fault may be called."""
    return {fault} | (TWINS.get(fault, set()) if plant.linear else set())


def _fitted(d: Any) -> float:
    """RMSE of the fitted samples without outliers, with all that was named."""
    end = d.found[-1].at if d.found else d.base
    at = d.carrier.rows.fit & ~d.apart
    return float(np.sqrt(np.mean(end.residuals[at] ** 2))) * d.carrier.given.scales["y"]


def _run(study: Any, d: Any, folder: Path, budget: int) -> float:
    """The same of the study file that is written, fitted from nothing."""
    from plantfit.fitting import fit
    from plantfit.spec import load, with_additions
    from plantfit.trust.diagnosis import changed, clean_steps

    place = folder / "proposed.toml"
    place.write_text(with_additions(study.text, study.path, changed(d), clean_steps(d), "proposed"), encoding="utf-8")
    answer = fit(load(place).problem, budget=budget)
    e = answer.problem.experiments["a"]
    error = (answer.simulated["a"]["y"] - e.recording["y"])[e.mask("fit")]
    return float(np.sqrt(np.nanmean(error**2)))


def key(extension: Any) -> str:
    """A short name of an addition."""
    return f"{extension.kind} {extension.signal}"


Case = tuple[Plant, str, float, int]


def cases(plants: list[str], faults: list[str], seeds: int, clean: int, first: int, pairs: int = 0) -> Iterator[Case]:
    """Every plant with every fault that it can have, at both noise levels, and clean ones; seeds from `first` on."""
    for name in plants:
        plant = PLANTS[name]
        counts = {
            CLEAN: clean,
            COLOURED: clean,
            **dict.fromkeys(plant.faults, seeds),
            **dict.fromkeys(PAIRS[name], pairs),
        }
        for fault, count in counts.items():
            if faults and fault not in faults:
                continue
            for noise in NOISES:
                for seed in range(count):
                    yield plant, fault, noise, first + seed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--clean", type=int, default=5)
    parser.add_argument("--pairs", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--plants", default=",".join(PLANTS))
    parser.add_argument("--faults", default="")
    parser.add_argument("--size", type=float, default=1.0)
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--samples", type=float, default=np.inf)
    parser.add_argument("--json", default="")
    given = parser.parse_args()
    kept = {(o.plant, o.fault, o.noise, o.seed): o for o in _read(given.json)}
    results: dict[str, list[Named]] = defaultdict(list)
    asked = [f for f in given.faults.split(",") if f]
    for plant, fault, noise, seed in cases(
        given.plants.split(","), asked, given.seeds, given.clean, given.first_seed, given.pairs
    ):
        which = (plant.name, fault, noise, seed)
        if which not in kept:
            kept[which] = judged(plant, fault, noise, seed, given.size, given.run, samples=given.samples)
            if given.json:
                Path(given.json).write_text(json.dumps([asdict(o) for o in kept.values()], indent=1), encoding="utf-8")
        results[fault].append(kept[which])
        tell(kept[which])
    summary(results)


def _read(file: str) -> list[Named]:
    """The cases of a file that an earlier call has begun."""
    if not file or not Path(file).exists():
        return []
    rows: list[dict[str, Any]] = json.loads(Path(file).read_text(encoding="utf-8"))
    made = []
    for row in rows:
        lists: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}
        made.append(Named(**lists))
    return made


def tell(one: Named) -> None:
    """One line for one case."""
    named = one.first if one.clean else one.all if "+" in one.fault else one.first
    mark = "named" if named else "among three" if one.among else "MISSED"
    found = ", ".join(one.found) or "-"
    then = f" then {', '.join(one.later)}" if one.later else ""
    wrong = f" WRONG: very likely {'; '.join(one.wrong)}" if one.wrong else ""
    print(
        f"{one.plant:7s} {one.fault:20s} noise {one.noise:<6g} seed {one.seed}: {mark:11s} {found + then:44s} "
        f"{one.left:5.2f} x noise "
        f"{one.seconds:.1f} s{wrong}",
        flush=True,
    )


def summary(results: dict[str, list[Named]]) -> None:
    """The tables of all cases."""
    print(
        "\n| fault | records | named first | among three | both or all named | to the noise "
        "|\n|---|---|---|---|---|---|"
    )
    for fault, own in results.items():
        counts = " | ".join(str(sum(getattr(o, k) for o in own)) for k in ("first", "among", "all"))
        print(f"| {fault} | {len(own)} | {counts} | {sum(o.left <= NEAR for o in own)} |")
    every = [o for own in results.values() for o in own]
    for what, own in (
        ("one fault", [o for o in every if not o.clean and "+" not in o.fault]),
        ("two faults", [o for o in every if "+" in o.fault]),
        (CLEAN, results.get(CLEAN, [])),
        (COLOURED, results.get(COLOURED, [])),
    ):
        if not own:
            continue
        shares = [f"{np.mean([getattr(o, k) for o in own]):.1%}" for k in ("first", "among", "all")]
        near, wrong = np.mean([o.left <= NEAR for o in own]), sum(bool(o.wrong) for o in own)
        head = f"{what}: {len(own)} records, median {np.median([o.seconds for o in own]):.1f} s"
        told = (
            f"without a warning {shares[0]}"
            if own[0].clean
            else f"first {shares[0]}, among three {shares[1]}, all {shares[2]}"
        )
        untried = sum(o.untried for o in own)
        more = f"; {untried} additions not tried" if untried else ""
        print(f"{head}; {told}; to the noise {near:.1%}; a false very likely in {wrong}{more}")


if __name__ == "__main__":
    main()
