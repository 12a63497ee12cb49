"""The hierarchic memetic strategy: a tree of populations, and where it may grow."""
