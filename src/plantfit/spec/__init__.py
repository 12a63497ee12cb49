"""The study file: TOML to recordings, model, space, problem and plan."""

from plantfit.spec.recordings import CLEANING, read_recording, recording_file
from plantfit.spec.study import Study, load, parse
from plantfit.spec.tables import SpecTable, validated

__all__ = ["CLEANING", "SpecTable", "Study", "load", "parse", "read_recording", "recording_file", "validated"]
