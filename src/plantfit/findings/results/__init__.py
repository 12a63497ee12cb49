"""The records of what other functions than `fit` find, a file for each; `all_results.py` has them by name and gives
their schemas."""
