"""Figures of methods compared: answers, costs, curves."""
