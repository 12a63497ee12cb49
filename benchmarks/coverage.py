"""How often what is called determined holds the truth: many fits of small rigs with known truth.

    python -m benchmarks.coverage --fits 300 --rigs product sum PRBS --workers 2 --rows fits.jsonl

Fits are kept in the file as they come, and those that it has are not made again: stop it at any time, and give larger
numbers later.

For every parameter of every rig: in how many fits it is called determined, how often its stated 95 % interval then
holds the truth, with the 99.9 % band of the binomial over all by Holm, and the median width over that of the Cramer-Rao
bound for the rig's own noise, its correlation known. "closed form" says what theory determines; it should be called so
in 95 %.

With --generalised the estimates are those of generalised least squares (`plantfit estimate`), whose intervals count as
determined wherever they have ends.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import binomtest

from benchmarks import paper_rigs

LEVEL, BAND = 0.95, 0.001
TOGETHER = 10  # fits that are made at a time
STARTS = 4  # off the truth, until an answer costs no more than the truth
AROUND = 0.5  # standard deviation of the logarithm by which starts are moved off the truth


@dataclass(frozen=True)
class Rig:
    """`make()` gives a problem; `determined` are the parameters that theory determines; `noise` has a correlation of
    `memory`.

    `terms` are groups of parameters that may change places: they are named by the order of their last parameter, as in
    the truth. `searches` are made at least from as many starts; where others end costs so little more that noise may
    decide, ranges hold them too. `at(base, seed)` is the problem of another seed where white or AR(1) noise on the
    simulated truth does not make it. `covariance(problem)` (m, m) is that of the residuals' noise where it is neither.
    """

    make: Callable
    truth: Mapping[str, float]
    determined: tuple[str, ...]
    noise: float | None = None
    memory: float = 0.0
    terms: tuple[tuple[str, ...], ...] = ()
    at: Callable | None = None
    searches: int = 1
    covariance: Callable | None = None


def _problem(model, t, signals, parameters, substeps=2, estimator=None):
    from plantfit import Problem, Recording, Signal

    units = dict(model.inputs)
    record = {n: Signal(v, units.get(n)) for n, v in signals.items()} | {
        o: Signal(np.zeros(len(t)), u) for o, u in model.outputs.items()
    }
    return Problem(model, Recording(t, record, "run"), parameters, substeps=substeps, estimator=estimator)


def _prbs(n: int, hold: int, seed: int) -> np.ndarray:
    return np.repeat(np.where(np.random.default_rng(seed).uniform(size=n // hold + 1) > 0.5, 1.0, -1.0), hold)[:n]


def _static(text, names, log=True, low=1e-3, high=1e3, n=200, period=1.0, estimator=None):
    def make():
        from plantfit import Parameter, equations

        x = np.linspace(0.05, 4.0, n)
        model = equations(text, inputs=["x"], outputs=["y"], parameters=names, name="curve")
        return _problem(
            model,
            np.arange(n) * period,
            {"x": x},
            {k: Parameter((low, high), scale="log" if log else "linear") for k in names},
            estimator=estimator,
        )

    return make


def _bounded():
    from plantfit import Parameter, equations

    x = np.linspace(0.05, 4.0, 200)
    model = equations("y = a*x + b*x^2", inputs=["x"], outputs=["y"], parameters=["a", "b"], name="curve")
    return _problem(model, np.arange(200) * 1.0, {"x": x}, {"a": Parameter((0.0, 10.0)), "b": Parameter((0.0, 10.0))})


def _first_order(kind, n=300, dead_time=False, initial="measured"):
    def make():
        from plantfit.models.library import catalogue as library

        t = np.arange(n) * 0.1
        u = {"step": np.ones(n), "prbs": _prbs(n, 20, 5), "four": np.repeat([0.2, 0.5, 0.35, 0.8], n // 4 + 1)[:n]}[
            kind
        ]
        model = library.make("first_order", dead_time=dead_time, initial=initial)
        bounds = {"K": (-50.0, 50.0), "tau": (0.05, 200.0), "c": (-50.0, 50.0)} | (
            {"L": (0.0, 3.0)} if dead_time else {}
        )
        bounds |= {"y0": (-50.0, 50.0)} if initial == "free" else {}
        return _problem(model, t, {"u": u}, bounds)

    return make


def _motor():
    from plantfit.models.library import catalogue as library

    n = 400
    model = library.make("dc_motor")
    # from rest Coulomb friction changes in a tenth of a rad/s: with 2 steps the simulated truth is off by 1.5 rad/s
    # there, with 8 by 0.03
    return _problem(model, np.arange(n) * 0.01, {"V": 12.0 * _prbs(n, 25, 3)}, None, substeps=8)


def _paper(
    rig, truth: Mapping[str, float], determined: tuple[str, ...], searches: int = 1, covariance: Callable | None = None
) -> "Rig":
    """The rig of a paper: its records have no other noise than that of its sensors."""
    return Rig(rig.problem, truth, determined, at=rig.at, searches=searches, covariance=covariance)


MOTOR = {"Rm": 1.5, "Lm": 2e-3, "Kb": 0.09, "Kt": 0.09, "Jm": 5e-4, "Cm": 1e-4, "Tf": 0.01}
PROCESS = {"K": 2.0, "tau": 2.0, "c": 1.0}
RIGS = {
    "line": Rig(_static("y = a*x + b", ["a", "b"]), {"a": 2.0, "b": 0.5}, ("a", "b"), 0.05),
    "line, correlation 0.8": Rig(
        _static("y = a*x + b", ["a", "b"], period=0.1), {"a": 2.0, "b": 0.5}, ("a", "b"), 0.05, 0.8
    ),
    "line, correlation 0.8, generalised": Rig(
        _static("y = a*x + b", ["a", "b"], period=0.1, estimator="generalised least squares"),
        {"a": 2.0, "b": 0.5},
        ("a", "b"),
        0.05,
        0.8,
    ),
    "product": Rig(_static("y = a*b*x + c", ["a", "b", "c"]), {"a": 2.0, "b": 0.5, "c": 1.0}, ("c",), 0.05),
    "sum": Rig(_static("y = (a + b)*x + c", ["a", "b", "c"]), {"a": 2.0, "b": 0.5, "c": 1.0}, ("c",), 0.05),
    "two exponentials": Rig(
        _static("y = a*exp(-k*x) + b*exp(-m*x)", ["a", "k", "b", "m"]),
        {"a": 2.0, "k": 0.3, "b": 3.0, "m": 3.0},
        ("a", "k", "b", "m"),
        0.01,
        terms=(("a", "k"), ("b", "m")),
    ),
    "near exponentials": Rig(
        _static("y = a*exp(-k*x) + b*exp(-m*x)", ["a", "k", "b", "m"]),
        {"a": 2.0, "k": 0.7, "b": 3.0, "m": 1.0},
        (),
        0.05,
        terms=(("a", "k"), ("b", "m")),
    ),
    "on a bound": Rig(_bounded, {"a": 2.0, "b": 0.0}, ("a",), 0.05),
    "one step": Rig(_first_order("step"), PROCESS, ("tau",), 0.02),
    "PRBS": Rig(_first_order("prbs"), PROCESS, ("K", "tau", "c"), 0.02),
    "PRBS, 100 samples": Rig(_first_order("prbs", 100), PROCESS, ("K", "tau", "c"), 0.02, 0.5),
    "PRBS, correlation 0.97": Rig(_first_order("prbs", 600), PROCESS, (), 0.05, 0.97),
    "four steps, dead time": Rig(_first_order("four", 400, True), PROCESS | {"L": 0.73}, ("K", "tau", "c", "L"), 0.01),
    "one step, free start": Rig(_first_order("step", initial="free"), PROCESS | {"y0": 0.0}, ("tau",), 0.02),
    "PRBS, free start": Rig(_first_order("prbs", initial="free"), PROCESS | {"y0": 0.0}, ("K", "tau", "c"), 0.02),
    "four steps, dead time, free start": Rig(
        _first_order("four", 400, True, "free"), PROCESS | {"L": 0.73, "y0": 0.0}, ("K", "tau", "c", "L"), 0.01
    ),
    "motor by speed": Rig(_motor, MOTOR, (), 0.5),
    "paper: pendubot, torque": _paper(paper_rigs.PENDUBOT_TORQUE, paper_rigs.TORQUE, ()),
    "paper: motor, speed": _paper(paper_rigs.MOTOR_SPEED, paper_rigs.BOARD, (), 3),
    "paper: motor, speed and current": _paper(
        paper_rigs.MOTOR_CURRENT, paper_rigs.BOARD, ("Rm", "Lm", "Kb", "Jm", "Cm")
    ),
    "paper: robot's motor": _paper(
        paper_rigs.ROBOT_MOTOR, paper_rigs.ROBOT, ("Ra", "La", "kw", "B", "J"), covariance=paper_rigs.robot_noise
    ),
    "paper: steam, one step": _paper(
        paper_rigs.STEAM_STEP, {f"{n}[opening]": v for n, v in paper_rigs.STEAM.items()}, ("k[opening]", "A1[opening]")
    ),
}


GENERALISED = " by generalised least squares"  # what the names of such rows of fits end with


def noise_of(rig: Rig, n: int, seed: int) -> np.ndarray:
    """White or AR(1) noise (n,) of the rig's standard deviation."""
    e = np.random.default_rng(seed).normal(size=n + 500)
    return rig.noise * np.sqrt(1.0 - rig.memory**2) * np.asarray(lfilter([1.0], [1.0, -rig.memory], e))[500:]


def fits(name: str, seeds: Sequence[int]) -> list[dict]:
    """Rows of the parameters of one rig for each seed, each from a start off the truth."""
    from plantfit.problem.correlated.weighted_answer import Weighted
    from plantfit.trust.finish.descent import descent
    from plantfit.trust.finish.noise_weights import weighted_ranges, weights_at
    from plantfit.trust.finish.start_corrections import with_start_corrections
    from plantfit.trust.intervals.follow.following import followed_ranges
    from plantfit.trust.intervals.linearised import linearise
    from plantfit.trust.intervals.parameter_rows import parameter_rows

    generalised, name = name.endswith(GENERALISED), name.removesuffix(GENERALISED)
    rig, base = RIGS[name], _base(name)
    truth = base.space.vector(rig.truth)
    result = []
    for seed in seeds:
        problem = rig.at(base, seed) if rig.at else _noisy(rig, base, truth, seed)
        ends, most = [], float(problem.costs(np.clip(problem.space.cube(truth), 0.0, 1.0)[None, :])[0])
        for start in range(STARTS):  # no answer costs more than the truth
            ends.append(descent(problem, _off(problem.space, truth, [seed, 7 + start])))
            if len(ends) >= rig.searches and min(d.cost for d in ends) <= most * (1 + 1e-6):
                break
        best, *others = sorted(ends, key=lambda d: d.cost)
        problem, best = with_start_corrections(problem, best)  # as `finish` does it
        if generalised:
            result.append(_by_generalised(problem, best.z))
            continue
        weighted = weights_at(problem, best.z) if problem.generalised else None  # as `judged` does it
        if isinstance(weighted, Weighted):
            problem = problem.with_answer(weighted)
            rows = parameter_rows(problem.space, linearise(problem, weighted.z), (), weighted_ranges(problem, weighted))
            result.append(_in_order(rig, {r["name"]: [r["status"], r["low"], r["high"], r["value"]] for r in rows}))
            continue
        local = linearise(problem, best.z)
        assert local.linear is not None
        ranges = followed_ranges(problem, best.z, local.linear, 0.0, [d.z for d in others])
        rows = parameter_rows(problem.space, local, (), ranges)
        result.append(_in_order(rig, {r["name"]: [r["status"], r["low"], r["high"], r["value"]] for r in rows}))
    return result


def _by_generalised(problem, z: np.ndarray) -> dict:
    """Rows as those of `fits`, from the least-squares answer z."""
    from plantfit.estimate.methods.generalised import generalised_least_squares

    values = dict(zip(problem.space.names, np.asarray(problem.space.physical(z)).tolist(), strict=True))
    estimate, interval = generalised_least_squares(problem, values).estimated
    return {n: ["open" if None in interval[n] else "determined", *interval[n], v] for n, v in estimate.named.items()}


@lru_cache(maxsize=2)
def _base(name: str):
    """The problem of a rig, with what was compiled for it."""
    return RIGS[name].make()


def _noisy(rig: Rig, base, truth: np.ndarray, seed: int):
    """The problem on the simulated truth and noise."""
    from plantfit import Signal

    (output,) = base.outputs
    clean, record = base.predict(truth)[output], base.experiments["run"].recording
    noisy = clean + noise_of(rig, len(clean), seed)
    signals = {**record.signals, output: Signal(noisy, record.signals[output].unit)}
    return base.with_recordings({"run": type(record)(record.t, signals, "run")})


def _off(space, truth: np.ndarray, seed: Sequence[int]) -> np.ndarray:
    """A start in the cube (d,) off the truth; of what is 0 in truth anywhere in a tenth of its box."""
    draw = np.random.default_rng(seed).normal(size=len(truth))
    moved = np.where(
        truth == 0.0,
        space.lower + 0.1 * np.abs(np.tanh(draw)) * (space.upper - space.lower),
        truth * np.exp(AROUND * draw),
    )
    return np.clip(space.cube(np.clip(moved, space.lower, space.upper)), 0.0, 1.0)


def _in_order(rig: Rig, found: dict) -> dict:
    """Rows with equal terms in the order of the truth."""
    truly, told = (
        sorted(rig.terms, key=lambda term: of(term[-1])) for of in (rig.truth.__getitem__, lambda n: found[n][3])
    )
    return found | {
        a: found[b] for own, other in zip(truly, told, strict=True) for a, b in zip(own, other, strict=True)
    }


def bound(name: str) -> dict[str, float]:
    """Cramer-Rao standard errors at the truth for the noise that the rig has; infinite for what is not determined.

    Where states begin at a measured value, nobody knows the true one: it is one more unknown, of which that value is
    one sample.
    """
    rig, problem = RIGS[name], _base(name)
    truth = problem.space.vector(rig.truth)
    z = np.clip(problem.space.cube(truth), 0.0, 1.0)
    residuals, jacobian = (np.asarray(v) for v in problem.residuals_and_jacobian(z))
    noise = rig.noise if rig.noise is not None else float(np.sqrt(np.mean(residuals**2)))
    size = np.where(truth == 0.0, 1.0, np.abs(truth))
    columns = np.hstack([jacobian / problem.space.slopes(z) * size, starts(problem, z, noise)])
    if rig.covariance or rig.memory:
        covariance = (
            rig.covariance(problem) if rig.covariance else noise**2 * toeplitz(rig.memory ** np.arange(len(columns)))
        )
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), columns)
    else:  # white noise: a covariance of tens of thousands of samples would be gigabytes
        whitened = columns / noise
    _, s, right = np.linalg.svd(whitened, full_matrices=False)
    error = np.sqrt(np.sum((right.T / np.maximum(s, 1e-9 * s[0])) ** 2, axis=1))[: len(size)] * size
    return dict(zip(problem.space.names, error.tolist(), strict=True))


def starts(problem, z: np.ndarray, noise: float) -> np.ndarray:
    """What the starts that are measured do to the residuals by each `noise` of theirs: columns (m, k)."""
    from plantfit.problem.evaluate.points import residuals
    from plantfit.trust.intervals.first_values import outputs_begun_at

    found = []
    for output in outputs_begun_at(problem, z):
        for n in problem.data["drive"]:
            step = 0.01 * noise * float(problem.scales[output])
            above, below = (residuals(problem.with_starts({n: {output: s * step}}), z) for s in (1.0, -1.0))
            found.append((above - below) / 0.02)
    return np.stack(found, axis=1) if found else np.zeros((len(residuals(problem, z)), 0))


def table(name: str, found: Sequence[Mapping]) -> list[dict]:
    """One row for each parameter."""
    own_name = name.removesuffix(GENERALISED)
    rig, least, rows = RIGS[own_name], bound(own_name), []
    for p, truth in rig.truth.items():
        own = [f[p] for f in found]
        called = [r for r in own if r[0] == "determined"]
        slack = 1e-9 * max(abs(truth), 1e-12)
        held = sum(r[1] - slack <= truth <= r[2] + slack for r in called)
        every = sum(None in r[1:3] or r[1] - slack <= truth <= r[2] + slack for r in own)  # no end holds everything
        width = float(np.median([r[2] - r[1] for r in called])) / (2 * 1.96 * least[p]) if called else None
        chance = binomtest(held, len(called), LEVEL).pvalue if called else 1.0
        rows.append(
            {"rig": name, "parameter": p, "fits": len(own), "determined": len(called), "held": held, "all_held": every,
             "width": width,
             "p": chance, "theory": p in rig.determined}
        )  # fmt: skip
    return rows


def holm(rows: list[dict]) -> None:
    """Marks the rows whose coverage is outside of the band, over all rows together (Holm, Scand. J. Statist. 6
    (1979) 65)."""
    order, alive = sorted(rows, key=lambda r: r["p"]), True
    for k, row in enumerate(order):
        alive = bool(alive and row["p"] <= BAND / (len(order) - k))
        row["outside"] = alive


def report(rows: Sequence[Mapping]) -> str:
    """The table as Markdown."""
    lines = [
        "| rig | parameter | fits | called determined | interval holds the truth | all ranges hold it | width / "
        "Cramer-Rao | by theory |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        share = (
            f"{100 * r['held'] / r['determined']:.1f} %{' (outside)' if r['outside'] else ''}"
            if r["determined"]
            else "-"
        )
        width = f"{r['width']:.2f}" if r["width"] is not None and r["width"] > 1e-3 else "-"
        lines.append(
            f"| {r['rig']} | {r['parameter']} | {r['fits']} | {100 * r['determined'] / r['fits']:.0f} % | {share} | "
            f"{100 * r['all_held'] / r['fits']:.1f} % | {width} | {'determined' if r['theory'] else 'open or weak'} |"
        )
    return "\n".join(lines)


def kept(file: Path | None) -> dict[str, dict[int, dict]]:
    """The fits of each rig by seed that a file of rows has."""
    result: dict[str, dict[int, dict]] = {}
    for line in file.read_text().splitlines() if file and file.exists() else ():
        row = json.loads(line)
        result.setdefault(row["rig"], {})[row["seed"]] = row["fit"]
    return result


def _made(missing: Sequence[tuple[str, int]], workers: int) -> Iterator[tuple[str, int, dict]]:
    """Fits of (rig, seed), a few at a time, as they come."""
    parts = []
    for name in dict.fromkeys(n for n, _ in missing):
        own = [s for n, s in missing if n == name]
        parts += [(name, own[k : k + TOGETHER]) for k in range(0, len(own), TOGETHER)]
    if workers == 1:
        for name, seeds in parts:
            print(f"{name}: {seeds[0]} to {seeds[-1]}", file=sys.stderr, flush=True)
            yield from zip([name] * len(seeds), seeds, fits(name, seeds), strict=True)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(fits, name, seeds): (name, seeds) for name, seeds in parts}
        for done in as_completed(waiting):
            name, seeds = waiting[done]
            yield from zip([name] * len(seeds), seeds, done.result(), strict=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fits", type=int, default=0)
    parser.add_argument("--rigs", nargs="*", default=list(RIGS), choices=list(RIGS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--rows",
        type=Path,
        default=None,
        help="where fits are kept, one line each; without --fits, only the table of it",
    )
    parser.add_argument("--generalised", action="store_true", help="by generalised least squares")
    options = parser.parse_args()
    if options.generalised:
        options.rigs = [name + GENERALISED for name in options.rigs]
    found = kept(options.rows)
    missing = [(n, s) for n in options.rigs for s in range(1, options.fits + 1) if s not in found.get(n, {})]
    for name, seed, fit in _made(missing, options.workers):
        found.setdefault(name, {})[seed] = fit
        if options.rows:
            with options.rows.open("a") as file:
                file.write(json.dumps({"rig": name, "seed": seed, "fit": fit}) + "\n")
    rows = [
        row
        for name in options.rigs
        if name in found
        for row in table(name, [found[name][s] for s in sorted(found[name])])
    ]
    holm(rows)
    print(report(rows))


if __name__ == "__main__":
    main()
