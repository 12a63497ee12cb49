"""Commands from a finished study to the next experiment, to a controller, and to other programs."""
