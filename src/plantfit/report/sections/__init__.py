"""Sections of the report of a fit, and the sentences and tables that pages share."""
