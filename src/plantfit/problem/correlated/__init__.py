"""Noise that is correlated from sample to sample, and least squares weighted for it."""
