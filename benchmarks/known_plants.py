"""`python -m benchmarks.known_plants --records 30 --rows rows.jsonl`: plants whose identifiability is published.

Each record is simulated by scipy and gets white noise; it is fitted as a user would, from a box of decades and with
nothing known. For every parameter: how often it is called determined, how often its interval then holds the truth, and
how often its range does. "known by theory" is what such a record determines; the rest is known in combinations, or may
change places with others.

R. Bellman, K. J. Astrom, Math. Biosci. 7 (1970) 329 (compartments); K. Godfrey, Compartmental Models and Their
Application, Academic Press 1983 (oral dose, whose rates change places together with the volume); N. D. Evans et al.,
Math. Biosci. 194 (2005) 175 (epidemics seen in part); R. N. Bergman et al., Am. J. Physiol. 236 (1979) E667 (glucose);
J. O. Ramsay et al., J. R. Stat. Soc. B 69 (2007) 741 (FitzHugh-Nagumo, a cost with many optima).
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import plantfit as pf

DAY, HOUR = 86400.0, 3600.0


@dataclass(frozen=True)
class Plant:
    """Equations, what a record of it is, and what is known from it.

    `rate(x, u, p)` gives the derivatives of the states from `begin(p)` on, `outputs(x, p)` (k, n) what is measured,
    with white noise of `noise` (k,). `drive(rng, t)` gives inputs by name, held from sample to sample. Parameters are
    searched in decades but those with a pair in `plain`. `known` are determined by theory, `combinations` beside them.
    """

    text: str
    outputs_named: tuple[str, ...]
    states: Mapping[str, Any]
    truth: Mapping[str, float]
    decades: Mapping[str, tuple[float, float]]
    times: np.ndarray
    rate: Callable[[np.ndarray, Mapping[str, float], Mapping[str, float]], list]
    begin: Callable[[Mapping[str, float]], list[float]]
    outputs: Callable[[np.ndarray, Mapping[str, float]], Any]
    noise: tuple[float, ...]
    known: tuple[str, ...]
    combinations: tuple[str, ...] = ()
    plain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    alike: tuple[str, ...] = ()  # may change places: named by their size, as in the truth
    drive: Callable[[np.random.Generator, np.ndarray], dict[str, np.ndarray]] | None = None

    def problem(self, seed: int) -> pf.Problem:
        """One record, and the box."""
        rng, t, p = np.random.default_rng(seed), self.times, self.truth
        inputs = self.drive(rng, t) if self.drive else {}
        step = float(t[1] - t[0])

        def rate(s: float, x: np.ndarray) -> list:
            k = min(int((s - t[0]) / step + 1e-9), len(t) - 1)
            return self.rate(x, {n: u[k] for n, u in inputs.items()}, p)

        # no step of the solver passes over what an input does
        x = solve_ivp(
            rate, (t[0], t[-1]), self.begin(p), t_eval=t, method="LSODA", rtol=1e-8, atol=1e-11, max_step=step
        )
        y = np.atleast_2d(self.outputs(x.y, p))
        y = y + np.array(self.noise)[:, None] * rng.normal(size=y.shape)
        model = pf.equations(
            self.text, inputs=list(inputs), outputs=list(self.outputs_named), parameters=list(self.truth),
            states={n: {"initial": v} for n, v in self.states.items()},
        )  # fmt: skip
        box = {n: pf.Parameter(b, scale="log") for n, b in self.decades.items()} | dict(self.plain)
        record = {"t": t, **inputs, **dict(zip(self.outputs_named, y, strict=True))}
        return pf.Problem(model, pf.from_arrays(record), {n: box[n] for n in self.truth})


def _switched(low: float, high: float, hold: int) -> Callable[[np.random.Generator, np.ndarray], np.ndarray]:
    return lambda rng, t: np.repeat(rng.choice([low, high], size=len(t) // hold + 1), hold)[: len(t)]


def _only(name: str, of: Callable[[np.random.Generator, np.ndarray], np.ndarray]):
    return lambda rng, t: {name: of(rng, t)}


def _weather(rng: np.random.Generator, t: np.ndarray) -> dict[str, np.ndarray]:
    outside = 5 + 4 * np.sin(2 * np.pi * t / DAY) + 0.1 * np.cumsum(rng.normal(size=len(t)))
    return {"q": _switched(0.0, 1500.0, 8)(rng, t), "To": outside}


def _voltages(rng: np.random.Generator, t: np.ndarray) -> dict[str, np.ndarray]:
    steps = {n: np.repeat(rng.uniform(low, 15.0, len(t) // 30), 30) for n, low in (("vd", -15.0), ("vq", -5.0))}
    return steps | {"w": 150 + 50 * np.sin(2 * np.pi * t * 15)}


def _epidemic(n: str, known: tuple[str, ...], combinations: tuple[str, ...] = ()) -> Plant:
    """Susceptible and infected of n people, of whom the share k is seen."""
    own = {"N": 10000.0} if n == "N" else {}
    return Plant(
        f"S' = -beta*S*I/{n}\nI' = beta*S*I/{n} - gamma*I\ny = k*I",
        ("y",), {"S": f"{n} - I0", "I": "I0"},
        {"beta": 0.5 / DAY, "gamma": 0.2 / DAY, "k": 0.3, "I0": 10.0} | own,
        {"beta": (1e-7, 1e-4), "gamma": (1e-7, 1e-4), "k": (1e-3, 1.0), "I0": (0.1, 1e3), "N": (1e3, 1e6)},
        np.arange(70) * DAY,
        lambda x, u, p: [-p["beta"] * x[0] * x[1] / 1e4, p["beta"] * x[0] * x[1] / 1e4 - p["gamma"] * x[1]],
        lambda p: [1e4 - p["I0"], p["I0"]], lambda x, p: p["k"] * x[1], (8.0,), known, combinations,
    )  # fmt: skip


def _enzyme(substrate: float, noise: float, known: tuple[str, ...]) -> Plant:
    return Plant(
        "S' = -Vm*S/(Km + S)\ny = S", ("y",), {"S": substrate},
        {"Vm": 0.02, "Km": 2.0}, {"Vm": (1e-5, 100.0), "Km": (1e-3, 1e4)}, np.arange(80) * 10.0,
        lambda x, u, p: [-p["Vm"] * x[0] / (p["Km"] + x[0])], lambda p: [substrate], lambda x, p: x[0], (noise,), known,
    )  # fmt: skip


def _growth(until: float, noise: float, known: tuple[str, ...]) -> Plant:
    return Plant(
        "N' = r*N*(1 - N/K)\ny = N", ("y",), {"N": "N0"},
        {"r": 0.5, "K": 50.0, "N0": 0.2}, {"r": (0.01, 10.0), "K": (0.1, 1e4), "N0": (1e-3, 10.0)},
        np.linspace(0.0, until, 100),
        lambda x, u, p: [p["r"] * x[0] * (1 - x[0] / p["K"])], lambda p: [p["N0"]], lambda x, p: x[0], (noise,), known,
    )  # fmt: skip


PLANTS = {
    "oral dose": Plant(
        "g' = -ka*g\nx' = ka*g - ke*x\nc = x/V", ("c",), {"g": 500.0, "x": 0.0},
        {"ka": 1.5e-3, "ke": 2.5e-4, "V": 20.0}, {"ka": (1e-5, 0.1), "ke": (1e-5, 0.1), "V": (1.0, 1e3)},
        np.arange(60) * 300.0,
        lambda x, u, p: [-p["ka"] * x[0], p["ka"] * x[0] - p["ke"] * x[1]], lambda p: [500.0, 0.0],
        lambda x, p: x[1] / p["V"], (0.2,), (),
    ),
    "two compartments": Plant(
        "a' = -(k12 + k10)*a + k21*b + u\nb' = k12*a - k21*b\nc = a/V", ("c",), {"a": 0.0, "b": 0.0},
        {"k12": 8e-4, "k21": 5e-4, "k10": 4e-4, "V": 12.0},
        {"k12": (1e-6, 0.1), "k21": (1e-6, 0.1), "k10": (1e-6, 0.1), "V": (1.0, 1e3)}, np.arange(150) * 120.0,
        lambda x, u, p: [-(p["k12"] + p["k10"]) * x[0] + p["k21"] * x[1] + u["u"], p["k12"] * x[0] - p["k21"] * x[1]],
        lambda p: [0.0, 0.0], lambda x, p: x[0] / p["V"], (0.3,), ("k12", "k21", "k10", "V"),
        drive=_only("u", lambda rng, t: np.where(t < HOUR, 0.5, 0.0)),
    ),
    "enzyme, saturated": _enzyme(10.0, 0.05, ("Vm", "Km")),
    "enzyme, far from saturation": _enzyme(0.05, 5e-4, ()),
    "epidemic, share seen": _epidemic("10000", ("beta", "gamma", "k", "I0")),
    "epidemic, share and people": _epidemic("N", ("beta", "gamma"), ("k*I0", "k*N")),
    "epidemic with incubation": Plant(
        "S' = -beta*S*I/10000\nE' = beta*S*I/10000 - sigma*E\nI' = sigma*E - gamma*I\ny = I", ("y",),
        {"S": "10000 - E0", "E": "E0", "I": 0.0},
        {"beta": 0.6 / DAY, "sigma": 0.4 / DAY, "gamma": 0.15 / DAY, "E0": 20.0},
        {"beta": (1e-7, 1e-4), "sigma": (1e-7, 1e-4), "gamma": (1e-7, 1e-4), "E0": (0.1, 1e3)}, np.arange(90) * DAY,
        lambda x, u, p: [
            -p["beta"] * x[0] * x[2] / 1e4, p["beta"] * x[0] * x[2] / 1e4 - p["sigma"] * x[1],
            p["sigma"] * x[1] - p["gamma"] * x[2],
        ],
        lambda p: [1e4 - p["E0"], p["E0"], 0.0], lambda x, p: x[2], (25.0,), ("beta", "gamma", "E0"),
    ),
    "predator and prey, prey seen": Plant(
        "x' = a*x - b*x*z\nz' = -c*z + d*x*z\ny = x", ("y",), {"x": 10.0, "z": "z0"},
        {"a": 1.0, "b": 0.1, "c": 1.5, "d": 0.075, "z0": 5.0},
        {"a": (0.1, 10.0), "b": (1e-3, 10.0), "c": (0.1, 10.0), "d": (1e-3, 10.0), "z0": (0.1, 100.0)},
        np.arange(150) * 0.1,
        lambda x, u, p: [p["a"] * x[0] - p["b"] * x[0] * x[1], -p["c"] * x[1] + p["d"] * x[0] * x[1]],
        lambda p: [10.0, p["z0"]], lambda x, p: x[0], (0.4,), ("a", "c", "d"), ("b*z0",),
    ),
    "predator and prey, 12 cycles": Plant(
        "x' = a*x - b*x*z\nz' = -c*z + d*x*z\ny = x\nw = z", ("y", "w"), {"x": 10.0, "z": 5.0},
        {"a": 1.0, "b": 0.1, "c": 1.5, "d": 0.075},
        {"a": (0.01, 20.0), "b": (1e-3, 10.0), "c": (0.01, 20.0), "d": (1e-3, 10.0)}, np.arange(400) * 0.2,
        lambda x, u, p: [p["a"] * x[0] - p["b"] * x[0] * x[1], -p["c"] * x[1] + p["d"] * x[0] * x[1]],
        lambda p: [10.0, 5.0], lambda x, p: x, (0.5, 0.5), ("a", "b", "c", "d"),
    ),
    "mass under a force": Plant(
        "x' = v\nv' = (F - c*v - k*x)/m\ny = x", ("y",), {"x": 0.0, "v": 0.0}, {"m": 2.0, "c": 3.0, "k": 200.0}, {},
        np.arange(400) * 0.01, lambda x, u, p: [x[1], (u["F"] - p["c"] * x[1] - p["k"] * x[0]) / p["m"]],
        lambda p: [0.0, 0.0], lambda x, p: x[0], (3e-3,), ("m", "c", "k"),
        plain={"m": (0.1, 50.0), "c": (0.0, 100.0), "k": (1.0, 5e3)}, drive=_only("F", _switched(-10.0, 10.0, 20)),
    ),
    "mass, free": Plant(
        "x' = v\nv' = (-c*v - k*x)/m\ny = x", ("y",), {"x": 0.1, "v": 0.0}, {"m": 2.0, "c": 3.0, "k": 200.0}, {},
        np.arange(300) * 0.01, lambda x, u, p: [x[1], (-p["c"] * x[1] - p["k"] * x[0]) / p["m"]],
        lambda p: [0.1, 0.0], lambda x, p: x[0], (2e-3,), (), ("c/m", "k/m"),
        plain={"m": (0.1, 50.0), "c": (0.0, 100.0), "k": (1.0, 5e3)},
    ),
    "house": Plant(
        "T' = ((W - T)/Ri + q)/Ci\nW' = ((T - W)/Ri + (To - W)/Ro)/Cw\ny = T", ("y",), {"T": 20.0, "W": "W0"},
        {"Ri": 0.005, "Ro": 0.02, "Ci": 2e6, "Cw": 2e7, "W0": 17.0},
        {"Ri": (1e-4, 1.0), "Ro": (1e-4, 1.0), "Ci": (1e4, 1e9), "Cw": (1e4, 1e9)}, np.arange(480) * 900.0,
        lambda x, u, p: [
            ((x[1] - x[0]) / p["Ri"] + u["q"]) / p["Ci"],
            ((x[0] - x[1]) / p["Ri"] + (u["To"] - x[1]) / p["Ro"]) / p["Cw"],
        ],
        lambda p: [20.0, p["W0"]], lambda x, p: x[0], (0.05,), ("Ri", "Ro", "Ci", "Cw", "W0"),
        plain={"W0": (0.0, 40.0)}, drive=_weather,
    ),
    "synchronous motor": Plant(
        "d' = (vd - R*d + w*Lq*q)/Ld\nq' = (vq - R*q - w*(Ld*d + psi))/Lq\nid = d\niq = q", ("id", "iq"),
        {"d": 0.0, "q": 0.0}, {"R": 0.8, "Ld": 3e-3, "Lq": 5e-3, "psi": 0.05},
        {"Ld": (1e-4, 0.1), "Lq": (1e-4, 0.1)}, np.arange(600) * 2e-4,
        lambda x, u, p: [
            (u["vd"] - p["R"] * x[0] + u["w"] * p["Lq"] * x[1]) / p["Ld"],
            (u["vq"] - p["R"] * x[1] - u["w"] * (p["Ld"] * x[0] + p["psi"])) / p["Lq"],
        ],
        lambda p: [0.0, 0.0], lambda x, p: x, (0.15, 0.15), ("R", "Ld", "Lq", "psi"),
        plain={"R": (0.01, 10.0), "psi": (0.0, 1.0)}, drive=_voltages,
    ),
    "glucose": Plant(
        "G' = -(p1 + X)*G + p1*90\nX' = -p2*X + p3*(ins - 10)\ny = G", ("y",), {"G": "G0", "X": 0.0},
        {"p1": 5e-4, "p2": 1e-3 / 3, "p3": 1.3e-5 / 3600, "G0": 280.0},
        {"p1": (1e-6, 0.1), "p2": (1e-6, 0.1), "p3": (1e-12, 1e-5)}, np.arange(180) * 60.0,
        lambda x, u, p: [-(p["p1"] + x[1]) * x[0] + p["p1"] * 90, -p["p2"] * x[1] + p["p3"] * (u["ins"] - 10)],
        lambda p: [p["G0"], 0.0], lambda x, p: x[0], (3.0,), ("p1", "p2", "p3", "G0"), plain={"G0": (100.0, 500.0)},
        drive=_only("ins", lambda rng, t: 10 + 0.15 * t * np.exp(-t / 1500)),
    ),
    "growth to its limit": _growth(20.0, 1.0, ("r", "K", "N0")),
    "growth, seen early": _growth(4.0, 0.02, ("r", "N0")),
    "two lags": Plant(
        "a' = (K*u - a)/tau1\nb' = (a - b)/tau2\ny = b", ("y",), {"a": 0.0, "b": 0.0},
        {"K": 1.5, "tau1": 40.0, "tau2": 12.0}, {"tau1": (1.0, 1e3), "tau2": (1.0, 1e3)}, np.arange(600) * 1.0,
        lambda x, u, p: [(p["K"] * u["u"] - x[0]) / p["tau1"], (x[0] - x[1]) / p["tau2"]],
        lambda p: [0.0, 0.0], lambda x, p: x[1], (0.03,), ("K", "tau1", "tau2"), plain={"K": (0.0, 10.0)},
        alike=("tau1", "tau2"), drive=_only("u", _switched(0.0, 1.0, 60)),
    ),
    "cells in a batch": Plant(
        "X' = mu*S/(Ks + S)*X\nS' = -mu*S/(Ks + S)*X/Y\nx = X\ns = S", ("x", "s"), {"X": 0.2, "S": 10.0},
        {"mu": 0.4 / HOUR, "Ks": 1.2, "Y": 0.5}, {"mu": (1e-6, 1e-2), "Ks": (1e-3, 100.0)},
        np.linspace(0.0, 12 * HOUR, 90),
        lambda x, u, p: [
            p["mu"] * x[1] / (p["Ks"] + x[1]) * x[0], -p["mu"] * x[1] / (p["Ks"] + x[1]) * x[0] / p["Y"],
        ],
        lambda p: [0.2, 10.0], lambda x, p: x, (0.05, 0.1), ("mu", "Ks", "Y"), plain={"Y": (0.01, 1.0)},
    ),
    "two wells": Plant(
        "x' = v\nv' = g*u - d*v - a*x - b*x^3\ny = x", ("y",), {"x": 1.0, "v": 0.0},
        {"d": 0.3, "a": -1.0, "b": 1.0, "g": 0.4}, {}, np.arange(500) * 0.05,
        lambda x, u, p: [x[1], p["g"] * u["u"] - p["d"] * x[1] - p["a"] * x[0] - p["b"] * x[0] ** 3],
        lambda p: [1.0, 0.0], lambda x, p: x[0], (0.05,), ("d", "a", "b", "g"),
        plain={"d": (0.0, 2.0), "a": (-3.0, 3.0), "b": (0.0, 3.0), "g": (0.0, 2.0)},
        drive=_only("u", lambda rng, t: np.cos(1.2 * t)),
    ),
    "nerve, voltage seen": Plant(
        "v' = c*(v - v^3/3 + w)\nw' = -(v - a + b*w)/c\ny = v", ("y",), {"v": -1.0, "w": "w0"},
        {"a": 0.2, "b": 0.2, "c": 3.0, "w0": 1.0}, {}, np.arange(400) * 0.1,
        lambda x, u, p: [p["c"] * (x[0] - x[0] ** 3 / 3 + x[1]), -(x[0] - p["a"] + p["b"] * x[1]) / p["c"]],
        lambda p: [-1.0, p["w0"]], lambda x, p: x[0], (0.1,), ("a", "b", "c", "w0"),
        plain={"a": (-2.0, 3.0), "b": (-2.0, 3.0), "c": (0.1, 10.0), "w0": (-3.0, 3.0)},
    ),
}  # fmt: skip


def row_of(name: str, seed: int) -> dict[str, Any]:
    """What one fit says of each parameter, which combinations it names, and whether its answer is the truth's."""
    plant, began = PLANTS[name], time.perf_counter()
    answer = pf.fit(plant.problem(seed), seed=seed)
    found, final = answer.findings, answer.problem
    truth = final.space.cube(final.space.vector(dict(plant.truth)))
    return {
        "plant": name,
        "seed": seed,
        "parameters": {p["name"]: [p["status"], p["low"], p["high"]] for p in found["parameters"]},
        "combinations": {c["formula"]: [c["low"], c["high"]] for c in (found["determined"] or {})["combinations"]},
        "followed": float(answer.best.cost) <= float(final.costs(truth[None])[0]) * (1 + 1e-6),
        "shot": answer.best.extra.get("ended") == "segments",
        "seconds": time.perf_counter() - began,
    }


def _in_order(plant: Plant, found: Mapping[str, list]) -> dict[str, list]:
    """Rows with those that may change places in the order of the truth."""
    ours = sorted(plant.alike, key=plant.truth.__getitem__)
    theirs = sorted(plant.alike, key=lambda n: found[n][1] or 0.0)
    return {**found, **{a: found[b] for a, b in zip(ours, theirs, strict=True)}}


def holds(low: float | None, high: float | None, truth: float) -> bool:
    """Whether a range holds the truth; no end holds everything."""
    return (low is None or low <= truth) and (high is None or truth <= high)


def table(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Markdown: one row for each plant."""
    yield (
        "| plant | records | fits as well as the truth | known by theory: called determined | intervals hold | others "
        "called determined | all ranges hold | combinations named |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for name, plant in PLANTS.items():
        own = [r for r in rows if r["plant"] == name]
        if not own:
            continue
        every = [(n, v) for r in own for n, v in _in_order(plant, r["parameters"]).items()]
        called = [(n, v) for n, v in every if v[0] == "determined"]
        known, right = (
            [n for n, _ in called if n in plant.known],
            sum(holds(v[1], v[2], plant.truth[n]) for n, v in called),
        )
        within = sum(holds(v[1], v[2], plant.truth[n]) for n, v in every)
        named = "; ".join(f"{c} in {sum(c in r['combinations'] for r in own)}" for c in plant.combinations)
        yield (
            f"| {name} | {len(own)} | {sum(r['followed'] for r in own)} | "
            f"{f'{len(known)} of {len(own) * len(plant.known)}' if plant.known else '-'} | "
            f"{f'{right} of {len(called)}' if called else '-'} | {len(called) - len(known)} | "
            f"{within} of {len(every)} | {named or '-'} |"
        )


def main() -> None:
    """Print the table, of records fitted now or kept in a file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=0, help="of each plant; 0: only the table of the file")
    parser.add_argument("--plants", nargs="*", choices=list(PLANTS), default=list(PLANTS))
    parser.add_argument("--rows", type=Path, default=None, help="where fits are kept, one line each")
    chosen = parser.parse_args()
    kept = [json.loads(x) for x in chosen.rows.read_text().splitlines()] if chosen.rows and chosen.rows.exists() else []
    made = {(r["plant"], r["seed"]) for r in kept}
    for seed in range(1, chosen.records + 1):
        for name in chosen.plants:
            if (name, seed) in made:
                continue
            kept.append(row_of(name, seed))
            print(f"{name} {seed}: {kept[-1]['seconds']:.1f} s", file=sys.stderr, flush=True)
            if chosen.rows:
                with chosen.rows.open("a") as file:
                    file.write(json.dumps(kept[-1]) + "\n")
    print("\n".join(table([r for r in kept if r["plant"] in chosen.plants])))


if __name__ == "__main__":
    main()
