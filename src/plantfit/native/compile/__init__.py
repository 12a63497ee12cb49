"""From LLVM text to a function that XLA calls."""
