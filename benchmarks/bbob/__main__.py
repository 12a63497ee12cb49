"""`python -m benchmarks.bbob`: run methods and references on the BBOB functions, keep results, print tables."""

import argparse
import contextlib
import importlib
import os
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is loaded

import numpy as np

from benchmarks.bbob import logs, ours, pyhms_rival, references, table
from benchmarks.bbob.results import Result, from_runs, load, load_all, path_of, save
from benchmarks.bbob.suite import DIMENSIONS, FUNCTIONS, INSTANCES, Run, problem

QUICK: dict[str, Any] = {"instances": (1, 2, 3), "per_dimension": 100}
FULL: dict[str, Any] = {"instances": INSTANCES, "per_dimension": 1000}
PYHMS = {"pyhms": False, "pyhms-repaired": True}


class Skip(Exception):
    """Something that cannot run here, with the reason."""


@dataclass(frozen=True)
class Contender:
    """A method or a reference: `run` (runs, seed) -> processor seconds; `about` (dimension, budget) -> facts for the
    results."""

    name: str
    run: Callable[[list[Run], int], float]
    about: Callable[[int, int], dict[str, Any]]


def contender(name: str) -> Contender:
    """Ours or a reference by its name. Raises Skip."""
    portfolio = ours.portfolio()
    if name in portfolio:
        reason = ours.unfit(portfolio[name])
        if reason is not None:
            raise Skip(reason)
        return Contender(name, partial(ours.run_ours, portfolio[name]), partial(ours.about, portfolio[name]))
    if name in PYHMS:
        try:
            pyhms_rival.interpreter()
        except pyhms_rival.Missing as error:
            raise Skip(str(error)) from None
        told = {
            "package": pyhms_rival.NEEDS[0].replace("==", " "),
            "settings": "minimize()" + ", sprouting repaired" * PYHMS[name],
        }
        return Contender(name, partial(pyhms_rival.run_pyhms, repaired=PYHMS[name]), lambda d, b: told)
    reference = references.REFERENCES[name]
    try:
        told = {"package": references.version(reference.package), "settings": reference.settings}
    except PackageNotFoundError:
        raise Skip(f"the package {reference.package} is not installed") from None
    if name.startswith("dish-python"):
        try:
            importlib.import_module("benchmarks.bbob.dish_python_faults")
        except ModuleNotFoundError:
            raise Skip("benchmarks/bbob/dish_python_faults.py is missing") from None
    return Contender(name, partial(references.run_reference, reference), lambda d, b: told)


def reference_names() -> list[str]:
    """Cheapest first."""
    return [*list(references.REFERENCES), *PYHMS]


def chosen(words: list[str], alone: bool) -> list[str]:
    """Names behind the words of --methods, references of a method after it. Raises SystemExit for an unknown word."""
    portfolio, known = ours.portfolio(), reference_names()
    groups = {"ours": list(portfolio), "references": known, "all": [*known, *portfolio]}
    names: list[str] = []
    for word in words:
        if word not in groups and word not in portfolio and word not in known:
            sys.exit(f"There is no method {word!r}; there are {', '.join([*groups, *portfolio, *known])}.")
        names += groups.get(word, [word])
        if word in portfolio and not alone:
            names += portfolio[word].references
    return list(dict.fromkeys(names))


def whole(path: Path, folder: Path, name: str, function: int, dimension: int, options: argparse.Namespace) -> bool:
    """Whether this part is done. Raises SystemExit when the file comes from runs of another size."""
    if options.again or not path.exists():
        return False
    kept = load(path)
    if kept.budget != options.per_dimension * dimension or tuple(kept.instances) != tuple(options.instances):
        sys.exit(f"{path} has other instances or another budget; give another folder with --out, or --again.")
    return not options.logs or logs.log_folder(folder, name, function, dimension).exists()


def run_part(who: Contender, function: int, dimension: int, options: argparse.Namespace) -> Result:
    """One method on one function in one dimension: run, replay for logs, save."""
    budget = options.per_dimension * dimension
    runs = [Run(problem(function, dimension, i), budget, keep=options.logs) for i in options.instances]
    seconds = who.run(runs, options.seed)
    over = [r.evaluations for r in runs if r.evaluations > budget]
    if over:
        raise RuntimeError(f"{who.name} spent {over} evaluations of {budget}")
    about = {**who.about(dimension, budget), "seed": options.seed}
    if options.logs:
        logs.write_logs(runs, options.out, who.name, f"{about['package']} {about['settings']}")
    result = from_runs(who.name, runs, seconds, about)
    save(result, options.out)
    return result


def run_all(names: list[str], options: argparse.Namespace) -> None:
    ready: dict[str, Contender] = {}
    for name in names:
        try:
            ready[name] = contender(name)
        except Skip as reason:
            print(f"skipped {name}: {reason}", flush=True)
    for dimension in options.dimensions:
        for name, who in ready.items():
            began, parts = time.perf_counter(), []
            for function in options.functions:
                path = path_of(options.out, name, function, dimension)
                if whole(path, options.out, name, function, dimension, options):
                    continue
                try:
                    parts.append(run_part(who, function, dimension, options))
                except Exception:
                    # one broken reference must not end a night of runs
                    print(f"failed {name} f{function} {dimension}-D\n{traceback.format_exc()}", flush=True)
            if parts:
                report_rate(name, dimension, parts, time.perf_counter() - began)


def report_rate(name: str, dimension: int, parts: list[Result], wall: float) -> None:
    """Processor time per evaluation, and what all functions and instances would take at most."""
    seconds, evaluations = sum(p.seconds for p in parts), sum(int(p.spent.sum()) for p in parts)
    rate = seconds / max(1, evaluations)
    most = rate * len(FUNCTIONS) * len(INSTANCES) * FULL["per_dimension"] * dimension / 60
    print(
        f"{time.strftime('%H:%M:%S')} {name:28}{dimension:3}-D {len(parts):2} functions {seconds:8.1f} "
        f"s processor {wall:8.1f} s {1e6 * rate:7.1f} us/evaluation; all at most {most:.1f} min",
        flush=True,
    )


def print_tables(options: argparse.Namespace) -> None:
    results = load_all(options.out)
    pairs = [(name, r) for name, entry in ours.portfolio().items() for r in entry.references]
    for dimension in options.dimensions:
        of = table.by_method(results, dimension)
        if options.markdown:
            print("\n".join(["", *table.page_table(of, pairs, dimension)]))
            continue
        parts = [table.area_table(of, dimension), table.comparison_table(of, pairs, dimension)] if of else []
        if options.ert:
            parts.append(table.running_time_table(of, sorted(of), dimension))
        for lines in parts:
            print("\n".join(["", *lines]))


def numbers(text: str) -> list[int]:
    """'1-3,8' as [1, 2, 3, 8]."""
    found: list[int] = []
    for part in text.split(","):
        low, _, high = part.partition("-")
        found += range(int(low), int(high or low) + 1)
    return found


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bbob", description=__doc__)
    parser.add_argument("--methods", default="all", help="names with commas, or: ours, references, all (default)")
    parser.add_argument("--alone", action="store_true", help="do not add the references of the methods named")
    parser.add_argument("--dimensions", type=numbers, default=list(DIMENSIONS), help="default 5,20")
    parser.add_argument("--functions", type=numbers, default=list(FUNCTIONS), help="default 1-24")
    parser.add_argument("--instances", type=numbers, help="default 1-15; with --quick 1-3")
    parser.add_argument(
        "--quick", action="store_true", help="3 instances and 100 d evaluations in place of 15 and 1000 d"
    )
    parser.add_argument(
        "--out", type=Path, help="folder of results, which is filled up (default out/bbob or out/bbob-quick)"
    )
    parser.add_argument("--again", action="store_true", help="run what the folder already has")
    parser.add_argument("--logs", action="store_true", help="also write COCO logs under OUT/logs/METHOD")
    parser.add_argument("--ert", action="store_true", help="also print expected running times by function")
    parser.add_argument("--table", action="store_true", help="run nothing, print tables of what the folder has")
    parser.add_argument(
        "--markdown", action="store_true", help="print the tables of docs/bbob.md in place of the others"
    )
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    size = QUICK if options.quick else FULL
    options.instances, options.per_dimension = tuple(options.instances or size["instances"]), size["per_dimension"]
    options.out = (options.out or Path("out") / ("bbob-quick" if options.quick else "bbob")).resolve()
    return options


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.table:
        names = chosen(options.methods.split(","), options.alone)
        with contextlib.suppress(KeyboardInterrupt), np.errstate(all="ignore"):
            run_all(names, options)
    print_tables(options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
