"""The controllers that `plantfit tune` searches, by name: study files, the command's help and `Wishes` read this list.

Nothing here imports jax, so that a study file is checked at once.
"""

CONTROLLERS = ("pid", "pi", "smith", "cascade", "scheduled", "lqi", "mpc")
"""Of one loop (docs/architecture.md, "A controller form", says what a new one needs)."""
REGULATOR = "lqr"
"""Of all states, which holds an equilibrium (`control/holding/`)."""
