"""A sampled controller on a plant: sensors, controller, actuators, dead time."""
