"""Strapdown INS / GPS navigation and INS error analysis.

Conventions, everywhere in insnav
---------------------------------
Frames
    i inertial; e Earth-fixed; n local level, North-East-Down; b body, Forward-Right-Down; a antenna.
Attitude
    ``C_nb`` and ``q_nb`` (scalar first) take body coordinates to navigation coordinates: ``f_n = C_nb @ f_b``.
    ``rph`` is roll, pitch, heading; heading clockwise from north in [0, 2 pi).
Vectors
    The name ends in the frame: ``v_n``, ``w_ib_b``, ``lever_b``. Order: latitude, longitude, height; North, East, Down.
Specific force
    Measured by an accelerometer: level and at rest, z is -9.8 m/s^2.
Height
    Above the WGS-84 ellipsoid.
Units
    Variables inside the package are in SI units and radians, without a suffix. Names of columns, configuration keys,
    options and plots contain the unit: ``lat_deg``, ``gyro_x_rad_s``.
Errors
    Estimate minus truth. ``sd`` is one standard deviation.
Time
    Seconds as float64, counted from the time origin of the input file.
Shapes
    One row per sample: ``(n,)``, ``(n, 3)``, quaternions ``(n, 4)``, matrices ``(n, 3, 3)``.

Start here
----------
>>> import insnav  # doctest: +SKIP
>>> drive = insnav.load("imu.csv", gps="gps.csv", ref="ref.csv", lever_arm=(0.8, -0.3, -1.2))  # doctest: +SKIP
>>> result = drive.navigate()  # doctest: +SKIP
>>> result.plot("position_error"); result.to_frame(); result.save("run1")  # doctest: +SKIP
>>> drive.outage(lengths=(10, 30)); drive.budget(times=(10, 60))  # doctest: +SKIP

`load` takes files, data frames and arrays. `simulate` makes simulated drives. `calibrate`, `acceptance`, `allan`,
`drift` and `platform` take bench records. The shell commands call the same functions, with the same defaults.
`navigate_recording`, `navigate` and `increments` are building blocks for your own algorithms.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from insnav.version import __version__ as __version__

if TYPE_CHECKING:
    from insnav.certificate.certify import verify
    from insnav.errors.metrics import position_errors
    from insnav.exceptions import InsnavError
    from insnav.filter.navigate import navigate_recording
    from insnav.filter.receiver import Receiver
    from insnav.fleet.tuning import tune
    from insnav.imu import load_imu
    from insnav.input import read_gps, read_imu, read_reference
    from insnav.library import sample_drive
    from insnav.regression.regress import regress
    from insnav.result import Result, open_result
    from insnav.session.bench import acceptance, allan, calibrate, drift, imus
    from insnav.session.check import check
    from insnav.session.comparison import compare
    from insnav.session.drive import Drive, align, load
    from insnav.session.online import OnlineFilter, OnlineState
    from insnav.session.platform_run import platform
    from insnav.session.requirement import require
    from insnav.session.simulation import simulate
    from insnav.strapdown import increments, intervals, navigate
    from insnav.types import GpsData, ImuData, Increments, Run, Trajectory

_NAMES = {
    "insnav.certificate.certify": "verify",
    "insnav.errors.metrics": "position_errors",
    "insnav.exceptions": "InsnavError",
    "insnav.filter.receiver": "Receiver",
    "insnav.filter.navigate": "navigate_recording",
    "insnav.fleet.tuning": "tune",
    "insnav.imu": "load_imu",
    "insnav.input": "read_gps read_imu read_reference",
    "insnav.library": "sample_drive",
    "insnav.regression.regress": "regress",
    "insnav.result": "Result open_result",
    "insnav.session.bench": "acceptance allan calibrate drift imus",
    "insnav.session.check": "check",
    "insnav.session.comparison": "compare",
    "insnav.session.drive": "Drive align load",
    "insnav.session.online": "OnlineFilter OnlineState",
    "insnav.session.platform_run": "platform",
    "insnav.session.requirement": "require",
    "insnav.strapdown": "increments intervals navigate",
    "insnav.types": "GpsData ImuData Increments Run Trajectory",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [
    "Drive",
    "GpsData",
    "ImuData",
    "Increments",
    "InsnavError",
    "OnlineFilter",
    "OnlineState",
    "Receiver",
    "Result",
    "Run",
    "Trajectory",
    "acceptance",
    "align",
    "allan",
    "calibrate",
    "check",
    "compare",
    "drift",
    "imus",
    "increments",
    "intervals",
    "load",
    "load_imu",
    "navigate",
    "navigate_recording",
    "open_result",
    "platform",
    "position_errors",
    "read_gps",
    "read_imu",
    "read_reference",
    "regress",
    "require",
    "sample_drive",
    "simulate",
    "tune",
    "verify",
]


def __getattr__(name: str) -> Any:
    # importing numba, filterpy and pyarrow takes most of a second, so each name is imported on first use
    if name == "simulate":  # the package `insnav.simulate` is itself callable
        return import_module("insnav.simulate")
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'insnav' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
