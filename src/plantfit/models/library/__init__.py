"""The models that come with plantfit; `catalogue.py` lists them by name."""
