"""A parameter, a load or a sensor that is another one from a moment on: where that may be, and the plant with it."""
