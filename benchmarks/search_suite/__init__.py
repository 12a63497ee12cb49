"""Problems with many optima whose best one is known, and what judges a search by them."""
