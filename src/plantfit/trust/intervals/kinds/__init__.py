"""Intervals of other kinds than the verdict's: refits of resampled residuals (`bootstrap.py`), draws by NUTS
(`posterior.py`) under a likelihood of white or autoregressive noise (`noise.py`), priors (`priors.py`), and what is
said where kinds disagree (`told.py`)."""
