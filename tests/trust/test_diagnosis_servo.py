"""A motor that is held in place: dry friction that sticks looks like a dead zone of its input."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit
from plantfit.trust.diagnosis import diagnose, diagnosis_record, sentences

STEP, SAMPLE, COUNT = 5e-4, 10, 24_000  # s, steps a sample, steps
GAIN, TAU = 12.0, 0.08  # rad/s per V, s
SLOT = 0.0031416  # rad


def servo(friction, dead_zone):
    """A position that a P controller brings to steps: every sample its time, voltage and angle in slots."""
    rng = np.random.default_rng(5)
    at = speed = goal = volts = 0.0
    rows = []
    for k in range(COUNT):
        if k % 2000 == 0:
            goal = rng.choice([-2.0, -1.0, 0.0, 0.5, 1.0, 2.0])
        if k % SAMPLE == 0:
            seen = np.round(at / SLOT) * SLOT
            volts = float(np.clip(8.0 * (goal - seen), -5.0, 5.0))
            rows.append((k * STEP, volts, seen))
        drive = GAIN * np.sign(volts) * max(abs(volts) - dead_zone, 0.0)
        if speed == 0.0 and abs(drive) / TAU <= friction:
            continue
        way = np.sign(speed) if speed else np.sign(drive)
        end = drive - TAU * friction * way
        later = end + (speed - end) * np.exp(-STEP / TAU)
        at += end * STEP + TAU * (speed - later)
        speed = 0.0 if friction and later * speed < 0.0 else later
    return np.array(rows).T


def trial(kind, explained, fitted=True) -> Any:
    return SimpleNamespace(
        extension=SimpleNamespace(kind=kind, signal="w"), explained=explained, at=object() if fitted else None
    )


@pytest.mark.parametrize(
    ("found", "dry", "said"),
    [
        ("dead_zone", trial("coulomb", 0.97), True),
        ("dead_zone", trial("coulomb", 0.8), False),  # far less than the dead zone
        ("dead_zone", trial("coulomb", 0.97, fitted=False), False),
        ("dead_zone", trial("stribeck", 0.97), False),
        ("offset", trial("coulomb", 0.97), False),
    ],
)
def test_friction_is_named_beside_a_dead_zone_that_it_comes_near(monkeypatch, found, dry, said):
    monkeypatch.setattr(sentences, "_figures", lambda d, t: "")
    own = trial(found, 0.99)
    d: Any = None
    one: Any = SimpleNamespace(found=[own], trials=[own, dry])
    text = sentences._holding_friction(d, one)
    assert ("So does dry friction of w that holds the plant at rest" in text) is said
    assert ("friction(w, F) subtracted in the rate of w." in text) is said


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "dead_zone", "said"), [(9.0, 0.0, True), (0.0, 0.27, False)])
def test_friction_that_sticks_is_named_beside_a_dead_zone(friction, dead_zone, said):
    t, volts, angle = servo(friction, dead_zone)
    model = equations(
        "th' = w\nw' = (K*volt - w)/tau\nangle = th",
        inputs={"volt": "V"},
        states={"th": {"unit": "rad", "initial": "angle"}, "w": {"unit": "rad/s", "initial": 0.0}},
        outputs={"angle": "rad"},
        parameters=["K", "tau"],
    )
    record = Recording(t, {"volt": Signal(volts, "V"), "angle": Signal(angle, "rad")}, "run")
    box = {"K": Parameter((0.1, 100.0), scale="log"), "tau": Parameter((0.005, 2.0), scale="log")}
    answer = fit(Problem(model, record, box, split=0.7), seed=1)
    found = " ".join(s["sentence"] for s in diagnosis_record(diagnose(answer.problem, answer.best.x))["verdict"])
    assert found.startswith("A dead zone of ")
    assert ("So does dry friction of w that holds the plant at rest" in found) is said
