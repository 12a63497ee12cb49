"""Run as a script by test_study_kill.py: works on a slow study until it is done or killed.

python killed_child.py DATABASE      starts study 1, or goes on with it
"""

import sys

from worked_study import objective

from plantfit.study import Plan, Store, resume, run

PLAN = Plan(
    name="killed", methods=("lbfgsb", "pso"), runs=3, budget=900, seed=11, settings={"pso": {"population": 10}}, chunk=2
)

if __name__ == "__main__":
    store = Store.open(sys.argv[1])
    if store.studies():
        resume(store, 1, objective(0.02), checkpoint_seconds=0.1)
    else:
        run(PLAN, objective(0.02), store, checkpoint_seconds=0.1)
