"""PIDs as C: one, in floating or fixed point, and controllers that are made of some."""
