"""The records of commands by name, and their JSON schemas."""

from typing import Any

from plantfit.errors import SpecError
from plantfit.findings.record import Printed
from plantfit.findings.results.estimated import EstimatesByMethod
from plantfit.findings.results.first_look import FirstLook
from plantfit.findings.results.held_plant import HeldPlant
from plantfit.findings.results.intervals_compared import ComparisonOfIntervals
from plantfit.findings.results.methods_compared import ComparisonOfMethods
from plantfit.findings.results.models_compared import ComparisonOfModels
from plantfit.findings.results.next_experiment import NextExperiment
from plantfit.findings.results.predicted import Predicted
from plantfit.findings.results.records_compared import ComparisonOfRecords
from plantfit.findings.results.sensitivity import Sensitivities
from plantfit.findings.results.tracked import Tracked
from plantfit.findings.results.tuned_controller import TunedController

RESULTS: dict[str, type[Printed]] = {
    "compare": ComparisonOfModels,
    "compare --methods": ComparisonOfMethods,
    "compare-records": ComparisonOfRecords,
    "intervals": ComparisonOfIntervals,
    "design": NextExperiment,
    "tune": TunedController,
    "tune --hold": HeldPlant,
    "predict": Predicted,
    "estimate": EstimatesByMethod,
    "track": Tracked,
    "sensitivity": Sensitivities,
    "look": FirstLook,
}
"""What `plantfit NAME --json` prints; `compare` of models."""


def result_schema(name: str) -> dict[str, Any]:
    """The JSON schema of what `plantfit NAME --json` prints. Raises SpecError for a command without one."""
    if name not in RESULTS:
        raise SpecError(f"There is no schema of {name!r}; there are {', '.join(RESULTS)}, and --findings for run.")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **RESULTS[name].model_json_schema()}
