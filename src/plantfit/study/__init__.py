"""Studies: many seeded runs with an equal budget, kept in a database that survives being killed.

from plantfit.study import Plan, Store, resume, run

store = Store.open("gearmotor.db")
study_id = run(Plan(name="gearmotor", methods=("auto", "pso"), runs=20, budget=5000, seed=1), objective, store)
resume(store, study_id, objective)
"""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.study.comparing.basins import Basin, basins
    from plantfit.study.comparing.pairwise import PairInTime, a12, compare, holm
    from plantfit.study.comparing.statistics import (
        RunsSummary,
        bootstrap_interval,
        costs_by_method,
        evaluations_to_target,
        expected_running_time,
        success_rate,
        summarise,
        t_interval,
        wilson_interval,
    )
    from plantfit.study.objective import objective_of
    from plantfit.study.plan import Plan, Task, tasks
    from plantfit.study.running.helper_processes import helping
    from plantfit.study.running.runner import begin, resume, run
    from plantfit.study.running.study_progress import StudyProgress
    from plantfit.study.store.records import RunRecord, StudyRecord
    from plantfit.study.store.store import Store
    from plantfit.study.versions import cpu_model, versions

__all__ = [
    "Basin",
    "PairInTime",
    "Plan",
    "RunRecord",
    "RunsSummary",
    "Store",
    "StudyProgress",
    "StudyRecord",
    "Task",
    "a12",
    "basins",
    "begin",
    "bootstrap_interval",
    "compare",
    "costs_by_method",
    "cpu_model",
    "evaluations_to_target",
    "expected_running_time",
    "helping",
    "holm",
    "objective_of",
    "resume",
    "run",
    "success_rate",
    "summarise",
    "t_interval",
    "tasks",
    "versions",
    "wilson_interval",
]

names_of(
    __name__,
    {
        "comparing.basins": "Basin basins",
        "comparing.pairwise": "PairInTime a12 compare holm",
        "running.helper_processes": "helping",
        "objective": "objective_of",
        "plan": "Plan Task tasks",
        "running.study_progress": "StudyProgress",
        "store.records": "RunRecord StudyRecord",
        "running.runner": "begin resume run",
        "comparing.statistics": "RunsSummary bootstrap_interval costs_by_method "
        "evaluations_to_target expected_running_time success_rate summarise t_interval wilson_interval",
        "store.store": "Store",
        "versions": "cpu_model versions",
    },
)
