"""The findings of an answer: the one definition from which JSON, schema, checks and the page of the docs are made."""

import inspect
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError, field_validator

from plantfit.errors import PlantfitError
from plantfit.findings.diagnosis import Diagnosis
from plantfit.findings.filtered import FilteredAnswer
from plantfit.findings.heterogeneity import Heterogeneity
from plantfit.findings.parameters import Combination, Determined, Parameter, StandardErrors
from plantfit.findings.record import READ, Record
from plantfit.findings.recordings import Recording, Score, Weight
from plantfit.findings.residuals import CorrelatedResiduals, ResidualTest, ShortRecordings
from plantfit.findings.runs import Agreement, Basin, Run
from plantfit.findings.simulation import Reproduction, Simulation
from plantfit.findings.tables import OperatingTable, SmoothedTable
from plantfit.findings.uncertainty import Uncertainty
from plantfit.findings.verdict import Sentence
from plantfit.recording.looks.look import Look

VERSION = 1


class Findings(Record):
    """What `plantfit.trust.assess` finds of an answer: `plain()` is `answer.findings`, and `plantfit run --json`
    without the samples."""

    schema_version: int = VERSION
    """Of these records; another one where keys change their meaning or go, the same where keys are added."""
    name: str
    """Of the problem."""
    recordings: list[Recording] = []
    """Signals, measured and simulated."""
    scores: list[Score] = []
    """How well fitted and unseen samples are followed, by recording, output and part."""
    residual_tests: list[ResidualTest] = []
    """By recording and output."""
    short_recordings: list[ShortRecordings] = []
    """By output, where recordings are too short for tests of their own."""
    correlated: CorrelatedResiduals | None = None
    """None where residuals are white, or cannot be taken for noise that is correlated."""
    filtered: FilteredAnswer | None = None
    """Where the answer is that of maximum likelihood or of a Kalman filter (`estimator`)."""
    data: list[Look] = []
    """What is odd about the recordings."""
    diagnosis: Diagnosis | None = None
    """None where none was made."""
    parameters: list[Parameter] = []
    """Free ones in the order of the search, then fixed ones; tables entry by entry."""
    differentiated: list[str] = []
    """Signals in the columns of a regression by least squares that are derivatives, with errors of their own."""
    uncertainty: Uncertainty | None = None
    """None where no errors were stated."""
    standard_errors: StandardErrors | None = None
    tables: list[OperatingTable] = []
    smoothing: list[SmoothedTable] = []
    combinations: list[Combination] = []
    """Of parameters that only act together, the least known first."""
    heterogeneity: Heterogeneity | None = None
    """None where there is nothing to test: one recording, nothing shared, a problem that is not linearised."""
    determined: Determined | None = None
    """None where the problem is not linearised: tables, many coordinates."""
    runs: list[Run] = []
    basins: list[Basin] = []
    agreement: Agreement | None = None
    weights: list[Weight] = []
    """By output."""
    simulation: Simulation | None = None
    reproduction: Reproduction | None = None
    verdict: list[Sentence] = []
    """What all of it means, in plain sentences."""

    @field_validator("schema_version")
    @classmethod
    def _not_newer(cls, version: int) -> int:
        if version > VERSION:
            raise ValueError(
                "it was written by a newer plantfit, in version "
                f"{version} of the record; this one reads up to {VERSION}"
            )
        return version


def read_findings(findings: Mapping[str, Any] | Findings) -> Findings:
    """The plain record as `Findings`; PlantfitError names the first place that does not fit."""
    try:
        return Findings.model_validate(findings, context=READ)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(step) for step in first["loc"]) or "its top level"
        raise PlantfitError(
            f"The findings record is wrong at {place} "
            f"({first['msg'].removeprefix('Value error, ')}); make it with plantfit.trust.assess."
        ) from None


def findings_schema() -> dict[str, Any]:
    """The JSON schema of `answer.findings`. `plantfit run --json` leaves the samples out and adds `report`, where
    the page is."""
    schema = Findings.model_json_schema()
    # pydantic before 2.13 leaves out words of a dataclass
    schema["$defs"]["Look"].setdefault("description", inspect.getdoc(Look))
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
