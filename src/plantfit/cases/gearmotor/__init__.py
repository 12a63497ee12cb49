"""A geared DC motor (Universidad Nacional de Colombia) on a PRBS, and its static curve."""
