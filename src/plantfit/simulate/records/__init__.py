"""Many records at once: their layout, and the compiled loops over them with derivatives."""
