"""What runs a method: budget, checkpoints, progress; `entry.py` is the way in."""
