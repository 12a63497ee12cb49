"""The steam chamber: a nonlinear plant with dead time, its coefficients tables over the pressure."""
