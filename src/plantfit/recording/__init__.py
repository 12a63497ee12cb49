"""Recordings: read from files and arrays, described, cleaned, split, written."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.recording.clean.adjust import convert_units, detrend, scale, subtract
    from plantfit.recording.clean.cutoff import Cutoff, cutoff_frequency
    from plantfit.recording.clean.every import keep_every
    from plantfit.recording.clean.filters import lowpass
    from plantfit.recording.clean.gaps import fill_gaps
    from plantfit.recording.clean.levels import levels
    from plantfit.recording.clean.outliers import drop_outliers, drop_samples
    from plantfit.recording.clean.parts import cut, pieces, shift_time, split
    from plantfit.recording.clean.resampling import decimate, resample
    from plantfit.recording.clean.sampling import period_of
    from plantfit.recording.clean.wraps import unwrap
    from plantfit.recording.description import ColumnSummary, Description, describe
    from plantfit.recording.readers.any_format import read
    from plantfit.recording.readers.formats.arrays import from_arrays, read_mat, read_npz
    from plantfit.recording.readers.formats.tables import from_frame, read_parquet, read_xlsx
    from plantfit.recording.readers.formats.text.csv import read_csv
    from plantfit.recording.record import Recording, Signal
    from plantfit.recording.roles import Role, Roles, guess_roles
    from plantfit.recording.signals.backdate import backdate
    from plantfit.recording.signals.derivative import differentiate
    from plantfit.recording.signals.differentiation import DerivativeError, compare_derivatives
    from plantfit.recording.signals.encoder import counts_to_angle, counts_to_speed, period_to_speed
    from plantfit.recording.signals.motion import smooth_motion
    from plantfit.recording.signals.moving_rms import moving_rms
    from plantfit.recording.signals.odometry import odometry
    from plantfit.recording.signals.presliding import presliding
    from plantfit.recording.signals.pwm import duty_to_voltage, signed
    from plantfit.recording.write import to_csv

__all__ = [
    "ColumnSummary",
    "Cutoff",
    "DerivativeError",
    "Description",
    "Recording",
    "Role",
    "Roles",
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
    "drop_samples",
    "duty_to_voltage",
    "fill_gaps",
    "from_arrays",
    "from_frame",
    "guess_roles",
    "keep_every",
    "levels",
    "lowpass",
    "moving_rms",
    "odometry",
    "period_of",
    "period_to_speed",
    "pieces",
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
    "signed",
    "smooth_motion",
    "split",
    "subtract",
    "to_csv",
    "unwrap",
]

names_of(
    __name__,
    {
        "clean.adjust": "convert_units detrend scale subtract",
        "readers.formats.arrays": "from_arrays read_mat read_npz",
        "signals.backdate": "backdate",
        "readers.formats.text.csv": "read_csv",
        "roles": "Role Roles guess_roles",
        "clean.cutoff": "Cutoff cutoff_frequency",
        "signals.derivative": "differentiate",
        "description": "ColumnSummary Description describe",
        "signals.differentiation": "DerivativeError compare_derivatives",
        "signals.encoder": "counts_to_angle counts_to_speed period_to_speed",
        "clean.filters": "lowpass",
        "clean.every": "keep_every",
        "clean.gaps": "fill_gaps",
        "clean.levels": "levels",
        "signals.motion": "smooth_motion",
        "signals.moving_rms": "moving_rms",
        "signals.odometry": "odometry",
        "clean.outliers": "drop_outliers drop_samples",
        "clean.parts": "cut pieces shift_time split",
        "signals.presliding": "presliding",
        "signals.pwm": "duty_to_voltage signed",
        "readers.any_format": "read",
        "record": "Recording Signal",
        "clean.resampling": "decimate resample",
        "clean.sampling": "period_of",
        "clean.wraps": "unwrap",
        "readers.formats.tables": "from_frame read_parquet read_xlsx",
        "write": "to_csv",
    },
)
