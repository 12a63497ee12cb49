"""`python -m benchmarks.confirmed [NAME...] --json FILE`: is every answer's cost that of an independent solver?

Demos and problems of the search suite are fitted as a user would; the cost of each answer stands beside that of the
tight solver over whole records. They must agree to 1 %, or the answer must say that the answer is refused, or that the
steps that a problem asks for are not fine enough for it (those of the suite are fixed). With --json what stands in the
file is not computed again.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import plantfit as pf
from benchmarks.search_suite.suite import CASES
from plantfit.answer import Answer
from plantfit.cases import demos
from plantfit.problem import checked_cost

EVALUATIONS = 10_000_000  # of the rate on each recording: whole records


def row_of(name: str, answer: Answer) -> dict[str, Any]:
    """What the answer reports, what the tight solver finds, and whether `sound`: to 1 % the same, or `said` not to
    be."""
    # what the verdict says of it, taken from where it takes it: the rest of the verdict is not what is measured
    said = [str(answer.best.extra[key]) for key in ("refused", "steps") if key in answer.best.extra]
    # answers of regressions and static models have no steps
    told = (
        checked_cost(answer.problem, answer.best.x, evaluations=EVALUATIONS)
        if answer.problem.predictor.has_steps
        else None
    )
    return {
        "name": name,
        "cost": float(answer.best.cost),
        "tight": None if told is None else told.cost_checked,
        "off": 0.0 if told is None else told.off,
        "followed": told is not None,
        "said": said,
        "sound": told is None or told.confirmed or bool(said),
    }


def answers_of(name: str, seed: int) -> Iterator[tuple[str, Answer]]:
    """The answers of a demo, or the one of a problem of the suite."""
    if name in CASES:
        yield name, pf.fit(CASES[name].problem(), seed=seed)
        return
    with tempfile.TemporaryDirectory() as folder:
        for k, answer in enumerate(demos()[name][1]()(Path(folder))["answers"]):
            yield f"{name} {k + 1}", answer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="demos and problems of the suite; all of them without")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, default=None, help="where the results are kept")
    options = parser.parse_args()
    kept: dict[str, list[dict[str, Any]]] = (
        json.loads(options.json.read_text()) if options.json and options.json.exists() else {}
    )
    chosen = options.names or [*CASES, *demos()]
    for name in chosen:
        if name not in kept:
            began = time.process_time()
            kept[name] = [row_of(n, a) for n, a in answers_of(name, options.seed)]
            print(f"{name}: {time.process_time() - began:.0f} s of this process", flush=True)
            if options.json:
                options.json.write_text(json.dumps(kept, indent=1))
        for row in kept[name]:
            off = f"off by {100 * row['off']:.2g} %" if row["followed"] else "no steps"
            print(f"  {row['name']}: cost {row['cost']:.6g}, {off}", *row["said"], sep=". ", flush=True)
    rows = [row for name in chosen for row in kept[name]]
    followed = [r for r in rows if r["followed"]]
    close = sum(r["off"] <= 0.01 for r in followed)
    print(
        f"{close} of {len(followed)} answers with steps are within 1 % of the tight solver's cost; of "
        f"{sum(not r['sound'] for r in rows)} "
        "others nothing is said"
    )


if __name__ == "__main__":
    main()
