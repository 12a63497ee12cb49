"""Text tables: how they begin, the careful way and the quick one."""
