"""Every example in docs/models.md runs as it is printed, and declares what it is there to show."""

import re
from pathlib import Path

import numpy as np
import pytest

import plantfit as pf
from plantfit.models import Model
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.steps.vector import vectorise

PAGE = Path(__file__).resolve().parents[2] / "docs" / "models.md"
EXAMPLES = {
    section.split("\n")[0]: block
    for section in PAGE.read_text("utf-8").split("\n## ")[1:]
    for block in re.findall(r"```python\n(.*?)```", section, re.DOTALL)[-1:]
}
SHOWS = {
    "Tables": ("tables",),
    "Dead time": ("state_delays",),
    "Events": ("events",),
    "Friction that sticks": ("frictions",),
    "Backlash": ("backlashes",),
    "As Python functions": ("tables", "state_delays", "frictions", "backlashes", "events"),
}


def test_every_section_with_code_is_known():
    assert set(EXAMPLES) == {*SHOWS, "Regressions"}


@pytest.mark.parametrize("section", SHOWS)
def test_example_runs_and_shows_what_it_promises(section):
    names: dict = {}
    exec(compile(EXAMPLES[section], str(PAGE), "exec"), names)
    model = names["model"]
    assert isinstance(model, Model)
    assert all(getattr(model, kind) for kind in SHOWS[section])
    assert vectorise(model).outputs


def test_the_first_example_of_python_functions_runs():
    text = PAGE.read_text("utf-8").split("\n## As Python functions")[1]
    names: dict = {}
    exec(compile(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], str(PAGE), "exec"), names)
    assert [d.parameter for d in names["model"].delays] == ["L"]


def test_the_tables_are_described(capsys):
    exec(compile(EXAMPLES["Tables"], str(PAGE), "exec"), {})
    shown = capsys.readouterr().out
    assert "10 values, 0.1 to 1.5" in shown
    assert "4 values, = 30 to 70" in shown


def test_the_regression_finds_mass_and_length_through_its_base():
    names: dict = {}
    exec(compile(EXAMPLES["Regressions"], str(PAGE), "exec"), names)
    model, rng = names["model"], np.random.default_rng(0)
    signals = {n: rng.normal(size=200) for n in model.signals}
    tau = model.predict(signals, {"m": 0.7, "l": 0.4, "Fc": 0.1})
    recording = Recording(np.arange(200.0), {n: Signal(v, None) for n, v in {**signals, "tau": tau}.items()})
    answer = pf.fit(pf.Problem(model, recording), "least_squares", budget=1000)
    assert answer.values == pytest.approx({"m": 0.7, "l": 0.4, "Fc": 0.1}, rel=1e-6)


def test_the_pendubots_of_the_page_can_be_made():
    section = PAGE.read_text("utf-8").split("\n## Pendubot and double pendulum\n")[1].split("\n## ")[0]
    names: dict = {}
    exec("\n".join(line[4:] for line in section.splitlines() if line.startswith("    ")), names)
    assert list(names["plant"].inputs) == ["V"]
    assert list(names["torque"].coefficients) == ["b1", "b2", "b4", "b5"]
