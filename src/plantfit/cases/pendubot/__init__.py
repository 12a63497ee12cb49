"""The pendubot: torque of a double pendulum driven at its first joint."""
