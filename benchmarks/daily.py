"""`python -m benchmarks.daily [--seeds 20] [--first-seed 100]`: a pattern that repeats every day and that no input
shows, told or not, and the parameters beside it.

A house of two capacities with a heater, the temperature of its room and that outdoors measured, every quarter of an
hour for six days, with noise of 0.05 K. In `TRUE` sun heats the room or its envelope, behind clouds that differ from
day to day, or the sensor errs by a cosine of a day; in `FALSE` nothing, or something else, is missing. The truth is
simulated by Euler steps of a minute, with code that shares nothing with plantfit. Counted are the records in which a
pattern is told of the model as it is, before any addition is tried, the median error of the parameters by least squares
and beside it, and how often their stated 95 % intervals hold the truth.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

DAY, PERIOD, FINE = 86400.0, 900.0, 15
TRUTH = {"Ria": 0.004, "Rie": 0.0015, "Rea": 0.003, "Ci": 4e6, "Ce": 3e7}  # K/W, J/K
STUDY = """name = "house"
[recording.a]
file = "a.csv"
time = "t"
split = 0.7
[model]
equations = "Ti' = ((Te - Ti)/Rie + (Ta - Ti)/Ria + P)/Ci; Te' = ((Ti - Te)/Rie + (Ta - Te)/Rea)/Ce; y = Ti"
inputs = { Ta = "degC", P = "W" }
states = { Ti = { unit = "degC", initial = "y" }, Te = { unit = "degC", initial = "Te0" } }
outputs = { y = "degC" }
hold = { Ta = "linear", P = "previous" }
[parameters]
Ria = { unit = "K/W", bounds = [1e-4, 1e-1], scale = "log" }
Rie = { unit = "K/W", bounds = [1e-4, 1e-1], scale = "log" }
Rea = { unit = "K/W", bounds = [1e-4, 1e-1], scale = "log" }
Ci = { unit = "J/K", bounds = [1e5, 1e8], scale = "log" }
Ce = { unit = "J/K", bounds = [1e6, 1e9], scale = "log" }
Te0 = { unit = "degC", bounds = [0, 40] }
"""

TRUE: dict[str, dict[str, Any]] = {
    "sun on the room": {"sun": "Ti"},
    "sun on the room, a clear sky": {"sun": "Ti", "clouds": 0.0},
    "sun on the room, clouds up to 60 %": {"sun": "Ti", "clouds": 0.6},
    "sun on the room, twelve days": {"sun": "Ti", "days": 12},
    "sun on the room, 0.3 times": {"sun": "Ti", "size": 0.3},
    "sun on the envelope": {"sun": "Te"},
    "sensor": {"fault": "sensor"},
    "sensor, 0.3 times": {"fault": "sensor", "size": 0.3},
}
FALSE: dict[str, dict[str, Any]] = {
    "nothing, white noise": {},
    "nothing, noise of 0.15 K with a memory of 5 h": {"noise": 0.15, "memory": 0.95},
    "nothing, noise of 0.4 K with a memory of 5 h": {"noise": 0.4, "memory": 0.95},
    **{f: {"fault": f} for f in (
        "loss that grows", "dead time", "dead zone", "saturation", "slow sine", "drift", "offset", "walk", "sensor lag",
        "step of Ria", "swing of 19 h",
    )},
}  # fmt: skip


def record(seed: int, sun: str = "", clouds: float = 0.3, size: float = 1.0, days: int = 6, noise: float = 0.05,
           memory: float = 0.0, fault: str = "") -> tuple[np.ndarray, ...]:  # fmt: skip
    """Times (n,) s, outdoor temperature (n,) degC, heater (n,) W and room temperature (n,) degC as it is measured."""
    rng, n = np.random.default_rng(seed), int(days * DAY / PERIOD)
    t, held = np.arange(n) * PERIOD, 12
    outdoors = 5.0 + 4.0 * np.sin(2 * np.pi * (t / DAY - 0.4)) + _noise(rng, n, 0.995) * 2.0
    heater = np.repeat(rng.choice([0.0, 2000.0, 4000.0], n // held + 2), held)[rng.integers(held) :][:n]
    sky = 1.0 - clouds * rng.random(days + 1)
    ti, te, y, p, h = 20.0, 17.0, np.empty(n), TRUTH, PERIOD / FINE
    for k in range(n):
        y[k] = ti
        for j in range(FINE):
            now = t[k] + j * h
            ta = np.interp(now, t[k : k + 2], outdoors[k : k + 2])
            q = 2500.0 * size * sky[int(now // DAY)] * max(0.0, np.sin(2 * np.pi * (now / DAY - 0.3))) if sun else 0.0
            u = heater[max(0, int((now - 5400.0) // PERIOD))] if fault == "dead time" else heater[k]
            u = max(u - 1200.0, 0.0) if fault == "dead zone" else min(u, 2500.0) if fault == "saturation" else u
            r = p["Ria"] / (1.0 + 0.06 * (ti - ta - 15.0)) if fault == "loss that grows" else p["Ria"]
            r = 0.75 * r if fault == "step of Ria" and now > 0.45 * days * DAY else r
            room = ((te - ti) / p["Rie"] + (ta - ti) / r + u + q * (sun == "Ti")) / p["Ci"]
            envelope = ((ti - te) / p["Rie"] + (ta - te) / p["Rea"] + q * (sun == "Te")) / p["Ce"]
            ti, te = ti + room * h, te + envelope * h
    y = y + noise * _noise(rng, n, memory)
    if fault == "sensor lag":
        shown = y[0]
        for k in range(n):
            shown += (y[k] - shown) * (1.0 - np.exp(-PERIOD / 5400.0))
            y[k] = shown
    added = {
        "slow sine": 0.8 * np.sin(2 * np.pi * 1.3 * t / (days * DAY)), "drift": 0.3 * t / DAY, "offset": 1.5,
        "walk": 0.04 * np.cumsum(rng.normal(size=n)), "sensor": 0.6 * size * np.cos(2 * np.pi * (t / DAY - 0.5)),
        "swing of 19 h": 0.6 * np.cos(2 * np.pi * t / 68400.0),
    }  # fmt: skip
    return t, outdoors, heater, y + added.get(fault, 0.0)


def _noise(rng: np.random.Generator, n: int, memory: float) -> np.ndarray:
    """Noise (n,) of standard deviation 1 in the long run, an AR(1)."""
    e, made = rng.normal(size=n), np.empty(n)
    made[0] = e[0]
    for k in range(1, n):
        made[k] = memory * made[k - 1] + np.sqrt(1.0 - memory**2) * e[k]
    return made


def write(folder: Path, seed: int, **more: Any) -> Path:
    """A record, and the study file of the house beside it."""
    rows = np.column_stack(record(seed, **more))
    np.savetxt(folder / "a.csv", rows, delimiter=",", header="t,Ta,P,y", comments="")
    place = folder / "house.toml"
    place.write_text(STUDY, encoding="utf-8")
    return place


def told(problem):
    """The answer by least squares, and what is told beside it, None where nothing is."""
    from plantfit import fit
    from plantfit.trust.diagnosis.course import Course
    from plantfit.trust.diagnosis.plant.carrier import Carrier
    from plantfit.trust.diagnosis.plant.unmeasured import repeats

    answer = fit(problem, budget=800)
    carrier = Carrier.of(answer.problem, answer.best.x, {})
    return answer, repeats(Course.begun(carrier, lambda text: None))


def main() -> None:
    from plantfit.spec import load

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=100)
    given = parser.parse_args()
    print("| record | told | with the place among them | error, least squares | beside it | 95 % intervals hold |")
    print("|---|---|---|---|---|---|")
    for name, more in {**TRUE, **FALSE}.items():
        found, placed, before, beside, held = 0, 0, [], [], []
        for seed in range(given.first_seed, given.first_seed + given.seeds):
            with tempfile.TemporaryDirectory() as folder:
                answer, one = told(load(write(Path(folder), seed, **more)).problem)
            if one is None:
                continue
            found += 1
            placed += more.get("sun", "y") in [p.signal for p in one.places]
            for n, v in TRUTH.items():
                before.append(abs(answer.values[n] / v - 1.0))
                if n in one.values:
                    beside.append(abs(one.values[n][0] / v - 1.0))
                    held.append(abs(one.values[n][0] - v) <= 1.96 * one.values[n][1])
        row = [before, beside, held] if held else []
        end = " | ".join(
            f"{100 * f(v):.{k}f} %" for v, f, k in zip(row, (np.median, np.median, np.mean), (0, 1, 0), strict=False)
        )
        end = end or " | | "
        print(f"| {name} | {found} of {given.seeds} | {placed if found else ''} | {end} |", flush=True)


if __name__ == "__main__":
    main()
