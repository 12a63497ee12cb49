"""Every method against a reference implementation on the BBOB functions; run `python -m benchmarks.bbob --help`."""
