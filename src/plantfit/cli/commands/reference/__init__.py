"""Commands that list what there is, and that tune the settings of a method."""
