"""CMA-ES, its separable and diagonal forms, and its restarts."""
