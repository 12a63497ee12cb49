"""Sections of the steam chamber's page, and their figures."""
