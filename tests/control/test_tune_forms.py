"""Every controller of `plantfit tune` is known at each place that has to know it (docs/architecture.md, "A
controller form")."""

import inspect
import re
from pathlib import Path

from plantfit import controllers
from plantfit.control.tune import loop_design
from plantfit.control.tune.forms.names import CONTROLLERS, REGULATOR

ROOT = Path(__file__).resolve().parents[2]
PIDS = {"pid", "pi"}  # one form, which is named after the PID in C
FALLS_THROUGH = {"lqi"}  # what `_ahead_of_pid` makes of every name that it does not compare with


def test_every_controller_has_its_form():
    code = inspect.getsource(loop_design._ahead_of_pid) + inspect.getsource(controllers.tune)
    missing = [name for name in CONTROLLERS if f'"{name}"' not in code and name not in FALLS_THROUGH]
    assert missing == [], (
        f"return the form of {missing} in `_ahead_of_pid` of control/tune/loop_design.py; now it gets an LQI"
    )


def test_every_controller_has_a_name_in_c():
    missing = sorted({*CONTROLLERS, REGULATOR} - PIDS - set(controllers.C_NAMES.values()))
    assert missing == [], (
        f"add the `Form.name` of {missing} to C_NAMES in src/plantfit/controllers.py; now its C file ends in _pid"
    )


def test_the_page_on_tuning_names_every_controller():
    (row,) = re.findall(
        r"^\| `controller` \| (.*) \|$", (ROOT / "docs" / "tuning-controllers.md").read_text("utf-8"), re.MULTILINE
    )
    missing = [name for name in (*CONTROLLERS, REGULATOR) if f'"{name}"' not in row]
    assert missing == [], f"name {missing} in the row `controller` of docs/tuning-controllers.md"


def test_every_controller_is_tuned_in_a_test():
    tests = "".join(p.read_text("utf-8") for p in (ROOT / "tests" / "control").glob("test_tune_*.py"))
    missing = [
        name
        for name in CONTROLLERS
        if not re.search(rf"controller[\"']?\s*[=:,]\s*[\"']{name}[\"']", tests) and name not in PIDS
    ]
    assert missing == [], f"write tests/control/test_tune_NAME.py for {missing}, as test_tune_smith.py"
