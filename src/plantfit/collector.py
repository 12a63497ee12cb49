"""How seldom Python looks for cycles in a process that plantfit began itself."""

import gc

# A command makes a million objects that stay, most of them by importing jax and by tracing programs. At Python's own
# 700 new objects the collector of cycles walks through them again and again, which takes a sixth of a `plantfit check`;
# at its end another third is one walk through all of them.
COLLECTED = (50_000, 20, 20)


def seldom() -> None:
    """Look for cycles less often than Python does; for a whole process, so that none of a user's own is touched."""
    gc.set_threshold(*COLLECTED)


def left() -> None:
    """At the end of a process: what is left goes with it; `atexit` and finalizers run as ever."""
    gc.freeze()
