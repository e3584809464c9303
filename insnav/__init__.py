"""Strapdown INS / GPS navigation and INS error analysis.

Conventions, everywhere in insnav
---------------------------------
Frames
    i inertial; e Earth-fixed; n local level, North-East-Down; b body, Forward-Right-Down; a antenna.
Attitude
    ``C_nb`` and ``q_nb`` (scalar first) take body coordinates to navigation coordinates: ``f_n = C_nb @ f_b``.
    ``rph`` is roll, pitch, heading; heading clockwise from north in [0, 2 pi).
Vectors
    Carry their frame: ``v_n``, ``w_ib_b``, ``lever_b``. Order: latitude, longitude, height; North, East, Down.
Specific force
    What an accelerometer senses: level and at rest, z is -9.8 m/s^2.
Height
    Above the WGS-84 ellipsoid.
Units
    SI and radians inside, without a suffix. At every edge (columns, configuration, options, plots) the unit is in the
    name: ``lat_deg``, ``gyro_x_rad_s``.
Errors
    Estimate minus truth. ``sd`` is one standard deviation.
Time
    Seconds as float64 from an epoch of the file's own.
Shapes
    One row a sample: ``(n,)``, ``(n, 3)``, quaternions ``(n, 4)``, matrices ``(n, 3, 3)``.

The way of the data
-------------------
``read_imu``, ``read_gps`` -> ``ImuData``, ``GpsData`` -> `navigate_recording` (alignment, strapdown, filter) -> ``Run``
-> `position_errors`, figures, report.

Examples
--------
>>> from insnav import FilterSettings, load_imu, navigate_recording, read_gps, read_imu  # doctest: +SKIP
>>> imu, gps = read_imu("imu.csv"), read_gps("gps.csv")  # doctest: +SKIP
>>> done = navigate_recording(imu.data, gps.data, load_imu("automotive"), FilterSettings())  # doctest: +SKIP
>>> done.run.solution.lla  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from insnav.errors.metrics import position_errors
    from insnav.exceptions import InsnavError
    from insnav.filter import FilterSettings
    from insnav.filter.navigate import navigate_recording
    from insnav.imu import load_imu
    from insnav.input import read_gps, read_imu, read_reference
    from insnav.strapdown import increments, intervals, navigate
    from insnav.types import GpsData, ImuData, Increments, Run, Trajectory

__version__ = "0.2.0"

_HOME = {
    "FilterSettings": "insnav.filter",
    "GpsData": "insnav.types",
    "ImuData": "insnav.types",
    "Increments": "insnav.types",
    "InsnavError": "insnav.exceptions",
    "Run": "insnav.types",
    "Trajectory": "insnav.types",
    "increments": "insnav.strapdown",
    "intervals": "insnav.strapdown",
    "load_imu": "insnav.imu",
    "navigate": "insnav.strapdown",
    "navigate_recording": "insnav.filter.navigate",
    "position_errors": "insnav.errors.metrics",
    "read_gps": "insnav.input",
    "read_imu": "insnav.input",
    "read_reference": "insnav.input",
}

__all__ = [
    "FilterSettings",
    "GpsData",
    "ImuData",
    "Increments",
    "InsnavError",
    "Run",
    "Trajectory",
    "increments",
    "intervals",
    "load_imu",
    "navigate",
    "navigate_recording",
    "position_errors",
    "read_gps",
    "read_imu",
    "read_reference",
]


def __getattr__(name: str) -> Any:
    # numba, filterpy and pyarrow take most of a second to import: only when something that needs them is used
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'insnav' has no attribute {name!r}")
