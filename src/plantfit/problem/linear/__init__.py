"""Which coordinates enter the residuals linearly, read from the equations."""
