"""Independent tight solvers, and how far the simulation is from them."""
