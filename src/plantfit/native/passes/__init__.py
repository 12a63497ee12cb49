"""Passes over the graph, and what they find out."""
