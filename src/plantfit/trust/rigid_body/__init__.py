"""Rigid bodies: what physics allows, and proven bounds on the cost of a regression."""
