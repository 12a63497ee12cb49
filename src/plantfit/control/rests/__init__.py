"""Where plants rest with an output at a level: Newton's method, and a search that goes on where it fails."""
