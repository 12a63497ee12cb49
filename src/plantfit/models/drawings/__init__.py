"""Plants to begin with (`plantfit new --from`): lists of parts (.net), models of a study file (.toml); `offered.py`
reads them."""
