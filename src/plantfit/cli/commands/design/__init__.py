"""Commands from a finished study to a controller, and to other programs."""
