from typing import Any

import numpy as np
import pytest

from plantfit.errors import SearchError
from plantfit.study import Plan, Task, tasks


def test_tasks_cover_every_run_of_every_method_once_and_methods_take_turns():
    plan = Plan(name="p", methods=("random", "pso"), runs=11, budget=100, chunk=4)
    assert tasks(plan)[:3] == (Task("random", 0, 4), Task("pso", 0, 4), Task("random", 4, 4))
    covered = sorted((t.method, t.first + k) for t in tasks(plan) for k in range(t.count))
    assert covered == [(m, r) for m in ("pso", "random") for r in range(11)]
    for k in range(0, len(tasks(plan)), 2):  # a study stopped after any round has equally many runs of each
        rounds = tasks(plan)[: k + 2]
        assert sum(t.count for t in rounds if t.method == "pso") == sum(t.count for t in rounds if t.method == "random")


@pytest.mark.parametrize(("runs", "chunk"), [(1, 5), (20, 5), (50, 5), (200, 20), (1000, 100), (100_000, 100)])
def test_tasks_grow_with_the_number_of_runs(runs, chunk):
    plan = Plan(name="p", methods=("random",), runs=runs, budget=100)
    assert plan.chunk == chunk
    assert len(tasks(plan)) == -(-runs // chunk)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"budget": 0}, "budget is 0"),
        ({"budget": -5}, "budget is -5"),
        ({"budget": 10.5}, "budget is 10.5"),
        ({"runs": 0}, "runs is 0"),
        ({"runs": True}, "runs is True"),
        ({"runs": "20"}, "runs is '20'"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 2**31}, "seed is 2147483648"),
        ({"chunk": 0}, "chunk is 0"),
        ({"name": "  "}, "give it a name"),
        ({"methods": ()}, "no methods"),
        ({"methods": ("pso", "pso")}, "named twice"),
        ({"methods": (3,)}, "method 3"),
        ({"methods": ("psoo",)}, "psoo"),
        ({"settings": {"cmaes": {}}}, "'cmaes'"),
        ({"settings": {"pso": 3}}, "settings of 'pso'"),
        ({"settings": 3}, "settings is 3"),
        ({"settings": {"pso": {"no_such_setting": 1}}}, "no_such_setting"),
    ],
)
def test_a_plan_that_cannot_work_is_refused_in_one_sentence(change, words):
    given: dict[str, Any] = {"name": "p", "methods": ("random", "pso"), **change}
    with pytest.raises(SearchError) as caught:
        Plan(**given)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_record_and_back():
    plan = Plan(name="p", methods=["random", "pso"], runs=np.int64(3), settings={"pso": {"population": np.int64(12)}})  # pyrefly: ignore[bad-argument-type]
    assert Plan.from_record(plan.record()) == plan
    assert plan.methods == ("random", "pso")
    assert type(plan.runs) is int
    assert plan.settings == {"pso": {"population": 12}}


def test_one_method_may_be_given_as_text():
    assert Plan(name="p", methods="pso").methods == ("pso",)  # pyrefly: ignore[bad-argument-type]
