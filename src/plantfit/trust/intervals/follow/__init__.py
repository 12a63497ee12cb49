"""Ranges followed on the problem: `following.py` all, `followed.py` one end, `refits.py` one place on the way,
`room.py` how far beyond the bounds of the search."""
