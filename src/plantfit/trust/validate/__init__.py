"""Tests of residuals, unseen data, models compared."""
