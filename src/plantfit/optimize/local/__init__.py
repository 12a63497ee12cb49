"""Local searches: one, many side by side, where they begin and which of them end in the same place."""
