"""Figures of the pages beside the report of a fit: a first look, proposed inputs, sensitivity, estimated constants."""
