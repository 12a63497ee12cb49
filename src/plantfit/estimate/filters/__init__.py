"""Kalman filters over states and parameters, and maximum likelihood by their prediction errors."""
