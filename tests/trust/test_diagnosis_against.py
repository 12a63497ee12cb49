"""Why an addition that explains much is not named: what the sentence says is what is against it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit
from plantfit.trust.diagnosis import diagnose, diagnosis_record
from plantfit.trust.diagnosis.rounds import Round, Trial, why_not
from plantfit.trust.diagnosis.sentences import _fails

N = 600


def said_of(kind, seed=1):
    """A lag whose output has a drift that turns where the unseen part begins, one that never turns, noise that
    wanders, or noise alone."""
    rng, t = np.random.default_rng(seed), np.arange(float(N))
    u, x = np.repeat(rng.uniform(0, 1, N // 20), 20), np.zeros(N)
    for k in range(N - 1):
        x[k + 1] = x[k] + 0.1 * (2.0 * u[k] - x[k])
    slow, steps = np.zeros(N), 0.03 * rng.standard_normal(N)
    for k in range(N - 1):
        slow[k + 1] = 0.99 * slow[k] + steps[k]
    drift = {
        "turning": np.where(t < 400, 0.004 * t, 1.6 - 0.02 * (t - 400)),
        "straight": 0.004 * t,
        "wandering": slow,
        "clean": np.zeros(N),
    }[kind]
    y = x + drift + 0.01 * rng.standard_normal(N)
    recording = Recording(t, {"u": Signal(u, "1"), "y": Signal(y, "1")}, "log")
    model = equations(
        "x' = (K*u - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"],
        parameters=["K", "tau"], check=False,
    )  # fmt: skip
    parameters = {"K": Parameter((0.1, 10.0)), "tau": Parameter((1.0, 100.0), scale="log")}
    answer = fit(Problem(model, recording, parameters, split=0.66), budget=1000)
    return diagnosis_record(diagnose(answer.problem, answer.best.x, rounds=1))["verdict"]


@pytest.mark.thorough
def test_an_addition_that_unseen_data_refute_is_told_as_that():
    said = said_of("turning")[0]["sentence"]
    assert said.startswith("None of the ")
    assert "A drift of 0.00" in said
    assert " explains 99.9 % of what is left on the fitted samples (RMSE 0." in said
    assert "predicts the unseen ones worse. The " in said
    assert "log-likelihood" not in said


@pytest.mark.thorough
def test_an_addition_that_chance_may_be_is_told_as_that():
    said = said_of("wandering", 2)[0]["sentence"]
    assert "of what is left, which may be chance: its evidence, twice the gain of log-likelihood, is" in said
    assert "unseen" not in said


@pytest.mark.parametrize("kind", ["straight", "clean"])
@pytest.mark.further(1)
def test_what_is_named_and_what_explains_nothing_have_nothing_against_them(kind):
    said = " ".join(v["sentence"] for v in said_of(kind))
    assert ("A drift of 0.004" in said and "missing" in said) is (kind == "straight")
    assert ("Nothing that was tried explains more than" in said) is (kind == "clean")
    for words in ("hold", "chance", "worse"):
        assert words not in said


def trial(explained=0.92, evidence=50.0, unseen: float | None = 0.5, value=0.3, error=0.01, at: Any = "a fit"):
    candidate: Any = SimpleNamespace(level=False, phrase="an effect of {} on {}")
    own: Any = SimpleNamespace(candidate=candidate, place="input", kind="", signal="u", unit="V")
    later = None if unseen is None else (1.0, 1.0 - unseen)
    return Trial(own, explained, evidence, (1.0, 0.3), unseen, later, value, error, at)


@pytest.mark.parametrize(
    ("one", "why", "told"),
    [
        (trial(), None, ""),
        (trial(unseen=-0.4), "unseen", "(RMSE 1 to 0.3 V; unseen data 1 to 1.4), and predicts the unseen ones worse."),
        (trial(evidence=9.0, unseen=None), "chance", "which may be chance: its evidence, twice the gain of"),
        (trial(unseen=None), "not judged", "of what is left, and was not tried on unseen data."),
        (trial(at=None), "not fitted", "of what is left by its derivatives; it was not fitted."),
        (trial(error=0.2), "near zero", "and that size is within 2 standard errors of 0."),
        (trial(value=1.7e11, error=1.0), "no slope", "An effect of 1.7e+11 V on u explains 92 % of what is left, and"),
    ],
)
def test_every_reason_has_its_words(one, why, told):
    rows = SimpleNamespace(fit=np.ones(400, dtype=bool))
    given = SimpleNamespace(outputs=["y"], model=SimpleNamespace(outputs={"y": "V"}))
    carrier: Any = SimpleNamespace(rows=rows, given=given)
    nothing = np.zeros(400, dtype=bool)
    assert why_not(one, carrier, 12.0, rows.fit, ~nothing) == why
    d: Any = SimpleNamespace(carrier=carrier, apart=nothing, unseen_blocks=False)
    said = _fails(d, Round((), (one, trial(explained=0.01)), (), 12.0), "None")
    assert told in said
    assert (said == "") is (why is None)
    assert ("exact to rounding" in said) is False
    none = _fails(d, Round((), (trial(at=None), trial(0.5, unseen=None)), (), 12.0), "Beside that, none")
    assert none.startswith("Beside that, no addition was tried in full. An effect of ")
    alone = _fails(d, Round((), (one,), (), 12.0), "None")
    assert alone.startswith("The one addition that was tried does not hold. An effect of ") is (why is not None)
    several = _fails(d, Round((), (one, trial(0.5, unseen=-1.0), trial(0.4, 9.0, None)), (), 12.0), "Beside that, none")
    if why is not None:
        counted = {"not fitted": "2 additions to the model that were tried holds. ",
                   "not judged": "2 additions to the model that were tried in full holds. "}  # fmt: skip
        most = "3 additions to the model that were tried holds. "
        assert several.startswith(f"Beside that, none of the {counted.get(why, most)}")
        assert several.endswith("Of 2 others that explain 5 % or more 1 makes unseen data worse and 1 may be chance.")
