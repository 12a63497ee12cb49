"""Equations as text: read, checked with units, and made a model by `equations.py`; `functions.py` lists what they
may call."""
