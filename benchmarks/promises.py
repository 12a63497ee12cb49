"""Does the share of plants that `plantfit tune` promises hold for the plant that was recorded?

    python -m benchmarks.promises [--records 100] [--rows promises.jsonl] [--case rich ...]

A plant of first order with dead time is drawn from the prior (uniform in the logarithms of the box of the search),
recorded with noise and fitted by `plantfit.fit`; a PID is tuned on 80 of the plants that the data allow and judged on
100. The true plant is then judged by the same wishes: over records, the share of truths that keep them should be at
least the mean of the promised shares. The same for the PID tuned on the best fit alone, whose promise is made on the
same plants. Rows are appended to the file as they come, and one that is there is kept.

Cases: a livelier input and little noise (rich), a single step (step), a tenth of the samples with more noise (poor).
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

BOX = {"K": (0.5, 4.0), "tau": (4.0, 20.0), "L": (1.0, 6.0)}
PERIOD = 0.5
START, STEP, LOAD = 2.0, 1.0, 0.1  # of the set point, in the unit of the output


@dataclass(frozen=True)
class Case:
    """A record of `samples` samples with noise (standard deviation), whose input holds each of its levels for `hold`
    samples."""

    samples: int
    noise: float
    hold: int


CASES = {"rich": Case(600, 0.05, 20), "step": Case(200, 0.1, 1000), "poor": Case(60, 0.3, 15)}


def record(case: Case, truth: dict[str, float], rng: np.random.Generator) -> Any:
    """At rest at u = 0, then levels of the input; the exact lag, the dead time cut within samples."""
    from plantfit.recording import Recording, Signal

    n = case.samples
    levels = rng.uniform(-1.0, 1.0, n // case.hold + 1) if case.hold < n else np.array([1.0])
    u = np.repeat(levels, case.hold)[:n]
    u[:4] = 0.0
    whole = int(truth["L"] / PERIOD)
    late = truth["L"] - whole * PERIOD
    before, after = np.exp(-late / truth["tau"]), np.exp(-(PERIOD - late) / truth["tau"])
    y = np.zeros(n)
    for k in range(n - 1):
        old, new = (u[k - d] if k >= d else 0.0 for d in (whole + 1, whole))
        y[k + 1] = (y[k] * before + truth["K"] * old * (1.0 - before)) * after + truth["K"] * new * (1.0 - after)
    z = y + case.noise * rng.standard_normal(n)
    return Recording(PERIOD * np.arange(n), {"u": Signal(u, "V"), "z": Signal(z, "K")}, "record")


@cache
def plant() -> Any:
    """The model, with the prior as its box."""
    from plantfit.models import equations

    given = {
        n: {"bounds": ends, "unit": unit, "scale": "log"}
        for (n, ends), unit in zip(BOX.items(), ("K/V", "s", "s"), strict=True)
    }
    return equations(
        "y' = (K*delay(u, L) - y)/tau; z = y", inputs={"u": "V"}, states={"y": {"unit": "K", "initial": 0.0}},
        outputs={"z": "K"},
        parameters=given, name="lag",
    )  # fmt: skip


def measured(case: str, seed: int) -> dict[str, Any]:
    """One record: what was promised and what became of the truth, for the PID on all plants and the one on the best
    fit."""
    import plantfit as pf
    from plantfit.control.tune.frequency import frequencies, sampled_response
    from plantfit.control.tune.loop_design import FINE
    from plantfit.control.tune.loop_scores import Judge
    from plantfit.control.tune.one_loop import OneLoop
    from plantfit.control.tune.reduction import integrators, slowest
    from plantfit.control.tune.searching.judged import judged_on

    rng = np.random.default_rng([seed, list(CASES).index(case)])
    truth = {n: float(np.exp(rng.uniform(*np.log(ends)))) for n, ends in BOX.items()}
    model = plant()
    began = time.process_time()
    # steps of a sample are exact on this plant, so that none have to be chosen
    answer = pf.fit(pf.Problem(model, {"record": record(CASES[case], truth, rng)}, substeps=1), runs=4, seed=seed)
    fitted = time.process_time() - began
    top = 5.0 * START / min(answer.values["K"], truth["K"])
    found = pf.tune(
        answer, set_point=START, step=STEP, load=LOAD * top, lower=-top, upper=top, period=PERIOD, quantum=0.0,
        plants=100, budget=100,
        seed=seed, horizon=8.0 * (BOX["tau"][1] + BOX["L"][1]),
    )  # fmt: skip
    design = found.design
    own = OneLoop(model, "z", "u", {}, {n: np.array([v]) for n, v in truth.items()})
    start, rest = (own.at_rest(level, (-top, 0.0, top)) for level in (START - STEP, START))
    w = frequencies(PERIOD, slowest(design.reduced), FINE)
    row: dict[str, Any] = {"case": case, "seed": seed, "truth": truth, "open": list(found.drawn.open)}
    row["fitted"] = {n: float(answer.values[n]) for n in BOX}
    form = design.best.form
    judge = Judge.of(own, start, design.course, design.wishes.quantum, form)
    both = judged_on(
        judge,
        form,
        [r.parameters for r in design.rows[:2]],
        sampled_response(rest, PERIOD, w),
        w,
        design.wishes,
        1 + integrators(rest),
    )
    for k, name in enumerate(("all plants", "best fit alone")):
        row[name] = {
            "promised": design.rows[k].share,
            "kept": bool(both.kept[k, 0]),
            "iae": float(both.scores.iae[k, 0]),
        }
    row["seconds"] = [round(fitted, 2), round(time.process_time() - began - fitted, 2)]
    return row


def show(rows: list[dict[str, Any]]) -> None:
    """A row for each case and tuning."""
    print(
        "| case | records | tuned on | promised, mean | truths "
        "that keep it | records that promise 95 % | of these kept |"
    )
    print("|---|---:|---|---:|---:|---:|---:|")
    for case in CASES:
        own = [r for r in rows if r["case"] == case]
        for name in ("all plants", "best fit alone") if own else ():
            promised, kept = (np.array([float(r[name][k]) for r in own]) for k in ("promised", "kept"))
            sure = promised >= 0.95
            of = f"{100 * kept[sure].mean():.0f} %" if np.any(sure) else "-"
            print(
                f"| {case} | {len(own)} | {name} | {100 * promised.mean():.1f} % | {100 * kept.mean():.1f} % | "
                f"{np.sum(sure)} | {of} |"
            )


def asked(records: int, cases: list[str], done: set[tuple[str, int]]) -> Iterator[tuple[str, int]]:
    """Cases by turns, so that a run that is cut has as many of each."""
    for seed in range(records):
        for case in cases:
            if (case, seed) not in done:
                yield case, seed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=100, help="of each case")
    parser.add_argument("--rows", type=Path, default=Path("promises.jsonl"))
    parser.add_argument("--case", choices=list(CASES), nargs="+", default=list(CASES))
    given = parser.parse_args()
    rows = [json.loads(line) for line in given.rows.read_text().splitlines()] if given.rows.exists() else []
    for case, seed in asked(given.records, given.case, {(r["case"], r["seed"]) for r in rows}):
        rows.append(measured(case, seed))
        with given.rows.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(case, seed, rows[-1]["all plants"], rows[-1]["seconds"], flush=True)
    show(rows)


if __name__ == "__main__":
    main()
