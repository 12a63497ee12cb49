"""Units of equations: what is declared is followed through every expression; what is not is solved for, and must not
contradict itself."""
