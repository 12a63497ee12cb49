"""Timings of the engine against other solvers; run `python -m benchmarks`, with QUICK=1 for a short round."""
