"""Parts that models are made of: tables, friction, linear blocks, smooth corners, events and backlash."""
