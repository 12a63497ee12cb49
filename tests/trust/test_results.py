"""Results of other commands than `run` are records: the schema holds, a wrong maker is told, and the page of the
docs has their words."""

import json
from typing import Any

import jsonschema
import numpy as np
import pytest
from pydantic import ValidationError

from plantfit.errors import SpecError
from plantfit.findings.results.all_results import RESULTS, result_schema
from plantfit.findings.results.models_compared import ComparisonOfModels, ModelPair
from plantfit.first_look import look
from plantfit.recording.record import Recording, Signal
from plantfit.trust.which_model.candidates import Candidate
from plantfit.trust.which_model.common_data import Series
from plantfit.trust.which_model.comparison import compared

T = np.arange(200) * 0.1


def two_models() -> ComparisonOfModels:
    """A line, and a model that cannot be simulated."""
    y = np.sin(T) + 0.1 * np.random.default_rng(1).normal(size=200)
    series = (Series("r", "y", "V", T, y, T < 12.0, T >= 12.0),)
    return compared(
        series,
        (Candidate("sine", 1, 1.0, (np.sin(T),)), Candidate("lost", 1, 1.0, (np.full(200, np.inf),))),
        {"y": 1.0},
    )


def test_what_is_printed_keeps_its_schema_and_leaves_samples_out():
    found = two_models()
    printed = found.printed(studies={"sine": 1}, written={"report": "a.html"})
    text = json.dumps(printed, allow_nan=False)
    jsonschema.validate(json.loads(text), result_schema("compare"))
    assert "series" in found.plain()
    assert [k for k in printed if k not in found.plain()] == ["studies", "written"]
    assert "series" not in printed
    assert printed["models"][1]["rmse"]["unseen"] is None  # what is not finite
    assert found.verdict[0].sentence.startswith("sine predicts unseen data better")


def test_a_first_look_keeps_its_schema():
    u = np.repeat(np.random.default_rng(2).normal(size=40), 5)
    found = look(Recording(T, {"u": Signal(u, "V"), "y": Signal(np.r_[0.0, 2 * u[:-1]], "K")}, "run"), ["u"], ["y"])
    jsonschema.validate(
        json.loads(json.dumps(found.printed(written="look.html"), allow_nan=False)), result_schema("look")
    )
    assert found.outputs[0].pairs[0].input == "u"


@pytest.mark.parametrize("command", RESULTS)
def test_every_record_and_what_needs_words_is_described(command):
    schema = result_schema(command)
    assert schema["additionalProperties"] is False
    assert all(d.get("description") for d in (schema, *schema["$defs"].values()))
    jsonschema.Draft202012Validator.check_schema(schema)
    with pytest.raises(jsonschema.ValidationError, match="mood"):
        jsonschema.validate({"mood": "good"}, schema)


def test_a_maker_is_told_of_a_key_and_a_value_that_the_record_does_not_know():
    own: dict[str, Any] = two_models().pairs[0].plain()
    assert ModelPair(**own).plain() == own
    with pytest.raises(ValidationError, match="mood"):
        ModelPair(**own | {"mood": "good"})
    with pytest.raises(ValidationError, match="over"):
        ModelPair(**own | {"over": "luck"})
    with pytest.raises(ValidationError, match="frozen"):
        two_models().pairs[0].told = True  # pyrefly: ignore[read-only]


def test_a_command_without_a_schema_is_named():
    with pytest.raises(
        SpecError, match="There is no schema of 'comparing'; there are compare, compare --methods, compare-records"
    ):
        result_schema("comparing")
