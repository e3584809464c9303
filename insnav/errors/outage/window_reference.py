"""What windows are compared with: the drive's own fixes, better positions, or a reference trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.errors.outage.windows import valid
from insnav.exceptions import InputError
from insnav.filter.prepare import Prepared
from insnav.types import FloatArray, GpsData, Trajectory

_AT_IMU = np.zeros(3)
_LEAST_SD = 1e-4  # nothing is known better [m], [m/s]
_WHOLE = 0.98  # part of the record that the rows of a stationary reference must span


@dataclass(frozen=True, slots=True)
class WindowReference:
    """Reference positions, each with its own standard deviation."""

    fixes: GpsData  # positions, and velocities where they are known, every value with a standard deviation
    name: str  # in words, such as "the drive's own GPS fixes"
    # (3,) their point, seen from the IMU, body axes [m]; None for the antenna of the drive
    lever_b: FloatArray | None = None
    own_fixes: bool = False  # they are the fixes of the drive itself


def reference_from_fixes(ready: Prepared) -> WindowReference:
    """The fixes of the drive itself, which the filter does not get in a window."""
    usable = ready.gps.rows(valid(ready.gps) & np.isfinite(ready.gps.lla).all(axis=1))
    return WindowReference(usable, "the drive's own GPS fixes", own_fixes=True)


def reference_from_trajectory(
    reference: Trajectory,
    name: str,
    *,
    position_sd: float,
    velocity_sd: float,
    lever_b: FloatArray | None = _AT_IMU,
) -> WindowReference:
    """A reference trajectory.

    `position_sd`, `velocity_sd`: its uncertainty on each axis elsewhere [m], [m/s]; `lever_b` (3,): the point of the
    reference seen from the IMU, body axes [m]; None for the antenna.
    Raises: InputError: fewer than two rows.
    """
    if len(reference.time) < 2:
        raise InputError("budget.short_reference", count=len(reference.time))
    shape = reference.lla.shape
    own = np.full((shape[0], 9), np.nan) if reference.sd is None else reference.sd
    sd = np.where(np.isfinite(own[:, :6]), own[:, :6], np.repeat([position_sd, velocity_sd], 3))
    sd = np.maximum(sd, _LEAST_SD)
    velocity_sd_n = np.where(np.isfinite(reference.v_n), sd[:, 3:], np.nan)
    fixes = GpsData(reference.time, reference.lla, reference.v_n, sd[:, :3], velocity_sd_n)
    return WindowReference(fixes, name, lever_b)


def stationary_fixes(lla: FloatArray, begin: float, end: float, position_sd: float, velocity_sd: float) -> GpsData:
    """Fixes once a second of a stationary vehicle: what a bench knows without a receiver.

    `lla` (3,): latitude, longitude [rad], height [m]; `begin`, `end`: first and last time [s]; `position_sd`,
    `velocity_sd`: of place and zero velocity, each axis [m], [m/s].
    """
    time: FloatArray = np.arange(begin, end + 1e-6, 1.0)
    shape = (len(time), 3)
    return GpsData(
        time, np.tile(lla, (shape[0], 1)), np.zeros(shape), np.full(shape, position_sd), np.full(shape, velocity_sd)
    )


def is_stationary(reference: Trajectory, begin: float, end: float) -> bool:
    """Whether a reference of a few rows stays at one place for the whole record.

    `begin`, `end`: of the record [s].
    """
    still = bool(np.nan_to_num(reference.v_n).any() == 0) and bool((reference.lla == reference.lla[0]).all())
    return still and float(reference.time[-1] - reference.time[0]) >= _WHOLE * (end - begin)
