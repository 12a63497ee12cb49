"""The study file: TOML to recordings, model, space, problem and plan."""

from plantfit.spec.in_combinations import Rewritten, in_combinations
from plantfit.spec.recordings import CLEANING, read_recording, recording_file
from plantfit.spec.study import Study, load, model_of, parse
from plantfit.spec.tables import SpecTable, validated

__all__ = [
    "CLEANING",
    "Rewritten",
    "SpecTable",
    "Study",
    "in_combinations",
    "load",
    "model_of",
    "parse",
    "read_recording",
    "recording_file",
    "validated",
]
