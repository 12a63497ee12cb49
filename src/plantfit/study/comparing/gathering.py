"""Studies of a store as problems with runs: studies of the same problem are put together."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plantfit.errors import StoreError
from plantfit.study.comparing.problem_runs import ProblemRuns
from plantfit.study.running.probe import check_same
from plantfit.study.store.records import RunRecord, StudyRecord
from plantfit.study.store.store import Store

FLOOR, OPTIMUM = "noise_floor", "optimum"  # where a run's extra says what is known of its problem


def gather(
    store: Store, numbers: Sequence[int], *, floor: float | None = None, optimum: float | None = None
) -> list[ProblemRuns]:
    """The runs of the studies, one entry for each problem, in the order given.

    Two studies have the same problem when their fingerprints agree (same costs at the test points, same bounds). A
    method that occurs in two of them is told apart by the study's number. `floor` and `optimum` are for all
    problems; where they are None, what the runs know counts. StoreError for a study without a finished run.
    """
    groups: list[list[int]] = []
    for n in numbers:
        for group in groups:
            if _same_problem(store, group[0], n):
                group.append(n)
                break
        else:
            groups.append([n])
    return [_united(store, group, floor, optimum) for group in groups]


def _same_problem(store: Store, first: int, second: int) -> bool:
    if store.study(first).coordinates != store.study(second).coordinates:
        return False
    before, now = store.probe(first), store.probe(second)
    try:
        check_same(before, now, first)
    except StoreError:
        return False
    return len(before) > 0


def _united(store: Store, numbers: Sequence[int], floor: float | None, optimum: float | None) -> ProblemRuns:
    studies = [store.study(n) for n in numbers]
    twice = {m for s in studies for m in s.plan["methods"] if sum(m in other.plan["methods"] for other in studies) > 1}
    runs: list[RunRecord] = []
    budgets: dict[str, float] = {}
    for study in studies:
        own = store.runs(study.id)
        if not own:
            raise StoreError(
                f"Study {study.id} ({study.name}) in {store.name} has no "
                f"finished run yet; go on with `plantfit resume {study.id}`."
            )
        names = {m: f"{m} (study {study.id})" if m in twice else m for m in study.plan["methods"]}
        runs += [replace(r, method=names[r.method]) for r in own]
        budgets |= {name: float(study.plan["budget"]) for name in names.values()}
    return ProblemRuns(
        name=" and ".join(dict.fromkeys(s.name for s in studies)),
        runs=tuple(runs),
        coordinates=studies[0].coordinates,
        budgets=budgets,
        floor=_known(runs, FLOOR) if floor is None else floor,
        optimum=_known(runs, OPTIMUM) if optimum is None else optimum,
        studies=tuple(numbers),
        notes=tuple(note for s in studies for note in (*_unfinished(s), *s.notes)),
    )


def _known(runs: Sequence[RunRecord], key: str) -> float | None:
    found = (r.extra.get(key) for r in runs)
    return next((float(v) for v in found if isinstance(v, int | float) and np.isfinite(v)), None)


def _unfinished(study: StudyRecord) -> tuple[str, ...]:
    if study.runs_done == study.runs_total:
        return ()
    return (
        f"Study {study.id} ({study.name}) is unfinished: {study.runs_done} of {study.runs_total} runs are compared.",
    )
