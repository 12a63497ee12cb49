"""Controllers and filters as self-contained C99 for a microcontroller."""

from plantfit.control.c_export.design_in_c import design_to_c
from plantfit.control.c_export.files import CFiles
from plantfit.control.c_export.kalman_in_c import kalman_to_c
from plantfit.control.c_export.mpc_in_c import servo_mpc_to_c
from plantfit.control.c_export.pids.cascade_in_c import cascade_to_c
from plantfit.control.c_export.pids.pid_in_c import pid_to_c
from plantfit.control.c_export.pids.scheduled_in_c import scheduled_to_c
from plantfit.control.c_export.pids.smith_in_c import smith_to_c
from plantfit.control.c_export.servo_in_c import servo_to_c

__all__ = [
    "CFiles",
    "cascade_to_c",
    "design_to_c",
    "kalman_to_c",
    "pid_to_c",
    "scheduled_to_c",
    "servo_mpc_to_c",
    "servo_to_c",
    "smith_to_c",
]
