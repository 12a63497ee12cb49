"""A plate heat exchanger with a sticking valve: one table model over a staircase, and two recordings of another season."""
