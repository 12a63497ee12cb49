"""What a form of controller is searched for: figures, limits, one controller or a front of several."""
