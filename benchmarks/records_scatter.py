"""Do intervals hold the mean of a plant whose parameters scatter between recordings, and stay as they are where nothing
scatters?

    python -m benchmarks.records_scatter [--studies 200] [--seed 0] [--recordings 2,3]

Gain and lag of a first-order plant are drawn anew for every recording, normal in their logarithms, with the standard
deviation `scatter`; the recordings of benchmarks/records_alike.py (300 samples, noise of 5 % of the output) are fitted
together, and the interval of the lag is that of the verdict. Printed: how often it holds the mean, how often it would
have without the widening, how often recordings were told to disagree, how often the interval was widened, its half
width (median and 9 of 10), and how often 400 plants drawn for another recording (`predict --bands`, `tune`) have their
range of 95 % of the lag around a lag that is drawn as those of the recordings were.
"""

import argparse
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from benchmarks.records_alike import GAIN, LAG, SAMPLES, model, recording

START = np.array([0.7 * GAIN, 1.6 * LAG])  # no fit begins at the truth
ROW = 1  # of the lag
DRAWS = 400


@cache
def compiled(count: int) -> Any:
    """The problem of so many recordings; others are put into it."""
    from plantfit.problem import Problem

    rng = np.random.default_rng(0)
    return Problem(model(), {f"r{k}": recording(rng, f"r{k}") for k in range(count)}, substeps=1)


def study(
    seed: int, count: int, scatter: float, memory: float = 0.0, samples: Sequence[int] | None = None
) -> dict[str, Any]:
    """The row of the lag as the noise has it ("before") and as the verdict has it ("row"), and the section
    "heterogeneity".

    Of recording k the first `samples[k]` are fitted, all by default.
    """
    from plantfit.trust.finish.refit import refit
    from plantfit.trust.heterogeneity.findings import heterogeneity_findings
    from plantfit.trust.intervals.linearised import linearise
    from plantfit.trust.intervals.parameter_rows import parameter_rows
    from plantfit.trust.intervals.plausible import plausible

    rng = np.random.default_rng([seed, count, int(1000 * scatter), int(100 * memory)])
    made = {}
    for k in range(count):
        gain, lag = np.exp(scatter * rng.normal(size=2))
        made[f"r{k}"] = _cut(
            recording(rng, f"r{k}", LAG * lag, memory, gain=GAIN * gain), (samples or [SAMPLES] * count)[k]
        )
    problem = compiled(count).with_recordings(made)
    z, _ = refit(problem, np.asarray(problem.space.cube(START)), np.ones(2, dtype=bool))
    local = linearise(problem, z)
    rows = parameter_rows(problem.space, local)
    wider, section = heterogeneity_findings(problem, z, local, rows, 400.0)
    drawn = plausible(problem, z, wider, DRAWS).values[:, ROW]
    another = LAG * np.exp(scatter * rng.normal())
    low, high = np.quantile(drawn, [0.025, 0.975])
    return {
        "before": rows[ROW], "row": wider[ROW], "section": None if section is None else section.plain(),
        "another": bool(low <= another <= high),
    }  # fmt: skip


def _cut(record: Any, samples: int) -> Any:
    """The recording without what was measured after so many samples."""
    from dataclasses import replace

    from plantfit.recording import Signal

    y = np.where(np.arange(len(record)) < samples, record["y"], np.nan)
    return replace(record, signals={**record.signals, "y": Signal(y, record.signals["y"].unit)})


def holds(row: dict[str, Any]) -> bool:
    """Whether the interval of a row holds the mean of the lag."""
    return bool(row["low"] <= LAG <= row["high"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recordings", default="2,3,5", help="how many")
    given = parser.parse_args()
    asked = [int(k) for k in given.recordings.split(",")]
    print(
        "| recordings | lengths | scatter | memory of the noise | told to disagree | holds the mean | without widening "
        "| widened | width | "
        "of 9 in 10 | draws hold another |"
    )
    print("|" + "---|" * 11)
    uneven = [300, 150, 75, 300, 40]
    cases = [(k, s, 0.0, None) for k in (3, 5) for s in (0.0, 0.005, 0.01, 0.02, 0.05, 0.1)]
    cases += [(2, s, 0.0, None) for s in (0.0, 0.01, 0.05)] + [
        (5, 0.0, 0.9, None),
        (5, 0.05, 0.9, None),
        (5, 0.05, 0.0, uneven),
    ]
    for count, scatter, memory, samples in [c for c in cases if c[0] in asked]:
        own = [study(s, count, scatter, memory, samples) for s in range(given.seed, given.seed + given.studies)]
        told = np.mean([o["section"]["agree"] is False for o in own])
        after, before = (np.mean([holds(o[k]) for o in own]) for k in ("row", "before"))
        width, most = np.quantile([(o["row"]["high"] - o["row"]["low"]) / 2.0 for o in own], [0.5, 0.9]) / LAG
        wider, another = np.mean([o["row"]["by_noise"] is not None for o in own]), np.mean([o["another"] for o in own])
        lengths = "all" if samples is None else "300 to 40"
        figures = " | ".join(f"{v:.1%}" for v in (told, after, before, wider, width, most, another))
        print(f"| {count} | {lengths} | {scatter:.1%} | {memory:g} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
