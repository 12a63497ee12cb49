"""`python -m benchmarks.search_suite`: searches at default settings, held against problems whose best optimum is known.

Without --suite and --nist both. Results are printed and, with --json, kept; --against prints what changed since a kept
file.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is loaded

import numpy as np

from benchmarks.search_suite import nist, table, truths
from benchmarks.search_suite.judge import Verdict, judge
from benchmarks.search_suite.suite import CASES
from plantfit.problem.linear.affine import affine_coordinates


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.search_suite", description=__doc__)
    parser.add_argument("--suite", action="store_true", help="the multimodal problems")
    parser.add_argument("--nist", action="store_true", help="the regressions of NIST StRD")
    parser.add_argument("--seeds", type=int, default=5, help="searches of every problem (default 5)")
    parser.add_argument("--only", action="append", help="one problem or regression; may be given several times")
    parser.add_argument(
        "--linear", action="store_true", help="only problems of the suite in which something can be solved for"
    )
    parser.add_argument("--method", default="auto")
    parser.add_argument(
        "--settings", type=json.loads, default={}, help="settings of the method as JSON, '{\"agree\": 5}'"
    )
    parser.add_argument("--json", type=Path, help="file to keep the results in")
    parser.add_argument("--against", type=Path, help="file of earlier results to compare with")
    options = parser.parse_args(arguments)
    if not (options.suite or options.nist):
        options.suite = options.nist = True
    unknown = [n for n in options.only or [] if n not in CASES and n not in nist.FORMULAS]
    if unknown:
        parser.error(f"there is no problem {unknown[0]!r}; there are {', '.join([*CASES, *nist.FORMULAS])}")
    return options


def run_suite(options: argparse.Namespace) -> list[Verdict]:
    known, verdicts = truths.load(), []
    for name, case in CASES.items():
        if (options.only and name not in options.only) or (options.linear and not affine_coordinates(case.problem())):
            continue
        for seed in range(options.seeds):
            with np.errstate(all="ignore"):
                verdict = judge(case.problem(), known[name], seed, method=options.method, settings=options.settings)
            verdicts.append(verdict)
        print(table.suite_table(verdicts[-options.seeds :], known)[1], flush=True)
        keep(verdicts, [], options)
    return verdicts


def run_nist(options: argparse.Namespace, verdicts: Sequence[Verdict]) -> list[nist.Score]:
    scores = []
    for name, start, seed in nist.protocol(options.seeds):
        if not options.only or name in options.only:
            with np.errstate(all="ignore"):
                scores.append(nist.score(name, start, seed, options.method))
            print(table.nist_table(scores[-1:])[1], flush=True)
            keep(verdicts, scores, options)
    return scores


def record(verdicts: Sequence[Verdict], scores: Sequence[nist.Score], options: argparse.Namespace) -> dict[str, Any]:
    """Plain values."""
    told = {"method": options.method, "settings": options.settings, "seeds": options.seeds}
    return {**told, "suite": [asdict(v) for v in verdicts], "nist": [asdict(s) for s in scores]}


def keep(verdicts: Sequence[Verdict], scores: Sequence[nist.Score], options: argparse.Namespace) -> None:
    """Write what there is so far, one line for each run, so that a run that is stopped leaves its results."""
    if options.json:
        kept = record(verdicts, scores, options)
        parts = [f'"{k}": {json.dumps(v)}' for k, v in kept.items() if k not in ("suite", "nist")]
        for part in ("suite", "nist"):
            rows = ",\n".join(json.dumps(row) for row in kept[part])
            parts.append(f'"{part}": [\n{rows}\n]')
        options.json.write_text("{" + ",\n".join(parts) + "}\n", "utf-8")


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    known = truths.load()
    verdicts = run_suite(options) if options.suite else []
    scores = run_nist(options, verdicts) if options.nist else []
    print()
    if verdicts:
        print("\n".join(["", *table.suite_table(verdicts, known)]))
    if scores:
        print("\n".join(["", *table.nist_table(scores)]))
    kept = record(verdicts, scores, options)
    if options.against:
        print("\n".join(["", *table.change_table(json.loads(options.against.read_text("utf-8")), kept)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
