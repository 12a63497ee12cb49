"""Genetic algorithms, and the operators that they share."""
