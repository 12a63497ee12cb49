"""Do the recordings agree: each fitted alone, its parameters beside those of the others, and what may be said of it."""
