"""Signals made from others: derivatives, encoders, bridges, odometry, smoothed motion."""
