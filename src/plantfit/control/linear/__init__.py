"""Designs on a linearised model: regulators, filters, predictive control, PID by pole placement."""
