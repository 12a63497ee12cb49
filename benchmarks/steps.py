"""`python -m benchmarks.steps [--seeds 5] [--first-seed 100] [--only true|false] [--plants first] [--full]`:
a parameter, a load or an offset of a sensor that is another one from a moment on, told or not, with its moment and its
values.

The plants are those of `benchmarks.diagnosis`, which simulates the truth with code that shares nothing with plantfit.
In `TRUE` something is another one from about 45 % of the fitted part on. In `FALSE` nothing is, or something else is
missing: the faults of that benchmark, noise with a memory, a parameter that changes along a slope over a third of the
fitted part, a slow sine. Told is what a step explains of the model as it is, before any addition is tried, whether the
planted place is the first or among those that explain alike, how far the moment is off in samples, and whether
intervals hold the truth; with `--full` also what `diagnose` says in the end.
"""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.diagnosis import FINE, PLANTS, Made, Plant, write, written

SHARE, FITTED = 0.45, 0.7
TRUE: list[tuple[str, str, float]] = [
    ("first", "K", -0.15), ("first", "K", 0.4), ("first", "tau", 0.3), ("first", "load", 0.08),
    ("first", "sensor", 0.1),
    ("second", "k", 0.15), ("second", "b", 0.4), ("second", "m", 0.3), ("second", "load", 0.08),
    ("motor", "b", 1.0), ("motor", "k", -0.15), ("motor", "J", 0.5), ("motor", "load", 0.1),
    ("tanks", "a2", 0.1), ("tanks", "a1", -0.15), ("tanks", "q", -0.1), ("tanks", "sensor", 0.1),
]  # fmt: skip
LOADED = {"first": "x", "second": "v", "motor": "i", "tanks": "a"}  # the state that the input moves
OTHER = ("ramp of a parameter", "slow sine", "AR noise", "lasting swing")
FAULTS = {
    "first": (
        "clean", "coloured", "dead_time", "lag", "dead_zone", "saturation", "backlash", "sensor_lag", "offset", "drift",
        "sensor_high", "start", "change K with t", "change K with u", "dead_time+drift",
    ),
    "second": (
        "clean", "coloured", "dead_time", "coulomb", "quadratic", "stribeck", "backlash", "drift", "change b with t",
    ),
    "motor": ("coloured", "coulomb", "stribeck", "offset"),
    "tanks": ("coloured", "offset", "drift", "sensor_high"),
}  # fmt: skip
FALSE = [*((p, f) for p, own in FAULTS.items() for f in own), *((p, f) for p in ("first", "second") for f in OTHER)]
RAMPED = {"first": ("K", -0.3), "second": ("k", 0.3)}


def record(
    plant: Plant, what: str, size: float, seed: int, noise: float = 0.01, share: float = SHARE
) -> tuple[Made, float]:
    """A record in which something is another one from a moment on, and that moment in s: a parameter by `size` times
    its value, a "load" by that times the range of the input, the "sensor" by that times the deviation of y."""
    rng = np.random.default_rng([seed, *what.encode(), *plant.name.encode()])
    n, h = plant.samples, plant.period
    u = np.repeat(np.round(rng.uniform(*plant.levels, n // plant.held + 2), 2), plant.held)[rng.integers(plant.held) :][
        :n
    ]
    t, f = np.arange(n) * h, h / FINE
    at = (share * FITTED + 0.02 * rng.uniform(-1, 1)) * t[-1]
    slow = FITTED * t[-1] / 3.0

    def rate(x: np.ndarray, now: float, when: float) -> np.ndarray:
        p = dict(plant.truth)
        on = 1.0 if when >= at else 0.0
        if what == OTHER[0]:
            name, own = RAMPED[plant.name]
            p[name] *= 1.0 + own * np.clip((when - at + 0.5 * slow) / slow, 0.0, 1.0)
        elif what in p:
            p[what] *= 1.0 + size * on
        return plant.rate(x, now + (size * np.ptp(u) * on if what == "load" else 0.0), p, {})

    x, y = np.array(plant.start, dtype=float), np.empty(n)
    for k in range(n):
        y[k] = plant.output(x)
        for j in range(FINE):
            now = t[k] + j * f
            a = rate(x, u[k], now)
            b = rate(x + 0.5 * f * a, u[k], now + 0.5 * f)
            c = rate(x + 0.5 * f * b, u[k], now + 0.5 * f)
            x = x + f / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + f * c, u[k], now + f))
    s = float(np.std(y))
    y = y + (size * s * (t >= at) if what == "sensor" else 0.0)
    y = y + (0.15 * s * np.sin(2 * np.pi * 1.3 * t / t[-1]) if what == OTHER[1] else 0.0)
    y = y + (0.1 * s * np.sin(2 * np.pi * 9.0 * t / t[-1]) if what == OTHER[3] else 0.0)
    added = rng.normal(size=n)
    if what == OTHER[2]:
        for k in range(1, n):
            added[k] = 0.98 * added[k - 1] + 0.2 * added[k]
        added *= 5.0
    return Made(t, u, y + noise * s * added, noise * s), at


def study_of(plant: str, what: str, size: float, seed: int, folder: Path, noise: float = 0.01) -> tuple[Path, float]:
    """A study file beside its record, and the moment of the step in s, NaN where there is none."""
    if size or what in OTHER:
        made, at = record(PLANTS[plant], what, size, seed, noise)
        return written(PLANTS[plant], made, folder), at if size else np.nan
    return write(PLANTS[plant], what, noise, seed, folder), np.nan


def course_of(problem):
    """The course of a diagnosis of the model as it is."""
    from plantfit import fit
    from plantfit.trust.diagnosis.catalogue import inside_kinds
    from plantfit.trust.diagnosis.course import Course
    from plantfit.trust.diagnosis.plant.carrier import Carrier

    answer = fit(problem, budget=800)
    return Course.begun(Carrier.of(answer.problem, answer.best.x, inside_kinds(answer.problem)), lambda text: None)


def right(plant: str, what: str, place: Any) -> bool:
    """Whether a place is the planted one."""
    if what == "load":
        return place.kind == "load_step" and place.signal == LOADED[plant]
    return place.kind == "sensor_step" if what == "sensor" else place.signal == what and place.kind == "step"


def main() -> None:
    from plantfit.spec import load
    from plantfit.trust.diagnosis.plant.unmeasured import steps_of

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--only", default="")
    parser.add_argument("--plants", default="")
    parser.add_argument("--faults", default="")
    parser.add_argument("--full", action="store_true")
    given = parser.parse_args()
    cases = [(p, w, s) for p, w, s in TRUE if given.only != "false"]
    cases += [(p, w, 0.0) for p, w in FALSE if given.only != "true"]
    asked = [set(filter(None, text.split(","))) for text in (given.plants, given.faults)]
    for plant, what, size in cases:
        if any(own and name not in own for own, name in zip(asked, (plant, what), strict=True)):
            continue
        for seed in range(given.first_seed, given.first_seed + given.seeds):
            with tempfile.TemporaryDirectory() as folder:
                place, at = study_of(plant, what, size, seed, Path(folder), given.noise)
                course = course_of(load(place).problem)
                began = time.process_time()
                one = steps_of(course, course.diagnosis([]))
                took = time.process_time() - began
                end = ""
                if given.full:
                    from plantfit.trust.diagnosis import diagnose

                    d = diagnose(course.carrier.given, course.carrier.z)
                    found = [t.extension.name for t in d.found]
                    told = {"STEP": d.stepping, "walk": d.disturbed, "drift": d.drifting}
                    end = f" | in the end: {found} {' '.join(n for n, v in told.items() if v is not None)}"
            text = f"{plant:7s} {what:20s} {size:5g} {seed}: {took:4.1f} s "
            if one is None:
                print(f"{text} none{end}", flush=True)
                continue
            names = [f"{s.place.name} at {s.at:.4g} [{s.within[0]:.4g}, {s.within[1]:.4g}]" for s in one.steps]
            own = [s for s in one.steps if right(plant, what, s.place)]
            told = "FIRST" if right(plant, what, one.steps[0].place) else "among" if own else "WRONG"
            held = ""
            if own:
                off, h = own[0].at - at, PLANTS[plant].period
                held = f"off {off / h:+.2f} samples, in {own[0].within[0] <= at <= own[0].within[1]}"
                before, behind = own[0].before, own[0].behind
                if before is not None and behind is not None:
                    v = PLANTS[plant].truth[what]
                    z = (
                        (before[0] - v) / before[1],
                        (behind[0] - v * (1 + size)) / behind[1],
                    )
                    held += f", z {z[0]:.1f} {z[1]:.1f}"
            print(f"{text} {told} {one.explains:.3f} x{one.times:.2f} {held} {names}{end}", flush=True)


if __name__ == "__main__":
    main()
