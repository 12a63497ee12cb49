"""Signals that are played into a plant to identify it: recordings with one signal, and a log that says how it was
made."""

from plantfit.recording.excitation.c_header import c_header, to_c_header
from plantfit.recording.excitation.limits import limited
from plantfit.recording.excitation.multisine import multisine
from plantfit.recording.excitation.prbs import prbs
from plantfit.recording.excitation.spectrum import amplitude_spectrum, crest_factor
from plantfit.recording.excitation.sweeps import chirp, sine_square, staircase

__all__ = [
    "amplitude_spectrum",
    "c_header",
    "chirp",
    "crest_factor",
    "limited",
    "multisine",
    "prbs",
    "sine_square",
    "staircase",
    "to_c_header",
]
