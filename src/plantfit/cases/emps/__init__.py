"""EMPS, a linear drive with friction under PD control, training recording."""
