"""From a few numbers that a search moves to a controller for one identified plant."""
