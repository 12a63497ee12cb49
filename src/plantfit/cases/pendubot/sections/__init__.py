"""Sections of the pendubot's page, and their figures."""
