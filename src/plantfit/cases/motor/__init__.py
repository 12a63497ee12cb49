"""A DC motor on a microcontroller's bench: surrogate, two error signals, and what its speed alone determines."""
