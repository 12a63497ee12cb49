"""Looks at a recording before any fit: what of its signals and its clock would mislead one."""

from plantfit.recording.looks.clock import clock_looks
from plantfit.recording.looks.look import Look
from plantfit.recording.looks.signals import feedback_look, signal_looks

__all__ = ["Look", "clock_looks", "feedback_look", "signal_looks"]
