"""Ranges followed on the problem: `following.py` all, `followed.py` one end, `room.py` how far beyond the bounds of
the search."""
