"""The search methods, one file each; `optimize/registry.py` lists them by name."""
