"""Controllers and filters as self-contained C99 for a microcontroller."""

from plantfit.control.c_export.design_in_c import design_to_c
from plantfit.control.c_export.files import CFiles
from plantfit.control.c_export.kalman_in_c import kalman_to_c
from plantfit.control.c_export.mpc_in_c import servo_mpc_to_c
from plantfit.control.c_export.pid_in_c import pid_to_c
from plantfit.control.c_export.servo_in_c import servo_to_c

__all__ = ["CFiles", "design_to_c", "kalman_to_c", "pid_to_c", "servo_mpc_to_c", "servo_to_c"]
