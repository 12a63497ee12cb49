"""A plate heat exchanger: one table model over a staircase, and two recordings of another season."""
