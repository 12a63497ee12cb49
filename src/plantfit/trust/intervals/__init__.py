"""Standard errors, and ranges of parameters."""
