"""Cleaning: units and offsets, gaps, outliers, filters, new time grids, parts."""
