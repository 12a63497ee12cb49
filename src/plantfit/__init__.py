"""plantfit: physical parameters that can be trusted, from recordings of machines and processes.

Names are loaded when first used, so that importing plantfit stays quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plantfit import methods, models, recording
    from plantfit.answer import Answer
    from plantfit.controllers import Controller, tune
    from plantfit.errors import PlantfitError, Status
    from plantfit.estimators import Estimators, estimate_parameters
    from plantfit.experiment_design import ExperimentDesign, design
    from plantfit.fitting import fit
    from plantfit.intervals_compared import IntervalsCompared, compare_intervals
    from plantfit.models import equations
    from plantfit.models.model import Declared, Delay, Model
    from plantfit.optimize import Checkpoint, Objective, Progress, RunResult, minimise
    from plantfit.problem import Experiment, Problem, split
    from plantfit.recording import Recording, Signal, from_arrays, from_frame, read, read_csv
    from plantfit.records_compared import RecordsCompared, compare_records
    from plantfit.regression import Regressed, regress
    from plantfit.reopen import open_study
    from plantfit.report import write_report
    from plantfit.space import Parameter, Space
    from plantfit.spec import load
    from plantfit.study import Plan, Store, objective_of
    from plantfit.tracking import Alarm, Tracker, track
    from plantfit.which_model import ModelsCompared, compare_models

__version__ = "0.1.0"

_PLACES = {
    "Alarm": "plantfit.tracking",
    "Answer": "plantfit.answer",
    "Checkpoint": "plantfit.optimize",
    "Controller": "plantfit.controllers",
    "Declared": "plantfit.models.model",
    "Delay": "plantfit.models.model",
    "Estimators": "plantfit.estimators",
    "Experiment": "plantfit.problem",
    "ExperimentDesign": "plantfit.experiment_design",
    "Model": "plantfit.models.model",
    "ModelsCompared": "plantfit.which_model",
    "Objective": "plantfit.optimize",
    "Parameter": "plantfit.space",
    "Plan": "plantfit.study",
    "PlantfitError": "plantfit.errors",
    "Problem": "plantfit.problem",
    "Progress": "plantfit.optimize",
    "Recording": "plantfit.recording",
    "IntervalsCompared": "plantfit.intervals_compared",
    "RecordsCompared": "plantfit.records_compared",
    "Regressed": "plantfit.regression",
    "RunResult": "plantfit.optimize",
    "Signal": "plantfit.recording",
    "Space": "plantfit.space",
    "Status": "plantfit.errors",
    "Store": "plantfit.study",
    "Tracker": "plantfit.tracking",
    "compare_models": "plantfit.which_model",
    "compare_intervals": "plantfit.intervals_compared",
    "compare_records": "plantfit.records_compared",
    "design": "plantfit.experiment_design",
    "equations": "plantfit.models",
    "estimate_parameters": "plantfit.estimators",
    "fit": "plantfit.fitting",
    "hold": "plantfit.holding",
    "from_arrays": "plantfit.recording",
    "from_frame": "plantfit.recording",
    "load": "plantfit.spec",
    "minimise": "plantfit.optimize",
    "objective_of": "plantfit.study",
    "open_study": "plantfit.reopen",
    "read": "plantfit.recording",
    "read_csv": "plantfit.recording",
    "regress": "plantfit.regression",
    "split": "plantfit.problem",
    "track": "plantfit.tracking",
    "tune": "plantfit.controllers",
    "write_report": "plantfit.report",
}
_ROOMS = ("methods", "models", "recording")

__all__ = [
    "Alarm",
    "Answer",
    "Checkpoint",
    "Controller",
    "Declared",
    "Delay",
    "Estimators",
    "Experiment",
    "ExperimentDesign",
    "IntervalsCompared",
    "Model",
    "ModelsCompared",
    "Objective",
    "Parameter",
    "Plan",
    "PlantfitError",
    "Problem",
    "Progress",
    "Recording",
    "RecordsCompared",
    "Regressed",
    "RunResult",
    "Signal",
    "Space",
    "Status",
    "Store",
    "Tracker",
    "compare_intervals",
    "compare_models",
    "compare_records",
    "design",
    "equations",
    "estimate_parameters",
    "fit",
    "from_arrays",
    "from_frame",
    "load",
    "methods",
    "minimise",
    "models",
    "objective_of",
    "open_study",
    "read",
    "read_csv",
    "recording",
    "regress",
    "split",
    "track",
    "tune",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        value = getattr(import_module(_PLACES[name]), name)
        globals()[name] = value
        return value
    if name in _ROOMS:
        return import_module(f"plantfit.{name}")
    raise AttributeError(f"module 'plantfit' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
