"""Recordings: read from files and arrays, described, cleaned, split, written."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.recording.adjust import convert_units, detrend, scale, subtract
    from plantfit.recording.arrays import from_arrays, read_mat, read_npz
    from plantfit.recording.backdate import backdate
    from plantfit.recording.csv import read_csv
    from plantfit.recording.cutoff import Cutoff, cutoff_frequency
    from plantfit.recording.derivative import differentiate
    from plantfit.recording.description import ColumnSummary, Description, describe
    from plantfit.recording.differentiation import DerivativeError, compare_derivatives
    from plantfit.recording.encoder import counts_to_angle, counts_to_speed, period_to_speed
    from plantfit.recording.filters import lowpass
    from plantfit.recording.gaps import fill_gaps
    from plantfit.recording.levels import levels
    from plantfit.recording.motion import smooth_motion
    from plantfit.recording.moving_rms import moving_rms
    from plantfit.recording.odometry import odometry
    from plantfit.recording.outliers import drop_outliers
    from plantfit.recording.parts import cut, shift_time, split
    from plantfit.recording.presliding import presliding
    from plantfit.recording.pwm import duty_to_voltage
    from plantfit.recording.readers import read
    from plantfit.recording.record import Recording, Signal
    from plantfit.recording.resampling import decimate, resample
    from plantfit.recording.sampling import period_of
    from plantfit.recording.tables import from_frame, read_parquet, read_xlsx
    from plantfit.recording.write import to_csv

__all__ = [
    "ColumnSummary",
    "Cutoff",
    "DerivativeError",
    "Description",
    "Recording",
    "Signal",
    "backdate",
    "compare_derivatives",
    "convert_units",
    "counts_to_angle",
    "counts_to_speed",
    "cut",
    "cutoff_frequency",
    "decimate",
    "describe",
    "detrend",
    "differentiate",
    "drop_outliers",
    "duty_to_voltage",
    "fill_gaps",
    "from_arrays",
    "from_frame",
    "levels",
    "lowpass",
    "moving_rms",
    "odometry",
    "period_of",
    "period_to_speed",
    "presliding",
    "read",
    "read_csv",
    "read_mat",
    "read_npz",
    "read_parquet",
    "read_xlsx",
    "resample",
    "scale",
    "shift_time",
    "smooth_motion",
    "split",
    "subtract",
    "to_csv",
]

names_of(
    __name__,
    {
        "adjust": "convert_units detrend scale subtract",
        "arrays": "from_arrays read_mat read_npz",
        "backdate": "backdate",
        "csv": "read_csv",
        "cutoff": "Cutoff cutoff_frequency",
        "derivative": "differentiate",
        "description": "ColumnSummary Description describe",
        "differentiation": "DerivativeError compare_derivatives",
        "encoder": "counts_to_angle counts_to_speed period_to_speed",
        "filters": "lowpass",
        "gaps": "fill_gaps",
        "levels": "levels",
        "motion": "smooth_motion",
        "moving_rms": "moving_rms",
        "odometry": "odometry",
        "outliers": "drop_outliers",
        "parts": "cut shift_time split",
        "presliding": "presliding",
        "pwm": "duty_to_voltage",
        "readers": "read",
        "record": "Recording Signal",
        "resampling": "decimate resample",
        "sampling": "period_of",
        "tables": "from_frame read_parquet read_xlsx",
        "write": "to_csv",
    },
)
