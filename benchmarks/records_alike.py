"""How often are recordings of one plant called different, and how often is a changed one named?

    python -m benchmarks.records_alike [--studies 200] [--seed 0]

First-order plants are simulated by their closed form; every recording is fitted alone by plantfit, with its own inputs
and noise: white, or an AR(1) of memory 0.9 from sample to sample. Printed: studies in which any parameter was told to
differ (5 % where nothing does), and those in which the changed recording alone was named with the moved parameter
first.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.signal import lfilter

PERIOD, SAMPLES = 0.05, 300
GAIN, LAG = 8.0, 0.6


def recording(
    rng: np.random.Generator,
    name: str = "a",
    lag: float = LAG,
    memory: float = 0.0,
    noise: float = 0.4,
    gain: float = GAIN,
) -> Any:
    """A recording of x' = (gain u - x)/lag at rest, input held, with noise of standard deviation `noise`."""
    from plantfit.recording import Recording, Signal

    u = np.repeat(rng.uniform(-2.0, 3.0, SAMPLES // 15), 15)
    decay = np.exp(-PERIOD / lag)
    y = np.concatenate([[0.0], lfilter([gain * (1.0 - decay)], [1.0, -decay], u)[:-1]])
    white = rng.normal(size=SAMPLES + 200)
    e = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white)[200:]
    return Recording(np.arange(SAMPLES) * PERIOD, {"u": Signal(u, "V"), "y": Signal(y + noise * e, "K")}, name)


def model() -> Any:
    """The model of these recordings."""
    from plantfit.models import equations

    return equations(
        "x' = (K*u - x)/tau; y = x", inputs={"u": "V"}, states={"x": {"unit": "K", "initial": 0.0}}, outputs={"y": "K"},
        parameters={"K": {"bounds": (0.1, 100.0), "unit": "K/V"},
                    "tau": {"bounds": (0.01, 10.0), "unit": "s", "scale": "log"}},
    )  # fmt: skip


@cache
def _compiled() -> Any:
    from plantfit.problem import Problem

    problem = Problem(model(), {"a": recording(np.random.default_rng(0))}, substeps=1)
    return problem, np.asarray(problem.space.cube(np.array([GAIN, LAG])))


def record_of(recordings: Sequence[Any]) -> dict[str, Any]:
    """The record of a comparison of recordings, each fitted alone from the truth."""
    from plantfit.trust.finish.refit import refit
    from plantfit.trust.heterogeneity.agreement import compared
    from plantfit.trust.heterogeneity.alone import estimates

    problem, start = _compiled()
    each = {}
    for k, r in enumerate(recordings):
        own = problem.with_recordings({"a": r})
        z, _ = refit(own, start, np.ones(2, dtype=bool))
        found = estimates(own, z, 0.0)
        each[f"r{k}"] = replace(found, rmse={f"r{k}": found.rmse["a"]})
    # its figures are shown, and decide nothing
    joint = replace(each["r0"], rmse={n: e.rmse[n] for n, e in each.items()})
    return compared(problem, joint, each)


def study(seed: int, count: int, memory: float, changed: float = 1.0) -> dict[str, Any]:
    """A study of so many recordings, the time constant of the last one `changed` times that of the others."""
    rng = np.random.default_rng([seed, count, int(100 * memory)])
    return record_of(
        [recording(rng, lag=LAG * (changed if k == count - 1 else 1.0), memory=memory) for k in range(count)]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(
        "| recordings | memory of the noise | alike, told to differ "
        "| changed by 10 %, told | the changed one named, tau first |"
    )
    print("|---|---|---|---|---|")
    for count in (2, 4):
        for memory in (0.0, 0.9):
            seeds = range(given.seed, given.seed + given.studies)
            alike = [study(s, count, memory) for s in seeds]
            other = [study(s, count, memory, 1.1) for s in seeds]
            false, told = (np.mean([r["agree"] is False for r in rs]) for rs in (alike, other))
            named = np.mean([_named(r, count) for r in other])
            print(
                f"| {count} | {memory:g} | {false:.1%} | {told:.1%} | {f'{named:.1%}' if count > 2 else ''} |",
                flush=True,
            )


def _named(record: dict[str, Any], count: int) -> bool:
    apart = record["apart"]
    return [a["recording"] for a in apart] == [f"r{count - 1}"] and apart[0]["moved"][0]["name"] == "tau"


if __name__ == "__main__":
    main()
