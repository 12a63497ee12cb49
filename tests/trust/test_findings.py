"""The findings of a fit are the records that `plantfit.findings` defines: nothing is lost, the schema holds, and a
wrong one is named."""

import json
from typing import Any

import jsonschema
import numpy as np
import pytest
from pydantic import ValidationError

import plantfit as pf
from plantfit.errors import PlantfitError
from plantfit.findings import Agreement, Findings, Parameter, Record, findings_schema, read_findings
from plantfit.findings.whole import VERSION
from plantfit.problem import Problem
from plantfit.recording.looks import Look
from plantfit.recording.record import Recording, Signal
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.stated_errors.uncertainty_budget import type_b
from plantfit.trust.verdict.words import say

T = np.arange(240) * 0.5


def lag(late: float) -> Problem:
    """A lag whose input comes `late` s after the one that was recorded; the model knows of no dead time."""
    u = np.where((T // 20) % 2 == 0, 1.0, 0.0)
    came = np.interp(T - late, T, u)
    y = np.zeros(len(T))
    for k in range(1, len(T)):
        y[k] = y[k - 1] + (1 - np.exp(-0.5 / 4.0)) * (2.0 * came[k - 1] - y[k - 1])
    y += 0.02 * np.random.default_rng(5).normal(size=len(T))
    record = Recording(T, {"u": Signal(u, "V"), "y": Signal(y, "V")}, "run")
    model = pf.equations(
        "y' = (K*u - y)/tau", inputs={"u": "V"}, states={"y": "V"}, outputs={"y": "V"},
        parameters={"K": {"bounds": [0.1, 10.0]}, "tau": {"bounds": [0.1, 100.0], "unit": "s", "scale": "log"}},
    )  # fmt: skip
    return Problem(model, {"run": pf.Experiment(record, fit=(0.0, 80.0), validate=(80.0, 120.0))})


def table() -> Problem:
    u = np.linspace(-1.0, 1.0, 120)
    y = u**3 + 0.01 * np.random.default_rng(2).normal(size=120)
    record = Recording(np.arange(120) * 1.0, {"u": Signal(u, "V"), "y": Signal(y, "V")}, "run")
    model = pf.equations(
        "y = f(u) + c", inputs={"u": "V"}, outputs={"y": "V"},
        parameters={"f": {"bounds": [-5, 5]}, "c": {"value": 0.0}},
        tables={"f": {"over": ["u"], "nodes": [[-1.0, 0.0, 1.0, 2.0]], "unit": "V"}},
    )  # fmt: skip
    return Problem(model, {"run": record})


@pytest.fixture(scope="module")
def late() -> Any:
    answer = pf.fit(lag(2.0), errors=[SharedError(type_b("card", 0.05), "gain", "y")], budget=200, runs=2)
    answer.diagnose()
    return answer.findings


@pytest.fixture(scope="module")
def of_table() -> Any:
    return pf.fit(table(), budget=200).findings


def held(findings: dict[str, Any]) -> Findings:
    """Read, written and read again: the same bytes, and what other programs check by the schema."""
    text = json.dumps(findings, allow_nan=False)
    read = read_findings(json.loads(text))
    assert json.dumps(read.plain(), allow_nan=False) == text
    jsonschema.validate(json.loads(text), findings_schema())
    return read


@pytest.mark.thorough
def test_nothing_is_lost_and_the_schema_holds(late, of_table):
    read = held(late)
    assert read.schema_version == VERSION
    assert read.diagnosis is not None
    assert read.diagnosis.rounds[0].tried[0].kind
    assert read.uncertainty is not None
    assert {p.name for p in read.parameters} == {"K", "tau"}
    assert [t.name for t in held(of_table).tables] == ["f"]


def test_every_section_of_a_fit_is_a_field(late, of_table):
    assert set(late) == set(of_table) == set(Findings.model_fields)


@pytest.mark.parametrize("key", ["white", "unit", "value", "runs", "level"])
@pytest.mark.further(1)
def test_the_schema_refuses_what_is_wrong(late, key):
    """So that it is no schema that takes everything."""
    wrong = json.loads(json.dumps(late).replace(f'"{key}": ', f'"{key}": {{}}, "was {key}": '))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(wrong, findings_schema())
    with pytest.raises(PlantfitError, match=f"wrong at .*{key}"):
        read_findings(wrong)


def test_records_before_the_version_and_with_fewer_keys_are_read(late):
    old = {k: v for k, v in late.items() if k not in ("schema_version", "determined", "data")}
    old["parameters"] = [
        {k: v for k, v in p.items() if k not in ("open", "limits", "uncertainty")} for p in old["parameters"]
    ]
    read = read_findings(old)
    assert (read.schema_version, read.determined, read.parameters[0].open) == (VERSION, None, None)
    assert "schema_version" not in read.plain()


def test_a_newer_record_is_refused_by_a_sentence(late):
    with pytest.raises(PlantfitError, match=f"written by a newer plantfit, in version {VERSION + 1}"):
        read_findings({**late, "schema_version": VERSION + 1})


def test_what_is_not_finite_is_none():
    assert say("info", "x", share=float("nan"))["figures"] == {"share": None}
    assert Agreement(runs=1, agree=0, cost=float("inf")).plain() == {"runs": 1, "agree": 0, "cost": None}


def test_a_record_is_frozen_and_its_maker_is_told():
    row = Parameter(name="a", value=1.0)
    with pytest.raises(ValidationError, match="frozen"):
        row.value = 2.0  # pyrefly: ignore[read-only]
    with pytest.raises(ValidationError, match="status"):
        Parameter(name="a", value=1.0, status="sure")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(ValidationError, match="level"):
        say("grave", "x")


def test_keys_of_another_version_are_left_aside_and_a_maker_may_give_none(late):
    parameters: list[dict[str, Any]] = [{**p, "mood": "good"} for p in late["parameters"]]
    more = {**late, "mood": "good", "parameters": parameters}
    assert read_findings(more).plain() == late
    with pytest.raises(ValidationError, match="mood"):
        Parameter(**parameters[0])


def test_every_field_of_a_record_that_needs_words_has_them():
    """Units and meanings that a name does not tell; these are the page of the docs."""
    schema = findings_schema()
    assert all(d.get("description") for d in schema["$defs"].values())
    told = schema["$defs"]["Parameter"]["properties"]["open"]["description"]
    assert told == "Ends that the data do not set: `low` and `high` are bounds of the search there."
    assert len(Record.__subclasses__()) > 30


def test_a_look_is_of_the_recording(late):
    read = read_findings(
        {**late, "data": [Look("gaps", "info", "run", None, "Gaps.", 0.0, 1.0, figures={"gaps": 2}).record]}
    )
    assert isinstance(read.data[0], Look)
    assert json.dumps(read.plain()["data"][0]["figures"]) == '{"gaps": 2}'
