"""Differential evolution with fixed settings or a success history."""
