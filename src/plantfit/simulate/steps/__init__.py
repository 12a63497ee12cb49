"""One step, and where steps end: steppers, events, dry friction, delays, times known beforehand."""
