"""Fits of the laws of friction, and their results."""
