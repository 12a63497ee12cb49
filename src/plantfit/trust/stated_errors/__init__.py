"""Stated errors of instruments, clocks and constants: what they do to the parameters (GUM)."""
