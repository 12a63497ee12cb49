"""Settings of a method tuned on the user's problem: dials, racing, the tuner, its outcome."""
