"""Workload S: ten step responses of a steam chamber, 24 400 samples, 310 parameters, against hand-written C and
other solvers."""
