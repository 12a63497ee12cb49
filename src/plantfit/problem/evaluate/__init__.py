"""Residuals, costs and derivatives of a problem at points of the unit cube."""
