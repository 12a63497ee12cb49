"""What the data can tell: ranks, flat directions, combinations, and what to measure next."""
