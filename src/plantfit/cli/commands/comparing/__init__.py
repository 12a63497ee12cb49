"""`plantfit compare`: models of the same data, or search methods over their runs."""
